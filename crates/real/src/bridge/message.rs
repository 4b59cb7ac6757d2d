//! Messages of the bridge's protocol; see `docs/formats/bridge.md`.

use serde::{Deserialize, Serialize};

use super::gripper::GripperState;
use super::guard::{Command, Refused, StopReason};
use super::interpolator::JointLimits;

/// Name and version of the protocol.
pub const PROTOCOL: &str = "genmanip.bridge/1";

/// Message to the bridge.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// First message of a connection; answered by [`Reply::Welcome`].
    Hello {
        /// [`PROTOCOL`].
        protocol: String,
        /// States per second that the client wants, Hz.
        state_rate_hz: f64,
    },
    /// Acquires the lease; answered by [`Reply::Lease`].
    Acquire {},
    /// Starts, or starts again after a stop; answered by [`Reply::Started`].
    Start {
        /// Number of the lease.
        lease: u64,
        /// True while a person holds the dead-man's switch.
        dead_man: bool,
        /// Share of the maximum speed, above 0 and at most 1.
        speed: f64,
        /// Two opposite corners of the box that the tool must not leave, m, in the robot's base frame; absent for none.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        workspace_m: Option<[[f64; 3]; 2]>,
    },
    /// Targets of the joints and the gripper; answered only if refused.
    Command(Command),
    /// Brakes, and returns the lease unless `keep`; answered by [`Reply::Released`].
    Release {
        /// Number of the lease.
        lease: u64,
        /// True to keep the lease.
        keep: bool,
    },
    /// Requests an image; answered by [`Reply::Image`].
    Image {
        /// Name of the camera.
        camera: String,
        /// Width and height that the client would like, pixels; the image may have another size.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        size: Option<[u32; 2]>,
    },
}

impl Request {
    /// Name of the message in the protocol.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Hello { .. } => "hello",
            Self::Acquire {} => "acquire",
            Self::Start { .. } => "start",
            Self::Command(_) => "command",
            Self::Release { .. } => "release",
            Self::Image { .. } => "image",
        }
    }

    /// True for messages of a stream, of which the next replaces a lost one.
    pub fn is_streamed(&self) -> bool {
        matches!(self, Self::Command(_))
    }
}

/// Message from the bridge.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Reply {
    /// Facts about the robot.
    Welcome(Welcome),
    /// The lease was acquired.
    Lease {
        /// Its number.
        lease: u64,
    },
    /// The arm follows commands from now on.
    Started {
        /// Time of the start on the bridge's clock, s.
        time_s: f64,
    },
    /// The arm brakes, and the lease was returned unless it was to be kept.
    Released,
    /// A request was refused; nothing changed.
    Refused {
        /// Name of the message.
        request: String,
        /// Sequence number of a command.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sequence: Option<u64>,
        /// Reason as a word, see [`Refused::word`].
        word: String,
        /// Reason as a sentence.
        message: String,
    },
    /// State of arm and gripper, sent at the rate of [`Request::Hello`].
    State(State),
    /// Head of an image; its bytes follow.
    Image(ImageHead),
}

impl Reply {
    /// Refusal of a request.
    pub fn refusal(request: &Request, why: &Refused) -> Self {
        let sequence = match request {
            Request::Command(command) => Some(command.sequence),
            _ => None,
        };
        Self::refused(request.name(), sequence, why)
    }

    /// Refusal of a line that is no request.
    pub fn malformed(why: String) -> Self {
        Self::refused("?", None, &Refused::Malformed(why))
    }

    fn refused(request: &str, sequence: Option<u64>, why: &Refused) -> Self {
        Self::Refused { request: request.into(), sequence, word: why.word().into(), message: why.to_string() }
    }

    /// True for messages of a stream, of which the next replaces a lost one.
    pub fn is_streamed(&self) -> bool {
        matches!(self, Self::State(_))
    }
}

/// Facts about the robot behind a bridge.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Welcome {
    /// [`PROTOCOL`].
    pub protocol: String,
    /// Name of the robot, such as `panda`.
    pub robot: String,
    /// Limits of the joints, base to hand.
    pub joints: Vec<JointLimits>,
    /// Largest opening width of the gripper, m; 0 without one.
    pub max_width_m: f64,
    /// Time between setpoints, s.
    pub tick_s: f64,
    /// Maximum validity of a command, s.
    pub longest_validity_s: f64,
    /// Time without a message from the holder after which the lease ends, s.
    pub lease_s: f64,
    /// Largest share of the maximum speed.
    pub top_speed: f64,
    /// Names of the cameras whose images the bridge sends.
    pub cameras: Vec<String>,
}

/// Head of an image. After its line come `3 * width * height` bytes of colour, row by row from the top left, then, if
/// `has_depth`, `4 * width * height` bytes of depth: little-endian 32-bit floats along the optical axis, m, 0 where
/// unknown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageHead {
    /// Name of the camera.
    pub camera: String,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// True if depth follows the colours.
    pub has_depth: bool,
    /// Time of the exposure on the bridge's clock, s.
    pub exposed_s: f64,
}

/// Image of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraImage {
    /// Camera, size and time.
    pub head: ImageHead,
    /// Colour, 8-bit sRGB, three bytes per pixel.
    pub rgb: Vec<u8>,
    /// Depth along the optical axis, m, 0 where unknown; empty without depth.
    pub depth_m: Vec<f32>,
}

/// Motion of the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// The arm follows commands.
    Following,
    /// The arm brakes.
    Braking,
    /// The arm stands still until it is started.
    Standing,
}

/// Progress of automatic recovery.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Recovery {
    /// The arm reports no error.
    #[default]
    None,
    /// The arm reports an error, which the bridge is clearing.
    Recovering,
    /// Recovery failed too often: a person must look after the arm.
    GivenUp,
}

/// State of arm and gripper.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Time at which the state was sent, on the bridge's clock, s.
    pub time_s: f64,
    /// Time at which it was measured, on the bridge's clock, s.
    pub measured_s: f64,
    /// Motion of the arm.
    pub motion: Motion,
    /// Reason why the arm brakes or stands; absent while it follows commands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<StopReason>,
    /// Error words of the arm, such as `cartesian_reflex`; empty without an error.
    pub errors: Vec<String>,
    /// Progress of automatic recovery.
    pub recovery: Recovery,
    /// Number of the lease in force.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lease: Option<u64>,
    /// Largest sequence number under that lease.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sequence: Option<u64>,
    /// Measured joint positions, rad or m.
    pub positions: Vec<f64>,
    /// Measured joint velocities, rad/s or m/s.
    pub velocities: Vec<f64>,
    /// Measured joint torques, N·m, or forces, N; empty if unknown.
    pub torques: Vec<f64>,
    /// Setpoints of the joints, rad or m.
    pub setpoints: Vec<f64>,
    /// State of the gripper; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gripper: Option<GripperState>,
}
