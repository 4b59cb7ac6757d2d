//! Feasibility of picks and placements.
//!
//! A [`PickQuery`] holds the obstacles, the object, goal poses and the arm configuration. [`PickQuery::grasps`] checks
//! grasp candidates in order and yields the feasible ones:
//! 1. an IK solution collides with nothing but possibly the object, and so does one for the pre-grasp if
//!    [`FeasibilitySettings::tests_pregrasp`] is set;
//! 2. the open fingers fit beside the object;
//! 3. at some goal pose the same grasp can release the object, as low as possible.
//!
//! The search is lazy and ends after [`FeasibilitySettings::wanted`] grasps; rejections are counted by reason. Motions
//! are planned for one grasp at a time on demand: straight approach, free motion to it, lift. For a held object, a
//! [`PlaceQuery`] plans carry, lower and retreat.
//!
//! Goal poses are arguments; this module knows nothing about task goals.

mod motions;
mod place;
mod rejections;
mod settings;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use genmanip_core::{Grasp, Piece, Pose};
use glam::{DQuat, DVec3};

pub use motions::PickMotions;
pub use place::{PlaceQuery, Release};
pub use rejections::{GraspRejection, GraspRejections};
pub use settings::{FeasibilitySettings, HalfTurn};

use crate::collision::{AllowedCollisions, Checker, CollisionWorld};
use crate::plan::PlanError;
use crate::planner::{Planner, PlanningScene};

/// Maximum joint motion between grasp and pre-grasp (rad) within one IK branch; the solutions of other branches are
/// farther away.
const SAME_BRANCH_RAD: f64 = 1.0;

/// Tilts at which an arm with fewer than six joints is tried if it does not reach a point straight down, rad: up to
/// [`crate::GraspSettings::max_tilt`].
const OUTWARD_TILTS_RAD: [f64; 3] = [0.3, 0.6, 0.95];

/// The object to be picked, at its pose.
#[derive(Clone, Copy, Debug)]
pub struct PickedObject<'a> {
    /// Obstacle name of the object.
    pub name: &'a str,
    /// Object pose, world frame.
    pub world_from_object: Pose,
    /// Convex collision pieces, object frame.
    pub pieces: &'a [Piece],
}

/// A goal pose of the object, with its release heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceGoal {
    /// `world_from_object` at rest.
    pub world_from_object: Pose,
    /// Maximum release height above the goal pose (m).
    pub highest_release_m: f64,
    /// Height above the goal pose at which the object is clear of its receiver (m); it is lowered from there, or from
    /// [`FeasibilitySettings::lift_m`] if that is higher.
    pub clear_height_m: f64,
}

/// Query for feasible grasps of one object.
#[derive(Clone, Copy, Debug)]
pub struct PickQuery<'a> {
    /// Planner of the robot, which also has the gripper.
    pub planner: &'a Planner,
    /// All obstacles, including the picked object under [`PickedObject::name`].
    pub world: &'a CollisionWorld,
    /// The object to be picked.
    pub object: PickedObject<'a>,
    /// Goal poses, one of which must allow a release; empty for none.
    pub goals: &'a [PlaceGoal],
    /// Current arm configuration (rad); IK solutions near it are preferred.
    pub arm: &'a [f64],
    /// Criteria by which a grasp counts as feasible.
    pub settings: &'a FeasibilitySettings,
}

/// A grasp that meets all criteria, with its arm configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct FeasibleGrasp {
    /// The grasp, object frame; possibly the candidate rotated by half a turn.
    pub object_from_tcp: Grasp,
    /// Arm configuration at the grasp (rad).
    pub config: Vec<f64>,
    /// Gripper opening during the approach (m).
    pub opening_m: f64,
    /// Minimum release height above a goal pose (m); `None` without goals.
    pub release_height_m: Option<f64>,
}

impl<'a> PickQuery<'a> {
    /// Feasible grasps among `candidates` (object frame), in order.
    pub fn grasps<I: Iterator<Item = Grasp>>(&self, candidates: I) -> FeasibleGrasps<'a, I> {
        FeasibleGrasps {
            query: *self,
            candidates,
            turned: None,
            pending: VecDeque::new(),
            found: 0,
            rejections: GraspRejections::default(),
            blocked: Vec::new(),
        }
    }

    /// Allowed collisions that exclude the object; its clearance is checked separately.
    fn without_object(&self) -> AllowedCollisions {
        AllowedCollisions::none().and_all(self.object.name)
    }

    fn with_gripper_touching(&self) -> AllowedCollisions {
        AllowedCollisions::none().and_gripper(self.planner.robot(), self.object.name)
    }

    fn empty_gripper<'q>(&'q self, allowed: &'q AllowedCollisions, opening_m: f64) -> PlanningScene<'q> {
        PlanningScene { world: self.world, attached: None, allowed, gripper_width: opening_m }
    }

    /// Gripper openings for an approach (m), preferred one first.
    fn openings(&self, grasp: &Grasp) -> impl Iterator<Item = f64> + use<> {
        let max_width = self.planner.gripper().max_width;
        let widened = self.settings.finger_room_m.map(|room| (grasp.width + room).min(max_width));
        widened.into_iter().chain([self.planner.opening(grasp)])
    }

    /// Feasible grasps with the configurations of a candidate, at most [`FeasibilitySettings::configurations_kept`].
    fn configurations_of(&self, grasp: &Grasp) -> Result<Vec<FeasibleGrasp>, LazyRejection> {
        let PickQuery { planner, object, settings, .. } = *self;
        let Some(opening_m) = self.openings(grasp).next() else { return Ok(Vec::new()) };
        let world_from_tcp = object.world_from_object * grasp.pose;
        let mut configs = planner.ik_each(&world_from_tcp, self.arm).take(settings.configurations).peekable();
        let Some(first) = configs.peek().cloned() else { return Err(GraspRejection::OutOfReach.into()) };
        let allowed = match settings.object_clearance_m {
            Some(_) => self.without_object(),
            None => self.with_gripper_touching(),
        };
        let checker = planner.checker(&self.empty_gripper(&allowed, opening_m), settings.clearance_m);
        let mut free = configs.filter(|config| checker.is_free(config)).peekable();
        if free.peek().is_none() {
            return Err(LazyRejection::Blocked { opening_m, config: first });
        }
        let mut feasible = Vec::new();
        let mut rejection = LazyRejection::from(no_approach());
        for config in free
            .filter(|config| self.has_pregrasp(&world_from_tcp, config, &checker))
            .take(settings.configurations_kept)
        {
            match self.complete(grasp, config, &checker) {
                Ok(grasp) => feasible.push(grasp),
                Err(reason) => rejection = reason.into(),
            }
        }
        if feasible.is_empty() { Err(rejection) } else { Ok(feasible) }
    }

    fn has_pregrasp(&self, world_from_tcp: &Pose, config: &[f64], checker: &Checker) -> bool {
        let approach_m = self.settings.approach_for_m(self.planner.robot());
        let world_from_pregrasp = *world_from_tcp * Pose::from_position(DVec3::Z * -approach_m);
        let pregrasp = || self.planner.ik_along_line(&world_from_pregrasp, config, SAME_BRANCH_RAD);
        !self.settings.tests_pregrasp || pregrasp().is_some_and(|config| checker.is_free(&config))
    }

    /// Checks finger clearance beside the object and a release at a goal pose; `checker` is that of the grasp.
    fn complete(&self, grasp: &Grasp, config: Vec<f64>, checker: &Checker) -> Result<FeasibleGrasp, GraspRejection> {
        let opening_m = self
            .openings(grasp)
            .find(|&opening_m| self.is_beside_object(opening_m, &config))
            .ok_or_else(|| GraspRejection::Blocked { by: self.object.name.to_owned() })?;
        let release_height_m = if self.goals.is_empty() {
            None
        } else {
            Some(self.release_height_m(grasp, &config, checker).ok_or(GraspRejection::NoUse)?)
        };
        Ok(FeasibleGrasp { object_from_tcp: grasp.clone(), config, opening_m, release_height_m })
    }

    /// True if the robot keeps its clearance to the object, if one is set.
    fn is_beside_object(&self, opening_m: f64, config: &[f64]) -> bool {
        let no_contact = AllowedCollisions::none();
        let keeps = |clearance_m| {
            self.planner.checker(&self.empty_gripper(&no_contact, opening_m), clearance_m).is_free(config)
        };
        self.settings.object_clearance_m.is_none_or(keeps)
    }

    /// Minimum release height above a goal pose (m); `None` if no goal allows a release.
    fn release_height_m(&self, grasp: &Grasp, config: &[f64], at_grasp: &Checker) -> Option<f64> {
        let (planner, settings) = (self.planner, self.settings);
        // The object will have left its current pose.
        let allowed = self.without_object();
        let opening_m = self.openings(grasp).next()?;
        let elsewhere = settings
            .object_clearance_m
            .is_none()
            .then(|| planner.checker(&self.empty_gripper(&allowed, opening_m), settings.clearance_m));
        let checker = elsewhere.as_ref().unwrap_or(at_grasp);
        let is_free_at = |goal: &PlaceGoal, height_m: f64| {
            let world_from_tcp = goal.raised(height_m) * grasp.pose;
            let mut configs = planner.ik_each(&world_from_tcp, config).take(settings.goal_configurations);
            configs.any(|config| checker.is_free(&config))
        };
        settings.release_heights_m.iter().copied().find(|&height_m| {
            self.goals.iter().any(|goal| height_m <= goal.highest_release_m && is_free_at(goal, height_m))
        })
    }
}

impl PlaceGoal {
    /// `world_from_object` at a height above the goal pose.
    fn raised(&self, height_m: f64) -> Pose {
        let position = self.world_from_object.position + DVec3::Z * height_m;
        Pose { position, ..self.world_from_object }
    }
}

/// Reason for rejecting a grasp; the blocking obstacle is determined on demand, since that takes exact distances to
/// everything.
enum LazyRejection {
    Known(GraspRejection),
    Blocked { opening_m: f64, config: Vec<f64> },
}

impl From<GraspRejection> for LazyRejection {
    fn from(rejection: GraspRejection) -> Self {
        Self::Known(rejection)
    }
}

fn no_approach() -> GraspRejection {
    GraspRejection::NoApproach(PlanError::Unreachable { what: "the pre-grasp pose".into() })
}

/// Iterator over feasible grasps, see [`PickQuery::grasps`].
#[derive(Clone, Debug)]
pub struct FeasibleGrasps<'a, I> {
    query: PickQuery<'a>,
    candidates: I,
    /// The last candidate rotated by half a turn, if still to be tried; otherwise `None`.
    turned: Option<Grasp>,
    pending: VecDeque<FeasibleGrasp>,
    found: usize,
    rejections: GraspRejections,
    /// Openings (m) and configurations of grasps that collide, from which [`FeasibleGrasps::rejections`] determines the
    /// obstacles.
    blocked: Vec<(f64, Vec<f64>)>,
}

impl<I> FeasibleGrasps<'_, I> {
    /// Rejections so far, with obstacle names.
    pub fn rejections(&self) -> GraspRejections {
        let PickQuery { planner, settings, .. } = self.query;
        let allowed = match settings.object_clearance_m {
            Some(_) => self.query.without_object(),
            None => self.query.with_gripper_touching(),
        };
        let mut rejections = self.rejections.clone();
        for (opening_m, config) in &self.blocked {
            let checker = planner.checker(&self.query.empty_gripper(&allowed, *opening_m), settings.clearance_m);
            if let Some(report) = checker.check(config) {
                rejections.count(&GraspRejection::Blocked { by: report.other });
            }
        }
        rejections
    }

    fn feasible(&mut self, grasp: &Grasp) -> Vec<FeasibleGrasp> {
        self.query.configurations_of(grasp).unwrap_or_else(|rejection| {
            match rejection {
                LazyRejection::Known(rejection) => self.rejections.count(&rejection),
                LazyRejection::Blocked { opening_m, config } => self.blocked.push((opening_m, config)),
            }
            Vec::new()
        })
    }
}

impl<I: Iterator<Item = Grasp>> Iterator for FeasibleGrasps<'_, I> {
    type Item = FeasibleGrasp;

    fn next(&mut self) -> Option<FeasibleGrasp> {
        while self.found < self.query.settings.wanted {
            if let Some(grasp) = self.pending.pop_front() {
                self.found += 1;
                return Some(grasp);
            }
            match self.query.settings.half_turn {
                HalfTurn::Both => {
                    let grasp = match self.turned.take() {
                        Some(turned) => turned,
                        None => {
                            let candidate = self.candidates.next()?;
                            self.turned = Some(candidate.flipped());
                            candidate
                        }
                    };
                    let feasible = self.feasible(&grasp);
                    self.pending.extend(feasible);
                }
                HalfTurn::Neither => {
                    let candidate = self.candidates.next()?;
                    let feasible = self.feasible(&candidate);
                    self.pending.extend(feasible);
                }
                HalfTurn::Nearer => {
                    let candidate = self.candidates.next()?;
                    let [one, other] = [self.feasible(&candidate), self.feasible(&candidate.flipped())];
                    let far = |grasps: &[FeasibleGrasp]| {
                        grasps
                            .first()
                            .map_or(f64::INFINITY, |grasp| crate::path::distance(&grasp.config, self.query.arm))
                    };
                    self.pending.extend(if far(&other) < far(&one) { other } else { one });
                }
            }
        }
        None
    }
}

impl Planner {
    /// True if the gripper can reach a point pointing straight down, at any yaw; with fewer than six joints also if it
    /// can pointing down and away from the base.
    ///
    /// A cheap check of goal poses before grasps are known.
    pub fn reaches_from_above(&self, point: DVec3) -> bool {
        let down = Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(std::f64::consts::PI) };
        let reaches = |world_from_tcp: Pose| self.ik_each(&world_from_tcp, &self.robot().home).next().is_some();
        let straight_down = (0..4).any(|turn| {
            let yaw = f64::from(turn) * std::f64::consts::FRAC_PI_4;
            reaches(Pose::from_position_yaw(point, yaw) * down)
        });
        straight_down
            || self.tool_dof() < 6
                && OUTWARD_TILTS_RAD.iter().any(|&tilt| reaches(Pose::new(point, self.tilted_outward(point, tilt))))
    }

    /// `world_from_tcp` rotation of a gripper that points down, tilted away from the base by an angle (rad), and closes
    /// across the direction from the base to a point.
    pub fn tilted_outward(&self, point: DVec3, tilt: f64) -> DQuat {
        DQuat::from_rotation_z(self.heading(point))
            * DQuat::from_rotation_y(-tilt)
            * DQuat::from_rotation_x(std::f64::consts::PI)
    }
}
