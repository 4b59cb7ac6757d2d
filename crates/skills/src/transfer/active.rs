//! Phases of a transfer, and the skill in use.

use genmanip_core::Pose;

use crate::fit::Fit;
use crate::skill::Grip;

/// Stage of a transfer.
pub(super) enum Phase {
    /// Looks for the next move.
    Free,
    /// Waits until the hand has arrived at the contact: looks so far, and the hand's pose at the last one.
    Arriving(Box<Active>, usize, Option<Pose>),
    /// Closes the gripper: control steps so far, and for how many of them it has pressed.
    Closing(Box<Active>, usize, usize),
    /// Moves the joint: commands, and how many have been given.
    Moving(Box<Active>, Vec<Vec<f32>>, usize),
    /// Waits until the hand is at rest before it releases, as in `Arriving`.
    Stopping(Box<Active>, usize, Option<Pose>),
    /// Has returned its last commands.
    Done,
}

/// The skill in use.
#[derive(Clone)]
pub(super) struct Active {
    pub object: usize,
    pub fit: Fit,
    pub grip: Grip,
    /// Opening commanded while holding, m.
    pub held_m: f64,
    /// Arm configuration that was commanded last, rad.
    pub commanded: Vec<f64>,
    /// Goals of the object in the hand; `None` for a joint, and once the object is there.
    pub carry: Option<Carry>,
}

/// An object in the hand, and where it can be put down.
#[derive(Clone)]
pub(super) struct Carry {
    /// Index of the skill.
    pub skill: usize,
    /// True if the fingers are exchanged.
    pub turned: bool,
    /// Goal poses, `world_from_object`, the best first.
    pub goals: Vec<Pose>,
}

/// State of the robot and of what it holds at a look.
#[derive(Clone, Copy)]
pub(super) struct Look<'a> {
    /// Arm configuration, rad.
    pub arm: &'a [f64],
    /// Opening of the gripper, m.
    pub width: f64,
    /// Object that both fingers press on.
    pub grasped: Option<usize>,
}
