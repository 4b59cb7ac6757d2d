//! Settings of a transfer with their defaults.

use serde::{Deserialize, Serialize};

use crate::fit::FitSettings;

/// Settings of a transfer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TransferSettings {
    /// Settings of the fit.
    pub fit: FitSettings,
    /// Attempts per move before the policy gives up.
    pub tries: usize,
    /// Fits, the best first, for which an approach is planned.
    pub fits: usize,
    /// Control rate, Hz.
    pub rate_hz: f64,
    /// Share of the robot's velocity and acceleration limits in free motion.
    pub free_speed: f64,
    /// Share of the robot's velocity limits near the object.
    pub careful_speed: f64,
    /// Largest speed of the hand near the object, m/s.
    pub hand_m_s: f64,
    /// Speed of the gripper's opening, m/s.
    pub gripper_m_s: f64,
    /// Distance of the measured from the commanded hand below which it has arrived, m.
    pub arrived_m: f64,
    /// Motion of the hand between two looks below which it is at rest, m.
    pub rest_m: f64,
    /// Control steps between two looks.
    pub look_steps: usize,
    /// Looks after which the hand has not arrived.
    pub max_looks: usize,
    /// Distance by which the hand may lag behind its command while it moves a joint, m; with the arm's stiffness it
    /// limits the force.
    pub lag_m: f64,
    /// Distance of the retreat where the source's is blocked, m.
    pub retreat_m: f64,
    /// False to move straight to the start of the skill in five steps, without the planner; for comparisons.
    pub plans_approach: bool,
    /// False to move the gripper without waiting for the hand; for comparisons.
    pub waits_for_hand: bool,
}

impl Default for TransferSettings {
    fn default() -> Self {
        Self {
            fit: FitSettings::default(),
            tries: 2,
            fits: 4,
            rate_hz: 60.0,
            free_speed: 0.9,
            careful_speed: 0.5,
            // As the expert's `joint_speed`.
            hand_m_s: 0.15,
            gripper_m_s: 0.08,
            arrived_m: 0.002,
            rest_m: 0.0003,
            look_steps: 3,
            // A second.
            max_looks: 20,
            // Twice the tracking lag at `hand_m_s`.
            lag_m: 0.012,
            retreat_m: 0.07,
            plans_approach: true,
            waits_for_hand: true,
        }
    }
}
