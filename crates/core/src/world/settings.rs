//! Physics settings and relation thresholds of a world.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::named_enum;

/// Engine-independent physics settings; drives and pads belong to the robot ([`crate::Drives`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhysicsSettings {
    /// Control rate, which is also the recording rate, Hz.
    pub control_rate_hz: u32,
    /// Physics rate, Hz; a multiple of the control rate.
    pub physics_rate_hz: u32,
    /// Gravity, m/s², positive downwards.
    pub gravity_m_s2: f64,
    /// Torsional (m) and rolling (m) friction of objects and fixed bodies; sliding friction is set per object.
    pub rotational_friction_m: [f64; 2],
    /// Factor on the sliding friction of the gripper pads; 1 is the robot's own value.
    #[serde(default = "unit_factor", skip_serializing_if = "is_unit_factor")]
    pub pad_friction: f64,
    /// Joint dynamics of the arm, as identified on a real one; `None` for those of the robot's file, without latency.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arm: Option<ArmPhysics>,
    /// Solver settings of the physics engine; the `sim` crate rejects unknown and missing names.
    pub engine: BTreeMap<String, Value>,
}

/// Joint dynamics of an arm that replace those of the robot's file; a list is per joint, base to tip, and an empty one
/// leaves the robot's own values.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ArmPhysics {
    /// Position gains of the drives, N·m/rad.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub kp: Vec<f64>,
    /// Velocity gains of the drives, N·m·s/rad.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub kv: Vec<f64>,
    /// Viscous friction of the joints, N·m·s/rad.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub damping: Vec<f64>,
    /// Dry friction of the joints, N·m; 0 where the list is empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub friction_loss: Vec<f64>,
    /// Time from the stamp of a command to its effect on the drives, s. Without [`ArmPhysics`], drives lead their
    /// commands by one physics step.
    pub latency_s: f64,
}

impl ArmPhysics {
    /// Maximum latency, s: longer ones are mistakes of units or clocks.
    pub const MAX_LATENCY_S: f64 = 0.5;

    /// The lists with their names in files.
    pub fn lists(&self) -> [(&'static str, &[f64]); 4] {
        [("kp", &self.kp), ("kv", &self.kv), ("damping", &self.damping), ("friction_loss", &self.friction_loss)]
    }
}

fn unit_factor() -> f64 {
    1.0
}

#[expect(clippy::trivially_copy_pass_by_ref, clippy::float_cmp, reason = "what serde asks for; exactly the default")]
fn is_unit_factor(factor: &f64) -> bool {
    *factor == unit_factor()
}

impl PhysicsSettings {
    /// Number of physics steps per control step.
    pub fn substeps(&self) -> u32 {
        self.physics_rate_hz / self.control_rate_hz.max(1)
    }

    /// Physics time step, s.
    pub fn timestep_s(&self) -> f64 {
        1.0 / f64::from(self.physics_rate_hz)
    }

    /// Control period, s.
    pub fn control_period_s(&self) -> f64 {
        1.0 / f64::from(self.control_rate_hz)
    }
}

/// Thresholds of the relations; stored with every verdict.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RelationSettings {
    /// Largest distance between the projections of two objects that are close in the plane, metres.
    pub close_m: f64,
    /// Largest vertical gap between two touching objects, metres.
    pub touching_gap_m: f64,
    /// Largest penetration depth at which an object still counts as on another, metres.
    pub sinking_m: f64,
    /// Fraction of an object's surface points inside a cavity above which the object is *in* it.
    pub inside_share: f64,
    /// Fraction of an object's footprint over the other object above which it is supported.
    pub support_overlap: f64,
    /// Largest ratio of the footprints of a supported object and its supporter.
    pub support_area_ratio: f64,
    /// Largest angle by which the polyline from the first reference over the object to the second one bends at the
    /// object, radians.
    pub between_angle_rad: f64,
    /// Points between which `between_angle_rad` is measured; documents from before this key mean `space`.
    #[serde(default = "BetweenReading::of_old_documents", skip_serializing_if = "BetweenReading::is_of_old_documents")]
    pub between: BetweenReading,
    /// Distance by which a joint may leave its state's interval before the state ends, as a fraction of the interval.
    pub state_hysteresis: f64,
    /// Safety margin of placement windows inside their limits, metres.
    pub window_margin_m: f64,
}

named_enum! {
    /// Points that represent the three objects of *between*.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum BetweenReading {
        /// Centres projected onto the table: seen from above.
        Plane = "plane",
        /// Centres in space, as published: a tall object between two flat ones bends the polyline.
        Space = "space",
    }
}

impl BetweenReading {
    /// The only reading before documents had the key.
    pub fn of_old_documents() -> Self {
        Self::Space
    }

    /// True for [`Self::of_old_documents`], which is not written, so that hashes of old documents stay valid.
    pub fn is_of_old_documents(&self) -> bool {
        *self == Self::of_old_documents()
    }
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
            between: BetweenReading::Plane,                 // published: space, where the height of objects counts
            state_hysteresis: 0.1,                          // a rattling drawer does not flicker
            window_margin_m: 0.01,                          // a placement tolerates a shift of 1 cm while settling
        }
    }
}
