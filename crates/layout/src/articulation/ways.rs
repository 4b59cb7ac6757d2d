//! The ways of a joint to its targets, and the collision tests along them, each made once and only when asked for.

use std::cell::OnceCell;

use genmanip_motion::{Allowed, Checker, CollisionWorld, Planner, PlanningScene};

use super::Motion;

/// Distance between robot and object while it is moved, but for the gap at the contact itself, metres; chosen, since the
/// hand is meant to be this near.
const CONTACT_M: f64 = 0.0005;

/// The way of a joint to one target.
pub(super) struct Way {
    /// Position at which the joint is meant to end.
    pub target: f64,
    /// How its link moves.
    pub motion: Motion,
    /// By how much the joint has moved, with the object then; at present, first, with everything around it.
    pub worlds: Vec<(f64, CollisionWorld)>,
}

/// Collision tests of the robot with one opening of its gripper.
pub(super) struct Checkers<'a> {
    planner: &'a Planner,
    nothing: &'a Allowed,
    ways: &'a [Way],
    /// Everything but the object, and the distance the robot keeps from it, metres.
    others: (&'a CollisionWorld, f64),
    /// Opening of the gripper, metres.
    pub width: f64,
    roomy: OnceCell<Checker<'a>>,
    along: Vec<Vec<OnceCell<Checker<'a>>>>,
}

impl<'a> Checkers<'a> {
    pub fn new(
        planner: &'a Planner,
        nothing: &'a Allowed,
        ways: &'a [Way],
        others: (&'a CollisionWorld, f64),
        width: f64,
    ) -> Self {
        let along = ways.iter().map(|way| way.worlds.iter().map(|_| OnceCell::new()).collect()).collect();
        Self { planner, nothing, ways, others, width, roomy: OnceCell::new(), along }
    }

    /// Whether an arm keeps its distance from everything but the object.
    pub fn has_room(&self, config: &[f64]) -> bool {
        let (others, room_m) = self.others;
        self.roomy.get_or_init(|| self.checker(others, room_m)).is_free(config)
    }

    /// Whether the hand touches nothing at the start, which is the same for all arms that hold it there.
    pub fn hand_is_free(&self, config: &[f64]) -> bool {
        self.along(0, 0).hand_is_free(config)
    }

    /// Whether an arm touches the object at no point at a step of a way; at the first step nothing else either.
    pub fn is_free(&self, way: usize, step: usize, config: &[f64]) -> bool {
        self.along(way, step).is_free(config)
    }

    fn along(&self, way: usize, step: usize) -> &Checker<'a> {
        self.along[way][step].get_or_init(|| self.checker(&self.ways[way].worlds[step].1, CONTACT_M))
    }

    fn checker(&self, world: &'a CollisionWorld, padding_m: f64) -> Checker<'a> {
        let around = PlanningScene { world, attached: None, allowed: self.nothing, gripper_width: self.width };
        self.planner.checker(&around, padding_m)
    }
}
