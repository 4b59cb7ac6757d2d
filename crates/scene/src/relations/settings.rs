//! Every threshold of the judges on one screen.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
