//! Action spaces, rotations, rates and extra columns by name.

use genmanip_core::{ActionSpace, ActionSpec, GripperEncoding, RotationEncoding};

use super::{ExtraColumns, default_action};

/// Action spaces by their names on the command line.
pub const ACTIONS: [(&str, ActionSpace); 6] = [
    ("joint", ActionSpace::JointPosition),
    ("joint_degrees", ActionSpace::JointDegrees),
    ("joint_delta", ActionSpace::JointDelta),
    ("joint_velocity", ActionSpace::JointVelocity),
    ("ee", ActionSpace::EePose),
    ("ee_delta", ActionSpace::EeDelta),
];

/// Rotation encodings of end-effector actions by name; the first is the default, because it is continuous.
pub const ROTATIONS: [(&str, RotationEncoding); 4] = [
    ("6d", RotationEncoding::SixD),
    ("quat", RotationEncoding::QuatWxyz),
    ("euler", RotationEncoding::FixedXyzEuler),
    ("axis_angle", RotationEncoding::AxisAngle),
];

/// Supported rows per second: divisors of the 60 Hz control rate.
pub const RATES: [u32; 5] = [10, 15, 20, 30, 60];

/// Optional columns by their names on the command line.
pub const COLUMNS: [(&str, ExtraColumns); 3] =
    [("sim", ExtraColumns::Sim), ("boxes", ExtraColumns::Boxes), ("masks", ExtraColumns::Masks)];

/// Action specification with linear interpolation between rows, and the gripper opening in metres, or in percent beside
/// joint targets in degrees.
pub fn action(space: ActionSpace, rotation: RotationEncoding) -> ActionSpec {
    let gripper = match space {
        ActionSpace::JointDegrees => GripperEncoding::OpenPercent,
        _ => GripperEncoding::WidthM,
    };
    ActionSpec { rotation, between: default_action().between, ..ActionSpec::new(space, gripper) }
}

/// Name of an action, with its rotation for end-effector actions: `joint_delta`, `ee-6d`.
pub fn action_name(spec: &ActionSpec) -> String {
    let space = ACTIONS.iter().find(|(_, space)| *space == spec.space).map_or("other", |(name, _)| *name);
    let rotation = ROTATIONS.iter().find(|(_, rotation)| *rotation == spec.rotation).map_or("other", |(name, _)| *name);
    if spec.space.is_joint() { space.into() } else { format!("{space}-{rotation}") }
}
