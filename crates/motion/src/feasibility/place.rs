//! Placement of a held object: carry to above a goal pose, lower, release, retreat.

use genmanip_core::{Piece, Pose, Seed};
use glam::DVec3;

use super::motions::straight_off;
use super::{FeasibilitySettings, PlaceGoal};
use crate::collision::{AllowedCollisions, Attached, CollisionWorld, GeometryError};
use crate::path::Path;
use crate::plan::PlanError;
use crate::planner::{Planner, PlanningScene};

/// Query for placing the held object.
#[derive(Clone, Copy, Debug)]
pub struct PlaceQuery<'a> {
    /// Planner of the robot, which also has the gripper.
    pub planner: &'a Planner,
    /// All obstacles except the object.
    pub world: &'a CollisionWorld,
    /// Name of the held object.
    pub name: &'a str,
    /// Convex collision pieces of the held object, object frame.
    pub pieces: &'a [Piece],
    /// Object pose in the TCP frame.
    pub tcp_from_object: Pose,
    /// Current arm configuration (rad).
    pub arm: &'a [f64],
    /// Current gripper opening (m).
    pub held_width_m: f64,
    /// Gripper opening after the release (m).
    pub open_width_m: f64,
    /// Clearances, heights and search limits.
    pub settings: &'a FeasibilitySettings,
    /// Maximum number of failed motion searches in total; `usize::MAX` for no limit.
    pub searches: usize,
    /// Maximum number of failed motion searches per goal pose.
    pub searches_per_goal: usize,
}

/// Motions of one placement, in order; the gripper opens after the second.
#[derive(Clone, Debug, PartialEq)]
pub struct Release {
    /// Free motion to above the goal pose.
    pub carry: Path,
    /// Straight lowering to the release pose.
    pub lower: Path,
    /// Straight retreat along the fingers.
    pub retreat: Path,
}

impl PlaceQuery<'_> {
    /// True if the release pose at this height is reachable: a cheap check before planning.
    pub fn reaches(&self, world_from_object: &Pose, height_m: f64) -> bool {
        let raised = Pose { position: world_from_object.position + DVec3::Z * height_m, ..*world_from_object };
        self.planner.ik_each(&(raised * self.tcp_from_object.inverse()), self.arm).next().is_some()
    }

    /// First feasible release at any of the goals, with the index of its goal.
    ///
    /// Objects dropped from high topple and hit the gripper: every goal is tried low before any is tried higher.
    ///
    /// # Errors
    /// Error of the first attempt; `None` if no goal allows any height.
    pub fn first(&self, goals: &[PlaceGoal], seed: Seed) -> Result<(usize, Release), Option<PlanError>> {
        let (mut failure, mut left) = (None, self.searches);
        let mut left_per_goal = vec![self.searches_per_goal; goals.len()];
        for &height_m in &self.settings.release_heights_m {
            for (index, goal) in goals.iter().enumerate().filter(|(_, goal)| height_m <= goal.highest_release_m) {
                let allowed = left.min(left_per_goal[index]);
                if allowed == 0 {
                    continue;
                }
                let mut unused = allowed;
                match self.release_within(&mut unused, goal, height_m, seed.fork_index(index as u64)) {
                    Ok(release) => return Ok((index, release)),
                    Err(error) => failure = failure.or(Some(error)),
                }
                left -= allowed - unused;
                left_per_goal[index] -= allowed - unused;
            }
        }
        Err(failure)
    }

    /// Plans a release at a height above a goal pose.
    ///
    /// # Errors
    /// Error of the last arm configuration, or an invalid collision piece.
    pub fn release(&self, goal: &PlaceGoal, height_m: f64, seed: Seed) -> Result<Release, PlanError> {
        self.release_within(&mut self.searches.min(self.searches_per_goal), goal, height_m, seed)
    }

    /// Like [`Self::release`]; each failed search decrements `searches`, and none is started at 0.
    fn release_within(
        &self,
        searches: &mut usize,
        goal: &PlaceGoal,
        height_m: f64,
        seed: Seed,
    ) -> Result<Release, PlanError> {
        let (planner, settings) = (self.planner, self.settings);
        let unusable = |error: GeometryError| PlanError::Unreachable { what: error.to_string() };
        let attached = Attached::new(self.name, self.pieces, &self.tcp_from_object).map_err(unusable)?;
        let no_contact = AllowedCollisions::none();
        let carrying = PlanningScene {
            world: self.world,
            attached: Some(&attached),
            allowed: &no_contact,
            gripper_width: self.held_width_m,
        };
        let tcp_at = |height_m: f64| goal.raised(height_m) * self.tcp_from_object.inverse();
        let world_from_release = tcp_at(height_m);
        let above = tcp_at(goal.clear_height_m.max(settings.lift_for_m(planner.robot())));

        // After the release the object is an obstacle.
        let mut occupied = self.world.clone();
        occupied.add(self.name, self.pieces, &goal.raised(height_m)).map_err(unusable)?;
        let touching = AllowedCollisions::none().and_gripper(planner.robot(), self.name);
        let opened =
            PlanningScene { world: &occupied, attached: None, allowed: &no_contact, gripper_width: self.open_width_m };
        let beside = PlanningScene { allowed: &touching, ..opened };
        let hand_alone = PlanningScene { world: self.world, ..opened };
        let checker = planner.checker(&hand_alone, settings.clearance_m);
        let back = world_from_release.transform_vector(DVec3::NEG_Z) * settings.approach_for_m(planner.robot());
        let retreated = Pose { position: world_from_release.position + back, ..world_from_release };

        let mut failure = PlanError::Unreachable { what: "the release pose".into() };
        let configs = planner.ik(&world_from_release, self.arm);
        for config in configs.iter().filter(|config| checker.is_free(config)).take(settings.goal_configurations) {
            let planned = (|| {
                let lower = planner.straight(&carrying, config, &above)?.reversed();
                let scenes = [&opened, &beside];
                let retreat = straight_off(planner, scenes, settings.object_clearance_m, config, &retreated)?;
                let carry = planner.plan_joint(&carrying, self.arm, &[lower.start().to_vec()], seed.fork("carry"))?;
                Ok(Release { carry, lower, retreat })
            })();
            match planned {
                Ok(release) => return Ok(release),
                Err(error) => {
                    *searches -= usize::from(matches!(error, PlanError::Exhausted { .. }));
                    failure = error;
                }
            }
            if *searches == 0 {
                break;
            }
        }
        Err(failure)
    }
}
