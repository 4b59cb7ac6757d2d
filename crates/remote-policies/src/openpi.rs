//! Client of openpi's policy server, which receives an observation as MessagePack over a WebSocket and returns an
//! action chunk.
//!
//! Keys, sizes and formats of the presets follow `examples/droid` and `examples/libero` of
//! Physical-Intelligence/openpi; scales of DROID velocities and robosuite deltas are documented at the constants.

use std::fmt;
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{
    ActionChunk, ActionSpace, ActionSpec, CameraRequest, DeltaFrom, EpisodeStart, GripperEncoding, GripperSpec,
    ImageChannels, Interpolation, Observation, Policy, PolicyError, PolicySpec, RgbdImage, RobotModel,
    RotationEncoding,
};
use rmpv::Value;

use crate::connection::{Connection, RemoteError, Timeouts};
use crate::numpy::{Array, get};
use crate::resize::{Rgb, resized_with_pad};

/// Image size of all presets (px).
const SIDE: usize = 224;
/// Joint velocity of a DROID action of 1 [rad/s]: at most 0.2 rad per step at 15 Hz (`RobotIKSolver` of
/// droid-dataset/droid).
const DROID_RAD_S: f64 = 0.2 * 15.0;
/// Position delta of an action of 1 in robosuite's operational space controller with LIBERO's settings (m).
const LIBERO_M: f64 = 0.05;
/// Rotation delta of such an action of 1 (rad).
const LIBERO_RAD: f64 = 0.5;
/// Maximum actions of a chunk. Bounds memory for invalid responses.
const MAX_ACTIONS: usize = 1000;

/// Observation and action format of a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// DROID: joint velocities at 15 Hz, eight actions of each chunk.
    Droid,
    /// DROID checkpoints with joint positions at 15 Hz, eight actions of each chunk.
    DroidJointPosition,
    /// LIBERO: TCP pose deltas at 20 Hz, five actions of each chunk.
    Libero,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 3] = [Self::Droid, Self::DroidJointPosition, Self::Libero];

    /// Name of the preset in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Droid => "droid",
            Self::DroidJointPosition => "droid_jointpos",
            Self::Libero => "libero",
        }
    }

    /// Rate of the actions (Hz).
    pub fn rate_hz(self) -> f64 {
        match self {
            Self::Droid | Self::DroidJointPosition => 15.0,
            Self::Libero => 20.0,
        }
    }

    /// Actions of a chunk executed before the next request.
    pub fn execute_steps(self) -> usize {
        match self {
            Self::Droid | Self::DroidJointPosition => 8,
            Self::Libero => 5,
        }
    }

    /// Action format after scaling to rad, m and s.
    pub fn action(self) -> ActionSpec {
        let droid = |space| ActionSpec {
            delta_from: DeltaFrom::Measured,
            gripper: GripperSpec { encoding: GripperEncoding::ClosedFraction, binary_threshold: Some(0.5) },
            ..ActionSpec::new(space, GripperEncoding::ClosedFraction)
        };
        match self {
            Self::Droid => droid(ActionSpace::JointVelocity),
            Self::DroidJointPosition => droid(ActionSpace::JointPosition),
            // Held targets would make a stiff arm overshoot the changes and turn by its tracking error.
            Self::Libero => ActionSpec {
                delta_from: DeltaFrom::Measured,
                between: Interpolation::Linear,
                rotation: RotationEncoding::AxisAngle,
                gripper: GripperSpec { encoding: GripperEncoding::PlusOneClosed, binary_threshold: Some(0.0) },
                ..ActionSpec::new(ActionSpace::EeDelta, GripperEncoding::PlusOneClosed)
            },
        }
    }

    /// Scales a server action to the units of [`Preset::action`].
    pub(crate) fn scaled(self, action: &[f64]) -> Vec<f32> {
        let unit = |number: f64| number.clamp(-1.0, 1.0);
        let (gripper, motion) = match action.split_last() {
            Some((gripper, motion)) => (*gripper, motion),
            None => return Vec::new(),
        };
        let motion: Vec<f64> = match self {
            Self::Droid => motion.iter().map(|&speed| unit(speed) * DROID_RAD_S).collect(),
            Self::DroidJointPosition => motion.to_vec(),
            Self::Libero => {
                let scale = |index| if index < 3 { LIBERO_M } else { LIBERO_RAD };
                motion.iter().enumerate().map(|(index, &change)| unit(change) * scale(index)).collect()
            }
        };
        motion.into_iter().chain([gripper]).map(|number| number as f32).collect()
    }
}

/// Address, format and cameras of an openpi policy server.
#[derive(Clone, PartialEq)]
pub struct OpenpiSettings {
    /// Server URL, e.g. `ws://127.0.0.1:8000`.
    pub url: String,
    /// Observation and action format.
    pub preset: Preset,
    /// Name of the exterior camera.
    pub exterior: String,
    /// Name of the wrist camera.
    pub wrist: String,
    /// Executed actions per chunk; `None` for the preset's.
    pub execute_steps: Option<usize>,
    /// API key, sent as `Authorization: Api-Key …`; never displayed. `None` for servers without authentication.
    pub api_key: Option<String>,
    /// Timeouts and reconnects of the connection.
    pub timeouts: Timeouts,
}

impl fmt::Debug for OpenpiSettings {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { url, preset, exterior, wrist, execute_steps, api_key: _, timeouts } = self;
        out.debug_struct("OpenpiSettings")
            .field("url", url)
            .field("preset", preset)
            .field("cameras", &(exterior, wrist))
            .field("execute_steps", execute_steps)
            .field("timeouts", timeouts)
            .finish_non_exhaustive()
    }
}

/// A policy behind openpi's protocol, with one connection per episode; the protocol has no episodes.
pub struct OpenpiPolicy {
    settings: OpenpiSettings,
    robot: Arc<RobotModel>,
    instruction: String,
    connection: Option<Connection>,
}

impl OpenpiPolicy {
    /// Creates a policy for a robot without connecting.
    pub fn new(settings: OpenpiSettings, robot: Arc<RobotModel>) -> Self {
        Self { settings, robot, instruction: String::new(), connection: None }
    }

    /// Encodes the request for an observation.
    fn question(&self, observation: &Observation) -> Result<Vec<u8>, PolicyError> {
        let unsuited = |what: String| PolicyError::Unsuited(what);
        let state = observation.state.get(Observation::STATE);
        let state = state.ok_or_else(|| unsuited(format!("needs `{}`", Observation::STATE)))?;
        let (arm, width_m) = state.split_at(self.robot.arm_dof().min(state.len()));
        let width_m: f64 = width_m.iter().sum();
        let picture = |camera: &str| {
            let image = observation.images.get(camera);
            image.map(|image| encoded_image(image)).ok_or_else(|| unsuited(format!("needs the camera `{camera}`")))
        };
        let (exterior, wrist) = (picture(&self.settings.exterior)?, picture(&self.settings.wrist)?);
        let entries: Vec<(&str, Value)> = match self.settings.preset {
            Preset::Droid | Preset::DroidJointPosition => {
                let closed = (1.0 - width_m / self.robot.gripper.max_width).clamp(0.0, 1.0);
                vec![
                    ("observation/exterior_image_1_left", exterior),
                    ("observation/wrist_image_left", wrist),
                    ("observation/joint_position", Array::vector(arm.iter().copied()).value()),
                    ("observation/gripper_position", Array::vector([closed]).value()),
                ]
            }
            Preset::Libero => {
                vec![
                    ("observation/image", exterior),
                    ("observation/wrist_image", wrist),
                    ("observation/state", Array::vector(libero_state(&self.robot, state)).value()),
                ]
            }
        };
        let prompt = ("prompt", Value::from(self.instruction.as_str()));
        let map = entries.into_iter().chain([prompt]).map(|(key, value)| (Value::from(key), value)).collect();
        let mut bytes = Vec::new();
        rmpv::encode::write_value(&mut bytes, &Value::Map(map)).map_err(|error| unsuited(error.to_string()))?;
        Ok(bytes)
    }

    /// Redacts the API key, which servers may echo.
    fn without_key(&self, text: &str) -> String {
        match &self.settings.api_key {
            Some(key) if !key.is_empty() => text.replace(key.as_str(), "[key hidden]"),
            _ => text.to_owned(),
        }
    }

    /// Requests actions; reconnects after a lost connection, since the protocol is stateless.
    fn actions_with_reconnects(&mut self, question: &[u8]) -> Result<Vec<Vec<f32>>, RemoteError> {
        let mut reconnects = 0;
        loop {
            let answer = self.try_actions(question);
            match answer {
                Err(RemoteError::Unreachable { .. }) if reconnects < self.settings.timeouts.reconnects => {
                    self.connection = None;
                    reconnects += 1;
                    std::thread::sleep(self.settings.timeouts.pause);
                }
                Err(error) => {
                    self.connection = None;
                    return Err(error);
                }
                Ok(actions) => return Ok(actions),
            }
        }
    }

    fn try_actions(&mut self, question: &[u8]) -> Result<Vec<Vec<f32>>, RemoteError> {
        let connection = match self.connection.take() {
            Some(connection) => connection,
            None => {
                let OpenpiSettings { url, api_key, timeouts, .. } = &self.settings;
                Connection::open(url, api_key.as_deref(), *timeouts)?.0
            }
        };
        let connection = self.connection.insert(connection);
        let answer = connection.request(question)?;
        chunk(&answer, self.settings.preset, self.robot.arm_dof()).map_err(|what| connection.wrong(what))
    }
}

impl Policy for OpenpiPolicy {
    fn spec(&self) -> PolicySpec {
        let OpenpiSettings { preset, exterior, wrist, execute_steps, .. } = &self.settings;
        let camera = |name: &String| CameraRequest::new(name, ImageChannels::RGB);
        PolicySpec {
            name: "openpi".into(),
            cameras: vec![camera(exterior), camera(wrist)],
            action: preset.action(),
            rate_hz: preset.rate_hz(),
            execute_steps: execute_steps.unwrap_or(preset.execute_steps()),
            ..PolicySpec::native("openpi", preset.rate_hz())
        }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.instruction.clone_from(&start.instruction);
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let question = self.question(observation)?;
        match self.actions_with_reconnects(&question) {
            Ok(actions) => Ok(ActionChunk { actions, finished: false }),
            Err(error) => Err(PolicyError::Unreachable(self.without_key(&error.to_string()))),
        }
    }
}

/// Actions of a response, in the units of [`Preset::action`], for an arm with `arm_dof` joints.
///
/// # Errors
/// Describes the problem.
pub fn chunk(answer: &Value, preset: Preset, arm_dof: usize) -> Result<Vec<Vec<f32>>, String> {
    let rows = rows(answer, preset.action().length(arm_dof))?;
    Ok(rows.iter().map(|row| preset.scaled(row)).collect())
}

/// Action rows of a response.
fn rows(answer: &Value, length: usize) -> Result<Vec<Vec<f64>>, String> {
    let actions = get(answer, "actions").ok_or("no `actions`")?;
    let actions = Array::read(actions).map_err(|what| format!("invalid `actions`: {what}"))?;
    let [count, width] = actions.shape[..] else {
        return Err(format!("`actions` of shape {:?}, expected [horizon, {length}]", actions.shape));
    };
    if width != length || !(1..=MAX_ACTIONS).contains(&count) {
        return Err(format!("`actions` of shape {:?}, expected [1 to {MAX_ACTIONS}, {length}]", actions.shape));
    }
    let numbers = actions.reals();
    if let Some(place) = numbers.iter().position(|number| !number.is_finite()) {
        return Err(format!("`actions` with {} in row {}", numbers[place], place / width));
    }
    Ok(numbers.chunks_exact(width).map(<[f64]>::to_vec).collect())
}

/// Encodes an image at the models' input size.
fn encoded_image(image: &RgbdImage) -> Value {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let picture = resized_with_pad(&Rgb { width, height, bytes: image.rgb.clone() }, SIDE, SIDE);
    Array::picture(picture.width, picture.height, picture.bytes).value()
}

/// LIBERO's robot state: TCP position, rotation vector, both finger positions [m and rad].
pub(crate) fn libero_state(robot: &RobotModel, state: &[f64]) -> Vec<f64> {
    let (arm, width_m) = state.split_at(robot.arm_dof().min(state.len()));
    let (tool, width_m) = (robot.tcp_pose(arm), width_m.iter().sum::<f64>());
    let turn = rotation_vector(tool.rotation);
    let fingers = [0.5 * width_m, -0.5 * width_m];
    tool.position.to_array().into_iter().chain(turn.to_array()).chain(fingers).collect()
}

/// Rotation vector (axis times angle) with an angle of at most pi (rad).
fn rotation_vector(rotation: DQuat) -> DVec3 {
    let canonical = if rotation.w < 0.0 { -rotation } else { rotation };
    canonical.to_scaled_axis()
}
