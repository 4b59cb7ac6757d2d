//! Actions, rotations and rates that can be asked for by name.

use genmanip_core::{ActionSpace, ActionSpec, GripperEncoding, RotationEncoding};

use super::{ExtraColumns, default_action};

/// Actions by name.
pub const ACTIONS: [(&str, ActionSpace); 5] = [
    ("joint", ActionSpace::JointPosition),
    ("joint_delta", ActionSpace::JointDelta),
    ("joint_velocity", ActionSpace::JointVelocity),
    ("ee", ActionSpace::EePose),
    ("ee_delta", ActionSpace::EeDelta),
];

/// Rotations of end-effector actions by name; the first is the usual one, as it has no jumps.
pub const ROTATIONS: [(&str, RotationEncoding); 4] = [
    ("6d", RotationEncoding::SixD),
    ("quat", RotationEncoding::QuatWxyz),
    ("euler", RotationEncoding::FixedXyzEuler),
    ("axis_angle", RotationEncoding::AxisAngle),
];

/// Rows per second that can be asked for: divisors of the 60 Hz control rate.
pub const RATES: [u32; 5] = [10, 15, 20, 30, 60];

/// Columns on request by name.
pub const COLUMNS: [(&str, ExtraColumns); 3] =
    [("sim", ExtraColumns::Sim), ("boxes", ExtraColumns::Boxes), ("masks", ExtraColumns::Masks)];

/// The contract of an action: the opening in metres, and even motion from row to row.
pub fn action(space: ActionSpace, rotation: RotationEncoding) -> ActionSpec {
    ActionSpec {
        rotation,
        ..ActionSpec { between: default_action().between, ..ActionSpec::new(space, GripperEncoding::WidthM) }
    }
}

/// The name of an action, with its rotation if it has one: `joint_delta`, `ee-6d`.
pub fn action_name(spec: &ActionSpec) -> String {
    let space = ACTIONS.iter().find(|(_, space)| *space == spec.space).map_or("other", |(name, _)| *name);
    let rotation = ROTATIONS.iter().find(|(_, rotation)| *rotation == spec.rotation).map_or("other", |(name, _)| *name);
    if spec.space.is_joint() { space.into() } else { format!("{space}-{rotation}") }
}
