//! openpi's policy server: an observation goes out as MessagePack over a websocket, a chunk of actions comes back.
//!
//! Keys, sizes and meanings of the presets are those of `examples/droid` and `examples/libero` of
//! Physical-Intelligence/openpi; how far DROID's speeds and robosuite's changes go is said at the constants.

use std::fmt;
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{
    ActionChunk, ActionSpace, ActionSpec, CameraRequest, DeltaFrom, EpisodeStart, GripperEncoding, GripperSpec,
    ImageChannels, Observation, Policy, PolicyError, PolicySpec, RgbdImage, RobotModel, RotationEncoding,
};
use rmpv::Value;

use crate::connection::{Connection, Patience, RemoteError};
use crate::numpy::{Array, get};
use crate::picture::{Rgb, resized_with_pad};

/// Pictures of all presets, pixels each way.
const SIDE: usize = 224;
/// A speed of 1 in DROID: at most 0.2 rad per step at 15 Hz (`RobotIKSolver` of droid-dataset/droid), rad/s.
const DROID_RAD_S: f64 = 0.2 * 15.0;
/// A change of 1 in robosuite's operational space controller, as LIBERO sets it: metres.
const LIBERO_M: f64 = 0.05;
/// The same of rotations, rad.
const LIBERO_RAD: f64 = 0.5;
/// Most actions of a chunk.
const MOST_ACTIONS: usize = 1000;

/// What a server is shown and what its numbers mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// DROID: joint speeds, 15 Hz, eight actions of each chunk.
    Droid,
    /// DROID's checkpoints with joint positions, 15 Hz, eight actions of each chunk.
    DroidJointPosition,
    /// LIBERO: changes of the tool's pose, 20 Hz, five actions of each chunk.
    Libero,
}

impl Preset {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Droid, Self::DroidJointPosition, Self::Libero];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Droid => "droid",
            Self::DroidJointPosition => "droid_jointpos",
            Self::Libero => "libero",
        }
    }

    /// Actions per second.
    pub fn rate_hz(self) -> f64 {
        match self {
            Self::Droid | Self::DroidJointPosition => 15.0,
            Self::Libero => 20.0,
        }
    }

    /// Actions of a chunk that are executed before the next is asked for.
    pub fn execute_steps(self) -> usize {
        match self {
            Self::Droid | Self::DroidJointPosition => 8,
            Self::Libero => 5,
        }
    }

    /// What its actions mean, once they are in rad, m and s.
    pub fn action(self) -> ActionSpec {
        let droid = |space| ActionSpec {
            delta_from: DeltaFrom::Measured,
            gripper: GripperSpec { encoding: GripperEncoding::ClosedFraction, binary_threshold: Some(0.5) },
            ..ActionSpec::new(space, GripperEncoding::ClosedFraction)
        };
        match self {
            Self::Droid => droid(ActionSpace::JointVelocity),
            Self::DroidJointPosition => droid(ActionSpace::JointPosition),
            Self::Libero => ActionSpec {
                delta_from: DeltaFrom::Measured,
                rotation: RotationEncoding::AxisAngle,
                gripper: GripperSpec { encoding: GripperEncoding::PlusOneClosed, binary_threshold: Some(0.0) },
                ..ActionSpec::new(ActionSpace::EeDelta, GripperEncoding::PlusOneClosed)
            },
        }
    }

    /// An action of the server in the units of [`Preset::action`].
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

/// Which server is asked, and how.
#[derive(Clone, PartialEq)]
pub struct OpenpiSettings {
    /// Where it is, e.g. `ws://127.0.0.1:8000`.
    pub url: String,
    /// What it is shown.
    pub preset: Preset,
    /// The camera that stands beside the robot.
    pub exterior: String,
    /// The camera at the hand.
    pub wrist: String,
    /// Actions of a chunk that are executed; `None` as the preset says.
    pub execute_steps: Option<usize>,
    /// Sent as `Authorization: Api-Key …`; never shown.
    pub api_key: Option<String>,
    /// How long is waited.
    pub patience: Patience,
}

impl fmt::Debug for OpenpiSettings {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { url, preset, exterior, wrist, execute_steps, api_key: _, patience } = self;
        out.debug_struct("OpenpiSettings")
            .field("url", url)
            .field("preset", preset)
            .field("cameras", &(exterior, wrist))
            .field("execute_steps", execute_steps)
            .field("patience", patience)
            .finish_non_exhaustive()
    }
}

/// A policy behind openpi's protocol. One connection per episode; the protocol knows no episodes.
pub struct OpenpiPolicy {
    settings: OpenpiSettings,
    robot: Arc<RobotModel>,
    instruction: String,
    connection: Option<Connection>,
}

impl OpenpiPolicy {
    /// For a robot. Nothing is asked yet.
    pub fn new(settings: OpenpiSettings, robot: Arc<RobotModel>) -> Self {
        Self { settings, robot, instruction: String::new(), connection: None }
    }

    /// What is sent about an observation.
    fn question(&self, observation: &Observation) -> Result<Vec<u8>, PolicyError> {
        let unsuited = |what: String| PolicyError::Unsuited(what);
        let state = observation.state.get(Observation::STATE);
        let state = state.ok_or_else(|| unsuited(format!("needs `{}`", Observation::STATE)))?;
        let (arm, width_m) = state.split_at(self.robot.arm_dof().min(state.len()));
        let width_m: f64 = width_m.iter().sum();
        let picture = |camera: &str| {
            let image = observation.images.get(camera);
            image.map(|image| shown(image)).ok_or_else(|| unsuited(format!("needs the camera `{camera}`")))
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

    /// Servers like to quote what they were sent.
    fn without_key(&self, text: &str) -> String {
        match &self.settings.api_key {
            Some(key) if !key.is_empty() => text.replace(key.as_str(), "[key hidden]"),
            _ => text.to_owned(),
        }
    }

    /// Asks; a connection that is lost before the answer came is made again, since the protocol keeps no state.
    fn asked(&mut self, question: &[u8]) -> Result<Vec<Vec<f32>>, RemoteError> {
        let mut reconnects = 0;
        loop {
            let answer = self.tried(question);
            match answer {
                Err(RemoteError::Unreachable { .. }) if reconnects < self.settings.patience.reconnects => {
                    self.connection = None;
                    reconnects += 1;
                    std::thread::sleep(self.settings.patience.pause);
                }
                Err(error) => {
                    self.connection = None;
                    return Err(error);
                }
                Ok(actions) => return Ok(actions),
            }
        }
    }

    fn tried(&mut self, question: &[u8]) -> Result<Vec<Vec<f32>>, RemoteError> {
        let connection = match self.connection.take() {
            Some(connection) => connection,
            None => {
                let OpenpiSettings { url, api_key, patience, .. } = &self.settings;
                Connection::open(url, api_key.as_deref(), *patience)?.0
            }
        };
        let connection = self.connection.insert(connection);
        let answer = connection.ask(question)?;
        let length = self.settings.preset.action().length(self.robot.arm_dof());
        let rows = rows(&answer, length).map_err(|what| connection.wrong(what))?;
        Ok(rows.iter().map(|row| self.settings.preset.scaled(row)).collect())
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
        match self.asked(&question) {
            Ok(actions) => Ok(ActionChunk { actions, finished: false }),
            Err(error) => Err(PolicyError::Unreachable(self.without_key(&error.to_string()))),
        }
    }
}

/// The actions of an answer, row by row.
fn rows(answer: &Value, length: usize) -> Result<Vec<Vec<f64>>, String> {
    let actions = get(answer, "actions").ok_or("no `actions`")?;
    let actions = Array::read(actions).map_err(|what| format!("`actions` that are no array: {what}"))?;
    let [count, width] = actions.shape[..] else {
        return Err(format!("`actions` of shape {:?}, expected [horizon, {length}]", actions.shape));
    };
    if width != length || !(1..=MOST_ACTIONS).contains(&count) {
        return Err(format!("`actions` of shape {:?}, expected [1 to {MOST_ACTIONS}, {length}]", actions.shape));
    }
    let numbers = actions.reals();
    if let Some(place) = numbers.iter().position(|number| !number.is_finite()) {
        return Err(format!("`actions` with {} in row {}", numbers[place], place / width));
    }
    Ok(numbers.chunks_exact(width).map(<[f64]>::to_vec).collect())
}

/// A picture as models are shown it.
fn shown(image: &RgbdImage) -> Value {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let picture = resized_with_pad(&Rgb { width, height, bytes: image.rgb.clone() }, SIDE, SIDE);
    Array::picture(picture.width, picture.height, picture.bytes).value()
}

/// LIBERO's state of a robot: position of the tool, axis times angle of its rotation, both fingers; m and rad.
pub(crate) fn libero_state(robot: &RobotModel, state: &[f64]) -> Vec<f64> {
    let (arm, width_m) = state.split_at(robot.arm_dof().min(state.len()));
    let (tool, width_m) = (robot.tcp_pose(arm), width_m.iter().sum::<f64>());
    let turn = rotation_vector(tool.rotation);
    let fingers = [0.5 * width_m, -0.5 * width_m];
    tool.position.to_array().into_iter().chain(turn.to_array()).chain(fingers).collect()
}

/// Axis times angle of a rotation, at most pi long, rad.
fn rotation_vector(rotation: DQuat) -> DVec3 {
    let canonical = if rotation.w < 0.0 { -rotation } else { rotation };
    canonical.to_scaled_axis()
}
