//! Defaults of the episode loop.

use genmanip_motion::IkSettings;
use serde::{Deserialize, Serialize};

/// Duration of an episode, and criteria for rest and disturbance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RolloutSettings {
    /// Time limit before settling, simulated seconds.
    pub horizon_s: f64,
    /// Time for which the last command is held before the goal is judged, seconds.
    pub settle_s: f64,
    /// Control steps between goal verdicts for `success_once`.
    pub judge_every: usize,
    /// Stop once the goal has held for `settle_s` at every verdict, instead of when the policy is finished.
    pub stop_on_success: bool,
    /// Stop at the first action whose pose is unreachable, instead of holding the command in force.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub stop_on_unreachable: bool,
    /// Inverse kinematics of end-effector actions.
    pub ik: IkSettings,
    /// Maximum speed of an object at rest, m/s.
    pub rest_speed: f64,
    /// Maximum angular speed of an object at rest, rad/s.
    pub rest_angular_speed: f64,
    /// Minimum displacement of a disturbed object, which the goal does not ask to move, metres.
    pub disturbed_m: f64,
    /// Minimum tilt of a disturbed object, radians.
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
