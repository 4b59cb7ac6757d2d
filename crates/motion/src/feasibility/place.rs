//! Placing what is in the hand: carried to above a goal pose, lowered, let go of, left.

use genmanip_core::{Piece, Pose, Seed};
use glam::DVec3;

use super::{FeasibilitySettings, PlaceGoal};
use crate::collision::{Allowed, Attached, CollisionWorld, GeometryError};
use crate::path::Path;
use crate::plan::PlanError;
use crate::planner::{Planner, PlanningScene};

/// What is asked about placing the object in the hand.
#[derive(Clone, Copy, Debug)]
pub struct PlaceQuery<'a> {
    /// Robot and gripper.
    pub planner: &'a Planner,
    /// All obstacles but the object.
    pub world: &'a CollisionWorld,
    /// Name of the object.
    pub name: &'a str,
    /// Its convex pieces, object frame.
    pub pieces: &'a [Piece],
    /// How it sits in the hand.
    pub tcp_from_object: Pose,
    /// Where the arm is, rad.
    pub arm: &'a [f64],
    /// Present opening, m.
    pub held_width_m: f64,
    /// Opening to let go with, m.
    pub open_width_m: f64,
    /// What counts as feasible.
    pub settings: &'a FeasibilitySettings,
    /// Searches for a free motion that may find nothing before there is no release; `usize::MAX` for no bound.
    pub searches: usize,
}

/// The motions of one place, in their order; the fingers open after the second.
#[derive(Clone, Debug, PartialEq)]
pub struct Release {
    /// From where the arm is to above the goal pose.
    pub carry: Path,
    /// Straight down to where the object is let go of.
    pub lower: Path,
    /// Straight back along the fingers.
    pub retreat: Path,
}

impl PlaceQuery<'_> {
    /// Whether the hand gets to where the object is this much above a pose: a cheap test, before anything is planned.
    pub fn reaches(&self, world_from_object: &Pose, height_m: f64) -> bool {
        let raised = Pose { position: world_from_object.position + DVec3::Z * height_m, ..*world_from_object };
        self.planner.ik_each(&(raised * self.tcp_from_object.inverse()), self.arm).next().is_some()
    }

    /// The first release that can be made at any of the goals.
    ///
    /// What falls far tips over and meets the hand again: every goal is tried low before any is tried from higher up.
    ///
    /// # Errors
    /// Why the first try failed; `None` when no goal allows any height.
    pub fn first(&self, goals: &[PlaceGoal], seed: Seed) -> Result<Release, Option<PlanError>> {
        let (mut problem, mut searches) = (None, self.searches);
        for &height_m in &self.settings.release_heights_m {
            for (index, goal) in goals.iter().enumerate().filter(|(_, goal)| height_m <= goal.highest_release_m) {
                match self.release_within(&mut searches, goal, height_m, seed.fork_index(index as u64)) {
                    Ok(release) => return Ok(release),
                    Err(error) => problem = problem.or(Some(error)),
                }
                if searches == 0 {
                    return Err(problem);
                }
            }
        }
        Err(problem)
    }

    /// The motions that let go of the object this much above a goal pose.
    ///
    /// # Errors
    /// Why the last arm configuration does not do; a piece of the object that is not finite or has no size.
    pub fn release(&self, goal: &PlaceGoal, height_m: f64, seed: Seed) -> Result<Release, PlanError> {
        self.release_within(&mut self.searches.clone(), goal, height_m, seed)
    }

    /// The same; `searches` loses one for each search that finds nothing, and none is begun when none is left.
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
        let nothing = Allowed::none();
        let carrying = PlanningScene {
            world: self.world,
            attached: Some(&attached),
            allowed: &nothing,
            gripper_width: self.held_width_m,
        };
        let tcp_at = |height_m: f64| goal.raised(height_m) * self.tcp_from_object.inverse();
        let world_from_release = tcp_at(height_m);
        let above = tcp_at(goal.clear_height_m.max(settings.lift_m));

        // Once let go of, the object is an obstacle.
        let mut occupied = self.world.clone();
        occupied.add(self.name, self.pieces, &goal.raised(height_m)).map_err(unusable)?;
        let leaving = match settings.object_clearance_m {
            Some(_) => Allowed::none(),
            None => Allowed::none().and_gripper(planner.robot(), self.name),
        };
        let opened =
            PlanningScene { world: &occupied, attached: None, allowed: &leaving, gripper_width: self.open_width_m };
        let hand_alone = PlanningScene { world: self.world, ..opened };
        let checker = planner.checker(&hand_alone, settings.clearance_m);
        let back = world_from_release.transform_vector(DVec3::NEG_Z) * settings.approach_m;
        let retreated = Pose { position: world_from_release.position + back, ..world_from_release };

        let mut problem = PlanError::Unreachable { what: "the place where to let go".into() };
        let configs = planner.ik(&world_from_release, self.arm);
        for config in configs.iter().filter(|config| checker.is_free(config)).take(settings.goal_configurations) {
            let planned = (|| {
                let lower = planner.straight(&carrying, config, &above)?.reversed();
                let retreat = planner.straight(&opened, config, &retreated)?;
                let carry = planner.plan_joint(&carrying, self.arm, &[lower.start().to_vec()], seed.fork("carry"))?;
                Ok(Release { carry, lower, retreat })
            })();
            match planned {
                Ok(release) => return Ok(release),
                Err(error) => {
                    *searches -= usize::from(matches!(error, PlanError::Exhausted { .. }));
                    problem = error;
                }
            }
            if *searches == 0 {
                break;
            }
        }
        Err(problem)
    }
}
