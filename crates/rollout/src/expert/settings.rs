//! Defaults of the expert.
//!
//! "Chosen" values were set by hand, tried on demonstrations of the example tasks and kept if failures decreased; they
//! are not fitted.

use genmanip_core::ExpertStyle;
use genmanip_layout::GoalPoseSettings;
use genmanip_layout::articulation::JointSettings;
use genmanip_motion::FeasibilitySettings;
use serde::{Deserialize, Serialize};

/// Settings of the expert's search and motions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExpertSettings {
    /// Style of choosing among several solutions of a task.
    #[serde(skip_serializing_if = "ExpertStyle::is_default")]
    pub style: ExpertStyle,
    /// Settings of the search for goal poses.
    pub goal_pose: GoalPoseSettings,
    /// Settings of grasp selection, and of the motions to pick and place an object.
    pub feasibility: FeasibilitySettings,
    /// Settings of contacts with joints and of the motions along them.
    pub joint: JointSettings,
    /// Maximum speed of the gripper while it moves a joint, m/s.
    pub joint_speed: f64,
    /// Control steps between checks of a joint motion.
    pub joint_steps: usize,
    /// Maximum distance by which the gripper may lag behind its command before a joint motion is aborted, metres; with
    /// the arm's stiffness this limits the force.
    pub joint_lag_m: f64,
    /// Maximum grasp candidates evaluated per pick.
    pub grasps: usize,
    /// Maximum picks per move before the expert gives up.
    pub tries_per_move: usize,
    /// Clearance at the pick if no grasp keeps `feasibility.clearance_m`, metres.
    pub tight_clearance_m: f64,
    /// Difference between the object's width and the width commanded while holding, metres; the smaller it is, the
    /// sooner the fingers release.
    pub squeeze_m: f64,
    /// Maximum release height above open surfaces, metres; cavities allow any height.
    pub max_open_release_m: f64,
    /// Height above the rim of the receiving object from which an object is lowered, metres, for robots with the reach of
    /// the default one.
    pub rim_clearance_m: f64,
    /// Share of the robot's velocity and acceleration limits with an empty gripper.
    pub empty_speed: f64,
    /// Share of the robot's velocity and acceleration limits with a held object.
    pub loaded_speed: f64,
    /// Share of the robot's velocity and acceleration limits for straight approach, lift, lowering and retreat.
    pub careful_speed: f64,
    /// Control steps for closing the gripper and building up force.
    pub close_steps: usize,
    /// Control steps for opening the gripper.
    pub open_steps: usize,
    /// Rate of change of the gripper opening that the gripper can always reach, m/s.
    pub fingers_m_s: f64,
    /// Speed below which an object counts as at rest, m/s.
    pub rest_speed: f64,
    /// Maximum waits of `rest_steps` for objects to come to rest before a pick.
    pub longest_wait: usize,
    /// Control steps for the arm to come to rest before the gripper moves.
    pub rest_steps: usize,
}

impl Default for ExpertSettings {
    fn default() -> Self {
        Self {
            style: ExpertStyle::Default,
            goal_pose: GoalPoseSettings::default(),
            feasibility: FeasibilitySettings::default(),
            joint: JointSettings::default(),
            // Chosen: avoids swinging doors and drawers open.
            joint_speed: 0.15,
            // A tenth of a second at 60 Hz: two to three time constants of the arm's drives (kv/kp, 0.03-0.044 s).
            joint_steps: 6,
            // Chosen by trials with blocked joints.
            joint_lag_m: 0.004,
            // All precomputed grasps (24 at most per object) and most of `GraspSettings::max_candidates` (64).
            grasps: 80,
            // Chosen: moves that failed four times kept failing.
            tries_per_move: 4,
            // Chosen, for flat objects, which are grasped close to the table.
            tight_clearance_m: 0.001,
            // Chosen: about twice `grip_force_n / grip_kp` (8 mm), at which the drive presses with full force.
            squeeze_m: 0.015,
            // Chosen: dropped from higher up, objects on an open surface topple or roll.
            max_open_release_m: 0.015,
            // Chosen: clearance for objects that hang askew in the gripper.
            rim_clearance_m: 0.03,
            // Chosen: fast in free space, slower with a held object, slowest near objects.
            empty_speed: 0.9,
            loaded_speed: 0.65,
            careful_speed: 0.5,
            // 0.6 s, the first half to close and the second to build up force; chosen.
            close_steps: 36,
            // As long as closing, so that the fingers have released before the gripper leaves.
            open_steps: 36,
            // Two fingers at 5 cm/s each according to the Franka Hand's data sheet, less a fifth for acceleration.
            fingers_m_s: 0.08,
            // Half of `RolloutSettings::rest_speed`, so that the judge agrees.
            rest_speed: 0.01,
            // Two seconds with `rest_steps`: the maximum settling time of a layout (`LayoutSettings::settle_s`).
            longest_wait: 20,
            // A tenth of a second at 60 Hz: two to three time constants of the arm's drives (kv/kp, 0.03-0.044 s).
            rest_steps: 6,
        }
    }
}
