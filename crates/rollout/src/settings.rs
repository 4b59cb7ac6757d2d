//! Every default of the episode loop on one screen.

use genmanip_motion::IkSettings;
use serde::{Deserialize, Serialize};

/// How long an episode lasts and when the world counts as being at rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RolloutSettings {
    /// Longest simulated length before the settling, seconds.
    pub horizon_s: f64,
    /// Time the last command is held before the goal is judged, seconds.
    pub settle_s: f64,
    /// Control steps between two looks at the goal for `success_once`.
    pub judge_every: usize,
    /// Stop once the goal has held for `settle_s` at every look, instead of when the policy is finished.
    pub stop_on_success: bool,
    /// How poses in the actions of end-effector policies become joint targets.
    pub ik: IkSettings,
    /// Above this speed an object is moving, m/s.
    pub rest_speed: f64,
    /// Above this angular speed an object is moving, rad/s.
    pub rest_angular_speed: f64,
    /// An object the goal does not move was disturbed when it ends farther than this from where it was, metres.
    pub disturbed_m: f64,
    /// The same for its tilt, radians.
    pub disturbed_rad: f64,
}

impl Default for RolloutSettings {
    fn default() -> Self {
        Self {
            horizon_s: 120.0,
            settle_s: 1.0,
            judge_every: 12,
            stop_on_success: false,
            ik: IkSettings::default(),
            rest_speed: 0.02,
            rest_angular_speed: 0.4,
            disturbed_m: 0.05,
            disturbed_rad: 0.5,
        }
    }
}
