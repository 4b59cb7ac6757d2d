//! What the numbers of an action mean.

mod contract;
mod encode;
mod gripper;
mod rotation;

pub use contract::ActionContract;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The contract of an action: motion first, then one number for the gripper; everything in radians and metres.
///
/// How long an action lasts is the rate of the policy, [`crate::PolicySpec::rate_hz`], and nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ActionSpec {
    /// Space of the motion.
    pub space: ActionSpace,
    /// What changes and speeds are counted from; absolute spaces do not read it.
    #[serde(default)]
    pub delta_from: DeltaFrom,
    /// Axes of end-effector motions; joint spaces do not read it.
    #[serde(default)]
    pub frame: ActionFrame,
    /// Encoding of the rotation in end-effector motions; joint spaces do not read it.
    #[serde(default)]
    pub rotation: RotationEncoding,
    /// The gripper.
    pub gripper: GripperSpec,
    /// What is commanded while the action lasts; speeds do not read it, they are a ramp.
    #[serde(default)]
    pub between: Between,
}

/// Space of the motion part of an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionSpace {
    /// Absolute joint targets, rad.
    JointPosition,
    /// Changes of the joint positions over the action, rad.
    JointDelta,
    /// Joint speeds during the action, rad/s.
    JointVelocity,
    /// Absolute pose of the tcp: position, then rotation.
    EePose,
    /// Change of the tcp's pose over the action: position, then rotation.
    EeDelta,
}

/// What changes and speeds are counted from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DeltaFrom {
    /// The command in force when the action begins; the robot's home before the first one. Changes of the tool are counted
    /// from the pose that the action before asked for, also where the arm is too slow to be there yet.
    #[default]
    Command,
    /// The joint positions measured when the action begins.
    Measured,
    /// The joint positions measured when the chunk was asked for.
    ChunkStart,
}

/// What is commanded at 60 Hz while an action of a lower rate lasts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Between {
    /// The action's joint targets and opening, from its beginning on.
    #[default]
    Hold,
    /// From the command in force when the action begins, joint targets and opening move evenly to those of the action,
    /// and reach them in its last control step.
    Linear,
}

/// Axes of end-effector motions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionFrame {
    /// The world, which is the robot's base: changes of position along its axes, rotations about them.
    #[default]
    World,
    /// The tcp that a change is counted from; only for changes.
    EndEffector,
}

/// Encoding of a rotation.
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

/// How the gripper's number is read.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GripperSpec {
    /// Range and polarity.
    pub encoding: GripperEncoding,
    /// For hands that only open and shut: above it the number counts as the upper end of its range, otherwise as the
    /// lower end; in the encoding's own unit.
    #[serde(default)]
    pub binary_threshold: Option<f64>,
}

/// Range and polarity of the gripper's number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GripperEncoding {
    /// Opening between the pads, metres: the native one.
    WidthM,
    /// 0 shut to 1 open.
    OpenFraction,
    /// 0 open to 1 shut, as in DROID.
    ClosedFraction,
    /// -1 shut to +1 open.
    PlusOneOpen,
    /// -1 open to +1 shut, as in robosuite and LIBERO.
    PlusOneClosed,
    /// 0 open to 255 shut, as of Robotiq hands.
    #[serde(rename = "closed_255")]
    Closed255,
}

/// Two contracts that are not the same.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what} of the action: expected {expected}, got {got}")]
pub struct ActionMismatch {
    /// What differs.
    pub what: &'static str,
    /// On the side that receives the action.
    pub expected: String,
    /// On the side that gives it.
    pub got: String,
}

impl ActionSpec {
    /// The native action: absolute joint targets and the gripper's opening width in metres.
    pub fn native() -> Self {
        Self::new(ActionSpace::JointPosition, GripperEncoding::WidthM)
    }

    /// A space and a gripper, the rest as by default.
    pub fn new(space: ActionSpace, gripper: GripperEncoding) -> Self {
        Self {
            space,
            delta_from: DeltaFrom::default(),
            frame: ActionFrame::default(),
            rotation: RotationEncoding::default(),
            gripper: GripperSpec { encoding: gripper, binary_threshold: None },
            between: Between::default(),
        }
    }

    /// Number of numbers, for an arm with `dof` joints.
    pub fn length(&self, dof: usize) -> usize {
        self.motion_length(dof) + 1
    }

    /// Number of numbers of the motion.
    pub fn motion_length(&self, dof: usize) -> usize {
        match self.space.is_joint() {
            true => dof,
            false => 3 + self.rotation.length(),
        }
    }

    /// Refuses a contract that contradicts itself.
    ///
    /// # Errors
    /// An absolute pose in the end effector's own frame, or a threshold that is not a number.
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

    /// Refuses actions that were made for another contract than this one; parts that are not read do not count.
    ///
    /// # Errors
    /// The first part that differs, both sides named.
    pub fn require_same(&self, given: &Self) -> Result<(), ActionMismatch> {
        let differs = |what, expected: String, got: String| {
            if expected == got { Ok(()) } else { Err(ActionMismatch { what, expected, got }) }
        };
        differs("space", name(&self.space), name(&given.space))?;
        if matches!(self.space, ActionSpace::JointDelta | ActionSpace::JointVelocity | ActionSpace::EeDelta) {
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
    /// Whether the motion is that of joints, not of the end effector.
    pub fn is_joint(self) -> bool {
        matches!(self, Self::JointPosition | Self::JointDelta | Self::JointVelocity)
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

/// The name in files.
fn name(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => name,
        Ok(serde_json::Value::Null) | Err(_) => "none".into(),
        Ok(other) => other.to_string(),
    }
}
