//! Every default of the expert on one screen.
//!
//! "Chosen" means: by hand, tried on demonstrations of the example tasks and kept when failures became fewer, not fitted.

use genmanip_layout::GoalPoseSettings;
use genmanip_layout::articulation::JointSettings;
use genmanip_motion::FeasibilitySettings;
use serde::{Deserialize, Serialize};

/// How the expert searches and moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExpertSettings {
    /// Goal poses.
    pub goal_pose: GoalPoseSettings,
    /// Grasps, and the motions to take and place an object.
    pub feasibility: FeasibilitySettings,
    /// Contacts with joints and how they are followed.
    pub joint: JointSettings,
    /// Greatest speed of the hand while it moves a joint, m/s.
    pub joint_speed: f64,
    /// Control steps after which the way of a joint is looked at.
    pub joint_steps: usize,
    /// How far the hand may lag behind its command before the motion of a joint is broken off, metres;
    /// with the arm's stiffness this limits the force.
    pub joint_lag_m: f64,
    /// Grasp candidates looked at per pick.
    pub grasps: usize,
    /// Picks tried per move before the expert gives up.
    pub tries_per_move: usize,
    /// Distance the robot makes do with where it takes an object when no grasp keeps `feasibility.clearance_m`, metres.
    pub tight_clearance_m: f64,
    /// How much narrower than the object the width is that is commanded while holding, metres;
    /// the less, the sooner the fingers let go.
    pub squeeze_m: f64,
    /// Greatest release height for objects that are set down on something open, metres; hollows allow all heights.
    pub max_open_release_m: f64,
    /// Height above the rim of what receives an object from which it is lowered, metres.
    pub rim_clearance_m: f64,
    /// Share of the robot's speed and acceleration limits with an empty hand.
    pub empty_speed: f64,
    /// Share of the robot's speed and acceleration limits with something in the hand.
    pub loaded_speed: f64,
    /// Share for straight approach, lift, lowering and retreat.
    pub careful_speed: f64,
    /// Control steps for closing the fingers and building up the grip.
    pub close_steps: usize,
    /// Control steps for opening the fingers.
    pub open_steps: usize,
    /// How fast the opening surely changes, m/s.
    pub fingers_m_s: f64,
    /// Above this speed an object is not at rest yet, m/s.
    pub rest_speed: f64,
    /// How often the expert waits `rest_steps` for things to come to rest before it picks all the same.
    pub longest_wait: usize,
    /// Control steps to wait for the arm to come to rest before the fingers move.
    pub rest_steps: usize,
}

impl Default for ExpertSettings {
    fn default() -> Self {
        Self {
            goal_pose: GoalPoseSettings::default(),
            feasibility: FeasibilitySettings::default(),
            joint: JointSettings::default(),
            // Chosen: doors and drawers are not thrown open.
            joint_speed: 0.15,
            // A tenth of a second at 60 Hz: two to three time constants of the arm's drives (kv/kp, 0.03-0.044 s).
            joint_steps: 6,
            // Chosen, on joints that something held back.
            joint_lag_m: 0.004,
            // All that were tried beforehand (24 at most per object) and most of `GraspSettings::max_candidates` (64).
            grasps: 80,
            // Chosen: what failed four times failed again.
            tries_per_move: 4,
            // Chosen, for flat things, which the fingers take close above the table.
            tight_clearance_m: 0.001,
            // Chosen: about twice `grip_force_n / grip_kp` (8 mm), at which the drive presses with all its force.
            squeeze_m: 0.015,
            // Chosen: from higher up things on an open surface tip over or roll.
            max_open_release_m: 0.015,
            // Chosen: room for what hangs askew in the hand.
            rim_clearance_m: 0.03,
            // Chosen: brisk where nothing can happen, slower where something could slip, slowest beside things.
            empty_speed: 0.9,
            loaded_speed: 0.65,
            careful_speed: 0.5,
            // 0.6 s, of which the first half closes and the second builds up the grip; chosen.
            close_steps: 36,
            // As long as closing, so that fingers that pressed have let go before the hand leaves.
            open_steps: 36,
            // Two fingers at 5 cm/s each, as in the Franka Hand's data sheet, less a fifth for starting.
            fingers_m_s: 0.08,
            // Half of `RolloutSettings::rest_speed`, so that the judge will call it at rest, too.
            rest_speed: 0.01,
            // Two seconds with `rest_steps`: as long as a layout settles at most (`LayoutSettings::settle_s`).
            longest_wait: 20,
            // A tenth of a second at 60 Hz: two to three time constants of the arm's drives (kv/kp, 0.03-0.044 s).
            rest_steps: 6,
        }
    }
}
