//! Every default of the expert on one screen.

use genmanip_layout::GoalPoseSettings;
use genmanip_layout::articulation::JointSettings;
use serde::{Deserialize, Serialize};

/// How the expert searches and moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExpertSettings {
    /// Goal poses.
    pub goal_pose: GoalPoseSettings,
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
    /// Grasps for which motions are planned before a pick is given up.
    pub planned_grasps: usize,
    /// Picks tried per move before the expert gives up.
    pub tries_per_move: usize,
    /// How far before the grasp the straight approach starts, metres.
    pub approach_m: f64,
    /// How far a grasped object is lifted straight up, metres.
    pub lift_m: f64,
    /// Room the open fingers leave on both sides together, metres.
    pub finger_clearance_m: f64,
    /// How much narrower than the object the width is that is commanded while holding, metres;
    /// the less, the sooner the fingers let go.
    pub squeeze_m: f64,
    /// Heights above the resting place at which the object may be released, metres, lowest first.
    pub release_heights_m: Vec<f64>,
    /// Greatest of these for objects that are set down on something open, metres; hollows allow all.
    pub max_open_release_m: f64,
    /// Share of the robot's speed and acceleration limits with an empty hand.
    pub empty_speed: f64,
    /// Share of the robot's speed and acceleration limits with something in the hand.
    pub loaded_speed: f64,
    /// Share for the last straight centimetres.
    pub careful_speed: f64,
    /// Control steps for closing the fingers and building up the grip.
    pub close_steps: usize,
    /// Control steps for opening the fingers.
    pub open_steps: usize,
    /// Above this speed an object is not at rest yet, m/s.
    pub rest_speed: f64,
    /// How often the expert waits `rest_steps` for things to come to rest before it picks all the same.
    pub longest_wait: usize,
    /// Distance the hand keeps from everything but the object where it takes it or lets go, and the one it makes do
    /// with when nothing else works, metres.
    pub hand_clearances_m: [f64; 2],
    /// Distance the open fingers keep from the object itself, metres.
    pub object_clearance_m: f64,
    /// Control steps to wait for the arm to come to rest before the fingers move.
    pub rest_steps: usize,
}

impl Default for ExpertSettings {
    fn default() -> Self {
        Self {
            goal_pose: GoalPoseSettings::default(),
            joint: JointSettings::default(),
            joint_speed: 0.15,
            joint_steps: 6,
            joint_lag_m: 0.004,
            grasps: 80,
            planned_grasps: 12,
            tries_per_move: 4,
            approach_m: 0.09,
            lift_m: 0.10,
            finger_clearance_m: 0.024,
            squeeze_m: 0.015,
            release_heights_m: vec![0.003, 0.015, 0.03, 0.05, 0.08, 0.12],
            max_open_release_m: 0.015,
            empty_speed: 0.9,
            loaded_speed: 0.65,
            careful_speed: 0.5,
            close_steps: 36,
            open_steps: 36,
            rest_speed: 0.01,
            longest_wait: 20,
            hand_clearances_m: [0.003, 0.001],
            object_clearance_m: 0.0005,
            rest_steps: 6,
        }
    }
}
