//! Whether an object can be picked and placed: one query for everybody who asks.
//!
//! A [`PickQuery`] holds the obstacles, the object, goal poses and where the arm is.
//! [`PickQuery::grasps`] goes through grasp candidates in their order and yields those that the arm can carry out:
//! 1. a configuration is in reach and free of everything but the object, and so is the start of the approach where
//!    [`FeasibilitySettings::tests_pregrasp`] asks for it;
//! 2. beside the object there is room for the open fingers;
//! 3. at some goal pose there is room for the same hand to let go, as low as possible.
//!
//! The search is lazy, and ends after [`FeasibilitySettings::wanted`] grasps; what was refused is counted by reason.
//! Motions are planned for one grasp at a time, when they are asked for: straight approach, free motion to it, lift.
//! Once the object is in the hand, a [`PlaceQuery`] plans how it is carried, lowered and left.
//!
//! Nothing here knows what a goal means: goal poses are arguments.

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

use crate::collision::{Allowed, Checker, CollisionWorld};
use crate::plan::PlanError;
use crate::planner::{Planner, PlanningScene};

/// Largest joint motion between grasp and pre-grasp, rad: other branches of the inverse kinematics lie farther away.
const SAME_BRANCH_RAD: f64 = 1.0;

/// The object to be picked, where it is.
#[derive(Clone, Copy, Debug)]
pub struct PickedObject<'a> {
    /// Its name among the obstacles.
    pub name: &'a str,
    /// Where it is.
    pub world_from_object: Pose,
    /// Its convex pieces, object frame.
    pub pieces: &'a [Piece],
}

/// A pose at which the object may be let go of, or somewhat above it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceGoal {
    /// `world_from_object` at rest.
    pub world_from_object: Pose,
    /// Greatest height above it at which the object may be let go of, m.
    pub highest_release_m: f64,
    /// Height above it at which the object is clear of what will receive it, m; it is lowered from there, or from
    /// [`FeasibilitySettings::lift_m`] if that is higher.
    pub clear_height_m: f64,
}

/// What is asked about picking one object.
#[derive(Clone, Copy, Debug)]
pub struct PickQuery<'a> {
    /// Robot and gripper.
    pub planner: &'a Planner,
    /// All obstacles, the object among them under its name.
    pub world: &'a CollisionWorld,
    /// The object.
    pub object: PickedObject<'a>,
    /// Poses at one of which the object must be let go of; none: it need not.
    pub goals: &'a [PlaceGoal],
    /// Where the arm is, rad; the grasp's configurations are sought near it.
    pub arm: &'a [f64],
    /// What counts as feasible.
    pub settings: &'a FeasibilitySettings,
}

/// A grasp that the arm can carry out.
#[derive(Clone, Debug, PartialEq)]
pub struct FeasibleGrasp {
    /// The grasp in the object's frame; perhaps turned by half a circle against the candidate it came from.
    pub object_from_tcp: Grasp,
    /// Arm configuration at the grasp, rad.
    pub config: Vec<f64>,
    /// Opening while approaching, m.
    pub opening_m: f64,
    /// Least height above a goal pose at which the hand has room to let go, m; `None` when there are no goals.
    pub release_height_m: Option<f64>,
}

impl<'a> PickQuery<'a> {
    /// Those of `candidates` (object frame) that are feasible, in their order.
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

    /// Everything but the object may not be touched, and the object only as the settings say.
    fn without_object(&self) -> Allowed {
        Allowed::none().and_all(self.object.name)
    }

    fn with_gripper_touching(&self) -> Allowed {
        Allowed::none().and_gripper(self.planner.robot(), self.object.name)
    }

    fn empty_hand<'q>(&'q self, allowed: &'q Allowed, opening_m: f64) -> PlanningScene<'q> {
        PlanningScene { world: self.world, attached: None, allowed, gripper_width: opening_m }
    }

    /// Openings with which a grasp may be approached, m, the preferred one first.
    fn openings(&self, grasp: &Grasp) -> impl Iterator<Item = f64> + use<> {
        let max_width = self.planner.gripper().max_width;
        let roomy = self.settings.finger_room_m.map(|room| (grasp.width + room).min(max_width));
        roomy.into_iter().chain([self.planner.opening(grasp)])
    }

    /// The grasp at its free configurations, as many as the settings keep.
    fn at(&self, grasp: &Grasp) -> Result<Vec<FeasibleGrasp>, Refusal> {
        let PickQuery { planner, object, settings, .. } = *self;
        let Some(opening_m) = self.openings(grasp).next() else { return Ok(Vec::new()) };
        let world_from_tcp = object.world_from_object * grasp.pose;
        let mut configs = planner.ik_each(&world_from_tcp, self.arm).take(settings.configurations).peekable();
        let Some(first) = configs.peek().cloned() else { return Err(GraspRejection::OutOfReach.into()) };
        let allowed = match settings.object_clearance_m {
            Some(_) => self.without_object(),
            None => self.with_gripper_touching(),
        };
        let checker = planner.checker(&self.empty_hand(&allowed, opening_m), settings.clearance_m);
        let mut free = configs.filter(|config| checker.is_free(config)).peekable();
        if free.peek().is_none() {
            return Err(Refusal::Blocked { opening_m, config: first });
        }
        let mut feasible = Vec::new();
        let mut refusal = Refusal::from(no_approach());
        for config in free
            .filter(|config| self.has_pregrasp(&world_from_tcp, config, &checker))
            .take(settings.configurations_kept)
        {
            match self.in_the_hand(grasp, config, &checker) {
                Ok(grasp) => feasible.push(grasp),
                Err(rejection) => refusal = rejection.into(),
            }
        }
        if feasible.is_empty() { Err(refusal) } else { Ok(feasible) }
    }

    fn has_pregrasp(&self, world_from_tcp: &Pose, config: &[f64], checker: &Checker) -> bool {
        let world_from_pregrasp = *world_from_tcp * Pose::from_position(DVec3::Z * -self.settings.approach_m);
        let pregrasp = || self.planner.ik_near(&world_from_pregrasp, config, SAME_BRANCH_RAD);
        !self.settings.tests_pregrasp || pregrasp().is_some_and(|config| checker.is_free(&config))
    }

    /// Room for the fingers beside the object, and for the hand at a goal pose; `checker` is that of the grasp.
    fn in_the_hand(&self, grasp: &Grasp, config: Vec<f64>, checker: &Checker) -> Result<FeasibleGrasp, GraspRejection> {
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

    /// Whether the robot keeps its distance from the object, if it has to keep one.
    fn is_beside_object(&self, opening_m: f64, config: &[f64]) -> bool {
        let nothing = Allowed::none();
        let keeps =
            |clearance_m| self.planner.checker(&self.empty_hand(&nothing, opening_m), clearance_m).is_free(config);
        self.settings.object_clearance_m.is_none_or(keeps)
    }

    /// The least height above a goal pose at which the hand has room.
    fn release_height_m(&self, grasp: &Grasp, config: &[f64], at_grasp: &Checker) -> Option<f64> {
        let (planner, settings) = (self.planner, self.settings);
        // The object will not be where it is now.
        let allowed = self.without_object();
        let opening_m = self.openings(grasp).next()?;
        let elsewhere = settings
            .object_clearance_m
            .is_none()
            .then(|| planner.checker(&self.empty_hand(&allowed, opening_m), settings.clearance_m));
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
    /// `world_from_object` this much above the goal pose.
    fn raised(&self, height_m: f64) -> Pose {
        let position = self.world_from_object.position + DVec3::Z * height_m;
        Pose { position, ..self.world_from_object }
    }
}

/// Why one grasp was refused; what it is blocked by is only looked up when it is asked for, since that takes exact
/// distances to everything.
enum Refusal {
    Known(GraspRejection),
    Blocked { opening_m: f64, config: Vec<f64> },
}

impl From<GraspRejection> for Refusal {
    fn from(rejection: GraspRejection) -> Self {
        Self::Known(rejection)
    }
}

fn no_approach() -> GraspRejection {
    GraspRejection::NoApproach(PlanError::Unreachable { what: "the start of the straight approach".into() })
}

/// Feasible grasps, one after the other, see [`PickQuery::grasps`].
#[derive(Clone, Debug)]
pub struct FeasibleGrasps<'a, I> {
    query: PickQuery<'a>,
    candidates: I,
    /// The last candidate turned by half a circle, when it is still to be tried.
    turned: Option<Grasp>,
    pending: VecDeque<FeasibleGrasp>,
    found: usize,
    rejections: GraspRejections,
    /// Openings (m) and configurations of grasps where something is in the way.
    blocked: Vec<(f64, Vec<f64>)>,
}

impl<I> FeasibleGrasps<'_, I> {
    /// What was refused so far, with the names of obstacles.
    pub fn rejections(&self) -> GraspRejections {
        let PickQuery { planner, settings, .. } = self.query;
        let allowed = match settings.object_clearance_m {
            Some(_) => self.query.without_object(),
            None => self.query.with_gripper_touching(),
        };
        let mut rejections = self.rejections.clone();
        for (opening_m, config) in &self.blocked {
            let checker = planner.checker(&self.query.empty_hand(&allowed, *opening_m), settings.clearance_m);
            if let Some(report) = checker.check(config) {
                rejections.count(&GraspRejection::Blocked { by: report.other });
            }
        }
        rejections
    }

    fn feasible(&mut self, grasp: &Grasp) -> Vec<FeasibleGrasp> {
        self.query.at(grasp).unwrap_or_else(|refusal| {
            match refusal {
                Refusal::Known(rejection) => self.rejections.count(&rejection),
                Refusal::Blocked { opening_m, config } => self.blocked.push((opening_m, config)),
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
    /// Whether the hand, pointing straight down, gets to a point of the world, turned about the vertical as it suits.
    ///
    /// A cheap test of goal poses, before there is a grasp.
    pub fn reaches_from_above(&self, point: DVec3) -> bool {
        let down = Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(std::f64::consts::PI) };
        (0..4).any(|turn| {
            let yaw = f64::from(turn) * std::f64::consts::FRAC_PI_4;
            let world_from_tcp = Pose::from_position_yaw(point, yaw) * down;
            self.ik_each(&world_from_tcp, &self.robot().home).next().is_some()
        })
    }
}
