//! Joint paths and lazy collision checkers along them.

use std::cell::OnceCell;

use genmanip_motion::{AllowedCollisions, Checker, CollisionWorld, Planner, PlanningScene};

use super::Motion;

/// Clearance between robot and object during the motion, besides the gap at the contact (m). Chosen small, since the
/// gripper works at this distance.
const CONTACT_M: f64 = 0.0005;

/// Path of a joint to one target.
pub(super) struct JointPath {
    /// Target joint position [rad or m].
    pub target: f64,
    /// Motion of the moving link at the current joint position.
    pub motion: Motion,
    /// Joint displacements from the current position, each with the collision world of the object there; the first
    /// world includes everything else.
    pub worlds: Vec<(f64, CollisionWorld)>,
}

/// Collision checkers for one gripper opening.
pub(super) struct PathCheckers<'a> {
    planner: &'a Planner,
    no_contact: &'a AllowedCollisions,
    paths: &'a [JointPath],
    /// Collision world without the object, and the clearance to it (m).
    others: (&'a CollisionWorld, f64),
    /// Gripper opening (m).
    pub width: f64,
    with_clearance: OnceCell<Checker<'a>>,
    along: Vec<Vec<OnceCell<Checker<'a>>>>,
}

impl<'a> PathCheckers<'a> {
    pub fn new(
        planner: &'a Planner,
        no_contact: &'a AllowedCollisions,
        paths: &'a [JointPath],
        others: (&'a CollisionWorld, f64),
        width: f64,
    ) -> Self {
        let along = paths.iter().map(|path| path.worlds.iter().map(|_| OnceCell::new()).collect()).collect();
        Self { planner, no_contact, paths, others, width, with_clearance: OnceCell::new(), along }
    }

    /// True if the arm keeps its clearance to everything but the object itself.
    pub fn has_clearance(&self, config: &[f64]) -> bool {
        let (others, clearance_m) = self.others;
        self.with_clearance.get_or_init(|| self.checker(others, clearance_m)).is_free(config)
    }

    /// True if the gripper is collision-free at the start, which does not depend on the arm configuration.
    pub fn gripper_is_free(&self, config: &[f64]) -> bool {
        self.along(0, 0).gripper_is_free(config)
    }

    /// True if the arm does not touch the object at a step of a path, nor anything else at the first step.
    pub fn is_free(&self, path: usize, step: usize, config: &[f64]) -> bool {
        self.along(path, step).is_free(config)
    }

    fn along(&self, path: usize, step: usize) -> &Checker<'a> {
        self.along[path][step].get_or_init(|| self.checker(&self.paths[path].worlds[step].1, CONTACT_M))
    }

    fn checker(&self, world: &'a CollisionWorld, padding_m: f64) -> Checker<'a> {
        let around = PlanningScene { world, attached: None, allowed: self.no_contact, gripper_width: self.width };
        self.planner.checker(&around, padding_m)
    }
}
