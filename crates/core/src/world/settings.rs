//! What the world's physics and its judges go by.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// How things move, whatever engine computes it; drives and pads are the robot's ([`crate::Drives`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhysicsSettings {
    /// Control steps per second, the rate of recording.
    pub control_rate_hz: u32,
    /// Physics steps per second; a whole multiple of the control rate.
    pub physics_rate_hz: u32,
    /// Downward acceleration, m/s².
    pub gravity_m_s2: f64,
    /// Turning (m) and rolling (m) friction of objects and fixed things; sliding friction is each thing's own.
    pub rotational_friction_m: [f64; 2],
    /// Factor of the sliding friction of the gripper's pads, which decides what slips; 1 is as the robot has it.
    #[serde(default = "usual", skip_serializing_if = "is_usual")]
    pub pad_friction: f64,
    /// Knobs of the physics engine's solver; the `sim` crate knows their names and refuses unknown and missing ones.
    pub engine: BTreeMap<String, Value>,
}

fn usual() -> f64 {
    1.0
}

#[expect(clippy::trivially_copy_pass_by_ref, clippy::float_cmp, reason = "what serde asks for; exactly the default")]
fn is_usual(factor: &f64) -> bool {
    *factor == usual()
}

impl PhysicsSettings {
    /// Physics steps in one control interval.
    pub fn substeps(&self) -> u32 {
        self.physics_rate_hz / self.control_rate_hz.max(1)
    }

    /// Length of a physics step, seconds.
    pub fn timestep_s(&self) -> f64 {
        1.0 / f64::from(self.physics_rate_hz)
    }

    /// Length of a control interval, seconds.
    pub fn control_period_s(&self) -> f64 {
        1.0 / f64::from(self.control_rate_hz)
    }
}

/// Thresholds of the relations; stored beside every verdict that was made with them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RelationSettings {
    /// Farthest distance between the projections of two objects that are close in the plane, metres.
    pub close_m: f64,
    /// Largest vertical gap between two objects that touch, metres.
    pub touching_gap_m: f64,
    /// How deep two objects may sink into each other and still count as one on the other, metres.
    pub sinking_m: f64,
    /// Share of an object's surface points that is more than this in a cavity: the object is inside.
    pub inside_share: f64,
    /// Share of an object's footprint over the other's that is more than this: supported.
    pub support_overlap: f64,
    /// Footprint of a supported object over that of its supporter, less than this.
    pub support_area_ratio: f64,
    /// Largest angle between the ways from one object to the middle one and on to the other, radians.
    pub between_angle_rad: f64,
    /// How far a joint may leave the interval of the state it was in before that state ends, share of the interval.
    pub state_hysteresis: f64,
    /// How far inside its limits a placement window stays, metres.
    pub window_margin_m: f64,
}

impl Default for RelationSettings {
    fn default() -> Self {
        Self {
            close_m: 0.15,                                  // published
            touching_gap_m: 0.02,                           // published evaluators use 0.10
            sinking_m: 0.005,                               // soft contacts sink less than a millimetre
            inside_share: 0.5,                              // published
            support_overlap: 0.7,                           // published
            support_area_ratio: 1.5,                        // published
            between_angle_rad: std::f64::consts::FRAC_PI_4, // published: 45 degrees
            state_hysteresis: 0.1,                          // a drawer that rattles does not flicker
            window_margin_m: 0.01,                          // a placement survives a settling of a centimetre
        }
    }
}
