//! Settings of the episode loop with their defaults.

use genmanip_motion::IkSettings;
use serde::{Deserialize, Serialize};

/// Settings of the episode loop: duration, and criteria for rest and disturbance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RolloutSettings {
    /// Time limit before settling, simulated seconds.
    pub horizon_s: f64,
    /// Time for which the last command is held before the goal is judged, seconds.
    pub settle_s: f64,
    /// Control steps between goal verdicts for `success_once`.
    pub judge_every: usize,
    /// True to stop once the goal has held for `settle_s` at every verdict; false to stop when the policy is finished.
    pub stop_on_success: bool,
    /// True to stop at the first action whose pose is unreachable; false to hold the command in force.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub stop_on_unreachable: bool,
    /// Settings of the inverse kinematics for end-effector actions.
    pub ik: IkSettings,
    /// Speed below which an object counts as at rest, m/s.
    pub rest_speed: f64,
    /// Angular speed below which an object counts as at rest, rad/s.
    pub rest_angular_speed: f64,
    /// Displacement above which an object that the goal does not ask to move counts as disturbed, metres.
    pub disturbed_m: f64,
    /// Tilt above which such an object counts as disturbed, radians.
    pub disturbed_rad: f64,
}

impl Default for RolloutSettings {
    fn default() -> Self {
        Self {
            horizon_s: 120.0,
            settle_s: 1.0,
            judge_every: 12,
            stop_on_success: false,
            stop_on_unreachable: false,
            ik: IkSettings::default(),
            rest_speed: 0.02,
            rest_angular_speed: 0.4,
            disturbed_m: 0.05,
            disturbed_rad: 0.5,
        }
    }
}
