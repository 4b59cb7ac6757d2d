//! Devices: their events decoded into six axes and the controls that are held or were pressed.
//!
//! Axes are those of an operator who stands behind the robot: forward, left, up, and right-handed rotations about these
//! (roll to the right, pitch forward, yaw to the left), each from -1 to 1.

mod decoder;
mod descriptor;
mod gamepad;
mod keyboard;
mod space_mouse;

pub use decoder::{Decoder, Goal, Reading};
pub use descriptor::ReportLayout;
pub use space_mouse::{SIX_AXIS_CONTROLLER, SPACE_NAVIGATOR};

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Number of axes: three of translation, then three of rotation.
pub const AXES: usize = 6;

/// Event as the device or the browser reports it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum DeviceEvent {
    /// A device was connected or reconnected: the state of the decoder starts anew.
    Connected {
        /// The device.
        device: Device,
    },
    /// HID input report with its id, if the device uses ids.
    Report {
        /// Bytes of the report.
        #[serde(with = "hex")]
        bytes: Vec<u8>,
    },
    /// State of a gamepad with the W3C Gamepad API's standard mapping.
    Gamepad {
        /// Left stick x and y, right stick x and y; x is right, y is down, -1 to 1.
        axes: Vec<f64>,
        /// Value of each button, 0 (released) to 1, in the order of the standard mapping.
        buttons: Vec<f64>,
    },
    /// State of a leader arm with the same joints as the robot.
    Joints {
        /// Joint positions, base to tip, rad.
        position_rad: Vec<f64>,
        /// Opening of its gripper, 0 (closed) to 1; absent without a gripper.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        gripper: Option<f64>,
        /// True while the leader arm is disengaged.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        clutch: bool,
    },
    /// Pose of a tracked thing, such as a phone.
    Pose {
        /// Position in the tracker's frame, m: x forward, y left, z up, as the operator sees the robot's world frame.
        position_m: [f64; 3],
        /// Unit quaternion, w first.
        orientation_wxyz: [f64; 4],
        /// Opening of the gripper, 0 (closed) to 1; absent without a control for it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        gripper: Option<f64>,
        /// True while the tracked thing is disengaged.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        clutch: bool,
    },
    /// Key that was pressed or released.
    Key {
        /// Physical key, as in `KeyboardEvent.code` of browsers, e.g. `KeyW`.
        code: String,
        /// True if pressed.
        down: bool,
    },
    /// Control that was pressed otherwise than on the device, such as with a button of the page.
    Pressed {
        /// The control.
        control: Control,
    },
    /// Heartbeat of a source whose device reports changes only, such as a keyboard.
    Alive,
    /// Silence of the source for too long by the wall clock: the arm holds until the next event of the device.
    Silent,
    /// Loss of the keyboard's focus: all keys count as released.
    Blurred,
    /// The device or its connection is gone.
    Disconnected,
}

/// A connected input device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Device {
    /// HID multi-axis controller, such as a SpaceMouse.
    SpaceMouse {
        /// Name of the product.
        name: String,
        /// Its HID report descriptor.
        #[serde(with = "hex")]
        descriptor: Vec<u8>,
    },
    /// Gamepad with the standard mapping.
    Gamepad {
        /// Name of the product.
        name: String,
    },
    /// Keyboard of the computer.
    Keyboard,
    /// Arm with the same joints as the robot, which it follows.
    LeaderArm {
        /// Name of the product.
        name: String,
    },
    /// Tracked thing, such as a phone.
    PoseTracker {
        /// Name of the product.
        name: String,
        /// True if its poses are those of the tool in the world frame; false if the tool makes the same motion, from
        /// where both were when the tracked thing was engaged.
        #[serde(default)]
        is_absolute: bool,
    },
}

impl Device {
    /// Name of the kind, as in files: `space_mouse`, `gamepad`, `keyboard`, `leader_arm` or `pose_tracker`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::SpaceMouse { .. } => "space_mouse",
            Self::Gamepad { .. } => "gamepad",
            Self::Keyboard => "keyboard",
            Self::LeaderArm { .. } => "leader_arm",
            Self::PoseTracker { .. } => "pose_tracker",
        }
    }
}

/// Function of a button or key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Control {
    /// Closes the open gripper, or opens the closed one.
    Gripper,
    /// Slows all motion while held.
    Precision,
    /// Clutch: disengages the device from the arm while held.
    Clutch,
    /// Changes to the next [`OperatorFrame`](crate::mapping::OperatorFrame).
    Frame,
    /// Ends the episode.
    Finish,
}

/// Reason why an event is refused; the state does not change.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum DeviceError {
    /// An invalid report descriptor.
    #[error("HID report descriptor, byte {at}: expected {expected}")]
    Descriptor {
        /// Byte offset of the item in the descriptor.
        at: usize,
        /// Expected content.
        expected: &'static str,
    },
    /// An input report without any byte.
    #[error("an empty HID input report")]
    EmptyReport,
    /// An input report in which the descriptor defines neither axes nor buttons.
    #[error("HID input report {id} has neither axes nor buttons")]
    UnknownReport {
        /// Id of the report; 0 for a device without report ids.
        id: u8,
    },
    /// An event of another kind of device than the connected one.
    #[error("a {got} event, but the connected device is {expected}")]
    OtherDevice {
        /// The connected kind, or `none`.
        expected: &'static str,
        /// Kind of the event.
        got: &'static str,
    },
    /// A state of a leader arm or tracker with a value that is not finite, or without a unit quaternion.
    #[error("expected finite numbers, and a unit quaternion in a pose")]
    Stream,
    /// A gamepad without the standard mapping, or with a value that is not finite.
    #[error(
        "gamepad: expected 4 axes and 16 or 17 buttons of the standard mapping, all finite; got {axes} and {buttons}"
    )]
    Gamepad {
        /// Number of axes in the event.
        axes: usize,
        /// Number of buttons in the event.
        buttons: usize,
    },
}

/// Bytes as hexadecimal text.
mod hex {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&genmanip_core::hexadecimal(bytes))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u8>, D::Error> {
        let text = String::deserialize(deserializer)?;
        let wrong = || D::Error::custom("expected an even number of hexadecimal digits");
        let digits = text.chars().map(|digit| digit.to_digit(16)).collect::<Option<Vec<_>>>().ok_or_else(wrong)?;
        if !digits.len().is_multiple_of(2) {
            return Err(wrong());
        }
        Ok(digits.chunks(2).map(|pair| (pair[0] * 16 + pair[1]) as u8).collect())
    }
}
