//! Action contract: space, frame, units and encoding of an action vector.

mod contract;
mod encode;
mod gripper;
mod rotation;

pub use contract::ActionContract;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Layout of an action vector: motion first, then one gripper value; radians and metres unless the space or the gripper
/// says otherwise.
///
/// The duration of an action is `1 / rate_hz` of the policy ([`crate::PolicySpec::rate_hz`]); nothing else sets it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ActionSpec {
    /// Space in which the motion is expressed.
    pub space: ActionSpace,
    /// Reference of deltas and velocities; ignored by absolute spaces.
    #[serde(default)]
    pub delta_from: DeltaFrom,
    /// Axes of end-effector motions; ignored by joint spaces.
    #[serde(default)]
    pub frame: ActionFrame,
    /// Encoding of the rotation in end-effector motions; ignored by joint spaces.
    #[serde(default)]
    pub rotation: RotationEncoding,
    /// Encoding of the gripper value.
    pub gripper: GripperSpec,
    /// Interpolation of the command during the action; ignored for joint velocities, whose targets always form a ramp.
    #[serde(default)]
    pub between: Interpolation,
}

/// Space of the motion part of an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionSpace {
    /// Absolute joint targets, rad.
    JointPosition,
    /// Absolute joint targets, degrees, as in LeRobot's drivers of arms with servo motors, such as the SO-101.
    JointDegrees,
    /// Joint displacement over the action, rad.
    JointDelta,
    /// Joint velocity during the action, rad/s.
    JointVelocity,
    /// Absolute TCP pose: position, then rotation.
    EePose,
    /// TCP displacement over the action: position, then rotation.
    EeDelta,
}

/// Reference of deltas and velocities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DeltaFrom {
    /// Command in force when the action begins (the home position before the first action). TCP deltas are relative to
    /// the pose that the previous action commanded, even if the arm has not reached it yet.
    #[default]
    Command,
    /// Joint positions measured when the action begins.
    Measured,
    /// Joint positions measured when the chunk was requested.
    ChunkStart,
}

/// Interpolation of the commands at the control rate within an action of a lower rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// Constant: the action's joint targets and opening width, from its start.
    #[default]
    Hold,
    /// Linear from the command in force when the action begins to the action's joint targets and opening width, which
    /// are reached in its last control step.
    Linear,
}

/// Axes of end-effector motions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionFrame {
    /// World (robot base): translation along its axes, rotation about them.
    #[default]
    World,
    /// TCP frame at the reference of the delta; valid for deltas only.
    EndEffector,
}

/// Encoding of a rotation in an action vector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RotationEncoding {
    /// Unit quaternion, w first.
    #[default]
    QuatWxyz,
    /// Unit quaternion, w last.
    QuatXyzw,
    /// First two columns of the rotation matrix (Zhou et al., 2019).
    #[serde(rename = "6d")]
    SixD,
    /// Angles about the fixed axes x, then y, then z, rad.
    FixedXyzEuler,
    /// Unit axis times angle, rad.
    AxisAngle,
}

/// Encoding of the gripper value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GripperSpec {
    /// Range and polarity of the gripper value.
    pub encoding: GripperEncoding,
    /// Threshold of a binary gripper, in the encoding's own unit: a value above it becomes the upper end of the range,
    /// any other value the lower end. `None` for a continuous gripper.
    #[serde(default)]
    pub binary_threshold: Option<f64>,
}

/// Range and polarity of the gripper value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GripperEncoding {
    /// Opening width between the pads, metres (the native encoding).
    WidthM,
    /// 0 closed to 1 open.
    OpenFraction,
    /// 0 open to 1 closed, as in DROID.
    ClosedFraction,
    /// 0 closed to 100 open, as in LeRobot's drivers.
    OpenPercent,
    /// -1 closed to +1 open.
    PlusOneOpen,
    /// -1 open to +1 closed, as in robosuite and LIBERO.
    PlusOneClosed,
    /// 0 open to 255 closed, as on Robotiq grippers.
    #[serde(rename = "closed_255")]
    Closed255,
}

/// Mismatch between two action contracts.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what} of the action: expected {expected}, got {got}")]
pub struct ActionMismatch {
    /// Name of the part that differs.
    pub what: &'static str,
    /// Value on the receiving side.
    pub expected: String,
    /// Value on the sending side.
    pub got: String,
}

impl ActionSpec {
    /// The native action: absolute joint targets and the gripper's opening width in metres.
    pub fn native() -> Self {
        Self::new(ActionSpace::JointPosition, GripperEncoding::WidthM)
    }

    /// An action spec with default reference, frame, rotation and interpolation.
    pub fn new(space: ActionSpace, gripper: GripperEncoding) -> Self {
        Self {
            space,
            delta_from: DeltaFrom::default(),
            frame: ActionFrame::default(),
            rotation: RotationEncoding::default(),
            gripper: GripperSpec { encoding: gripper, binary_threshold: None },
            between: Interpolation::default(),
        }
    }

    /// Length of the action vector for an arm with `dof` joints.
    pub fn length(&self, dof: usize) -> usize {
        self.motion_length(dof) + 1
    }

    /// Length of the motion part for an arm with `dof` joints.
    pub fn motion_length(&self, dof: usize) -> usize {
        match self.space.is_joint() {
            true => dof,
            false => 3 + self.rotation.length(),
        }
    }

    /// Rejects a contract that contradicts itself.
    ///
    /// # Errors
    /// For an absolute pose in the end-effector frame, or a threshold that is not finite.
    pub fn check(&self) -> Result<(), ActionMismatch> {
        if self.space == ActionSpace::EePose && self.frame == ActionFrame::EndEffector {
            return Err(ActionMismatch {
                what: "frame",
                expected: "world for ee_pose".into(),
                got: "end_effector".into(),
            });
        }
        match self.gripper.binary_threshold.filter(|threshold| !threshold.is_finite()) {
            Some(threshold) => Err(ActionMismatch {
                what: "gripper threshold",
                expected: "a finite number".into(),
                got: threshold.to_string(),
            }),
            None => Ok(()),
        }
    }

    /// Rejects actions made for a different contract; parts that the space ignores are not compared.
    ///
    /// # Errors
    /// The first part that differs, with both values.
    pub fn require_same(&self, given: &Self) -> Result<(), ActionMismatch> {
        let differs = |what, expected: String, got: String| {
            if expected == got { Ok(()) } else { Err(ActionMismatch { what, expected, got }) }
        };
        differs("space", name(&self.space), name(&given.space))?;
        if !self.space.is_absolute() {
            differs("reference", name(&self.delta_from), name(&given.delta_from))?;
        }
        if !self.space.is_joint() {
            differs("frame", name(&self.frame), name(&given.frame))?;
            differs("rotation", name(&self.rotation), name(&given.rotation))?;
        }
        differs("gripper", name(&self.gripper.encoding), name(&given.gripper.encoding))?;
        differs("gripper threshold", name(&self.gripper.binary_threshold), name(&given.gripper.binary_threshold))?;
        match self.space {
            ActionSpace::JointVelocity => Ok(()),
            _ => differs("motion between actions", name(&self.between), name(&given.between)),
        }
    }
}

impl ActionSpace {
    /// True for joint-space motions, false for end-effector motions.
    pub fn is_joint(self) -> bool {
        matches!(self, Self::JointPosition | Self::JointDegrees | Self::JointDelta | Self::JointVelocity)
    }

    /// True for spaces whose actions name a goal by themselves, false for changes and velocities.
    pub fn is_absolute(self) -> bool {
        matches!(self, Self::JointPosition | Self::JointDegrees | Self::EePose)
    }
}

impl std::fmt::Display for ActionSpec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&name(&self.space))?;
        if !self.space.is_joint() {
            write!(f, " in the {} frame with {}", name(&self.frame), name(&self.rotation))?;
        }
        write!(f, ", gripper {}", name(&self.gripper.encoding))
    }
}

/// The serialised name of an enum value.
fn name(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => name,
        Ok(serde_json::Value::Null) | Err(_) => "none".into(),
        Ok(other) => other.to_string(),
    }
}
