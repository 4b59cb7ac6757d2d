//! Client of vla-eval's model servers (allenai/vla-evaluation-harness), which receive one observation and return one
//! action or a chunk.
//!
//! A message is a MessagePack map of `type`, `payload`, `seq` and `timestamp`. Both sides start with `hello`;
//! `episode_start` and `episode_end` enclose the observations of an episode. The server ties episode state to the
//! connection, so a lost connection ends the episode, which is then not run.

use std::sync::Arc;

use genmanip_core::{
    ActionChunk, ActionSpec, CameraRequest, EpisodeStart, ImageChannels, Observation, Policy, PolicyError, PolicySpec,
    RobotModel,
};
use rmpv::Value;

use crate::connection::{Connection, RemoteError, Timeouts};
use crate::numpy::{Array, get};
use crate::openpi::{self, libero_state};

/// Version of the protocol that this client speaks.
const PROTOCOL: u64 = 1;
/// Image size (px), as the harness renders LIBERO.
const SIDE: u32 = 256;

/// Observation and action format of a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// LIBERO: TCP pose deltas at 20 Hz; images `agentview` and `wrist`; 8 state values.
    Libero,
    /// Joint targets (rad) and gripper opening (m) at 15 Hz; images named by their cameras; joint positions and opening
    /// as state. For servers trained on this robot.
    Joint,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 2] = [Self::Libero, Self::Joint];

    /// Name of the preset in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Libero => "libero",
            Self::Joint => "joint",
        }
    }

    /// Rate of the actions (Hz).
    pub fn rate_hz(self) -> f64 {
        match self {
            Self::Libero => openpi::Preset::Libero.rate_hz(),
            Self::Joint => 15.0,
        }
    }

    /// Action format after scaling to rad and m.
    pub fn action(self) -> ActionSpec {
        match self {
            Self::Libero => openpi::Preset::Libero.action(),
            Self::Joint => ActionSpec::native(),
        }
    }

    /// Expected action formats in the server's `action_spec`, in the harness's terms.
    fn formats(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Libero => {
                &[("position", "delta_xyz"), ("rotation", "axis_angle"), ("gripper", "binary_close_positive")]
            }
            Self::Joint => &[],
        }
    }

    fn scaled(self, action: &[f64]) -> Vec<f32> {
        match self {
            Self::Libero => openpi::Preset::Libero.scaled(action),
            Self::Joint => action.iter().map(|&number| number as f32).collect(),
        }
    }
}

/// Address, format and cameras of a vla-eval model server.
#[derive(Clone, Debug, PartialEq)]
pub struct VlaEvalSettings {
    /// Server URL, e.g. `ws://127.0.0.1:8000`.
    pub url: String,
    /// Observation and action format.
    pub preset: Preset,
    /// Name of the exterior camera.
    pub exterior: String,
    /// Name of the wrist camera; empty for none.
    pub wrist: String,
    /// Timeouts; this protocol never reconnects.
    pub timeouts: Timeouts,
}

/// A policy behind vla-eval's protocol, with one connection per episode.
pub struct VlaEvalPolicy {
    settings: VlaEvalSettings,
    robot: Arc<RobotModel>,
    instruction: String,
    connection: Option<Connection>,
    /// Sequence number of the last message.
    seq: u64,
}

impl VlaEvalPolicy {
    /// Creates a policy for a robot without connecting.
    pub fn new(settings: VlaEvalSettings, robot: Arc<RobotModel>) -> Self {
        Self { settings, robot, instruction: String::new(), connection: None, seq: 0 }
    }

    /// Connects, exchanges `hello`, checks the server's action formats, and starts the episode.
    fn start_episode(&mut self) -> Result<(), RemoteError> {
        let VlaEvalSettings { url, preset, timeouts, .. } = &self.settings;
        let mut connection = Connection::connect(url, None, *timeouts)?;
        self.seq = 1;
        let hello = vec![
            ("harness_version", Value::from(concat!("genmanip ", env!("CARGO_PKG_VERSION")))),
            ("protocol_version", PROTOCOL.into()),
        ];
        let answer = connection.request(&message("hello", map(hello), self.seq))?;
        let announced = payload(&answer, "hello").map_err(|what| connection.wrong(what))?;
        if let Some(version) = get(announced, "protocol_version").filter(|version| version.as_u64() != Some(PROTOCOL)) {
            return Err(connection.wrong(format!("protocol version {version}, expected {PROTOCOL}")));
        }
        for (part, expected) in preset.formats() {
            let announced =
                get(announced, "action_spec").and_then(|spec| get(spec, part)).and_then(|part| get(part, "format"));
            if let Some(format) = announced.and_then(Value::as_str).filter(|format| format != expected) {
                let what =
                    format!("the {part} format of actions is `{format}`, expected `{expected}` of {}", preset.name());
                return Err(connection.wrong(what));
            }
        }
        self.seq += 1;
        let task = map(vec![("name", self.instruction.as_str().into()), ("suite", "genmanip".into())]);
        connection.send(&message("episode_start", map(vec![("task", task)]), self.seq))?;
        self.connection = Some(connection);
        Ok(())
    }

    fn encoded_observation(&self, observation: &Observation) -> Result<Value, PolicyError> {
        let unsuited = |what: String| PolicyError::Unsuited(what);
        let state = observation.state.get(Observation::STATE);
        let state = state.ok_or_else(|| unsuited(format!("needs `{}`", Observation::STATE)))?;
        let VlaEvalSettings { preset, exterior, wrist, .. } = &self.settings;
        let mut images = Vec::new();
        for (camera, name) in [(exterior, "agentview"), (wrist, "wrist")] {
            if camera.is_empty() {
                continue;
            }
            let image = observation.images.get(camera);
            let image = image.ok_or_else(|| unsuited(format!("needs the camera `{camera}`")))?;
            let picture = Array::picture(image.width() as usize, image.height() as usize, image.rgb.clone());
            let name = if *preset == Preset::Libero { name } else { camera };
            images.push((name, picture.value_with_text_keys()));
        }
        let state = match preset {
            Preset::Libero => libero_state(&self.robot, state),
            Preset::Joint => state.clone(),
        };
        Ok(map(vec![
            ("images", map(images)),
            ("states", Array::vector(state).value_with_text_keys()),
            ("task_description", self.instruction.as_str().into()),
        ]))
    }

    fn actions_for(&mut self, encoded_observation: Value) -> Result<Vec<Vec<f32>>, RemoteError> {
        let lost =
            || RemoteError::Unreachable { url: self.settings.url.clone(), reason: "the connection is lost".into() };
        let mut connection = self.connection.take().ok_or_else(lost)?;
        self.seq += 1;
        let answer = connection.request(&message("observation", encoded_observation, self.seq))?;
        let actions = chunk(&answer, self.seq, self.settings.preset, self.robot.arm_dof());
        let actions = actions.map_err(|what| connection.wrong(what))?;
        self.connection = Some(connection);
        Ok(actions)
    }
}

impl Drop for VlaEvalPolicy {
    /// Ends the episode without waiting.
    fn drop(&mut self) {
        if let Some(mut connection) = self.connection.take() {
            let _ = connection.send(&message("episode_end", Value::Map(Vec::new()), self.seq + 1));
        }
    }
}

impl Policy for VlaEvalPolicy {
    fn spec(&self) -> PolicySpec {
        let VlaEvalSettings { preset, exterior, wrist, .. } = &self.settings;
        let cameras = [exterior, wrist].into_iter().filter(|camera| !camera.is_empty());
        PolicySpec {
            cameras: cameras.map(|camera| CameraRequest::new(camera, ImageChannels::RGB).sized(SIDE, SIDE)).collect(),
            action: preset.action(),
            ..PolicySpec::native("vla-eval", preset.rate_hz())
        }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.instruction.clone_from(&start.instruction);
        self.start_episode().map_err(|error| PolicyError::Unreachable(error.to_string()))
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let encoded_observation = self.encoded_observation(observation)?;
        let actions =
            self.actions_for(encoded_observation).map_err(|error| PolicyError::Unreachable(error.to_string()))?;
        Ok(ActionChunk { actions, finished: false })
    }
}

/// Encodes a message; its timestamp is 0 so that the same episode sends the same bytes.
fn message(kind: &str, payload: Value, seq: u64) -> Vec<u8> {
    let entries =
        vec![("type", kind.into()), ("payload", payload), ("seq", seq.into()), ("timestamp", Value::F64(0.0))];
    let mut bytes = Vec::new();
    // Writing to memory does not fail.
    let _ = rmpv::encode::write_value(&mut bytes, &map(entries));
    bytes
}

fn map(entries: Vec<(&str, Value)>) -> Value {
    Value::Map(entries.into_iter().map(|(key, value)| (key.into(), value)).collect())
}

/// Payload of a message of the expected type; reports the server's error message.
fn payload<'a>(message: &'a Value, expected: &str) -> Result<&'a Value, String> {
    let kind = get(message, "type").and_then(Value::as_str).ok_or("the message has no `type`")?;
    let payload = get(message, "payload").ok_or("the message has no `payload`")?;
    match kind {
        kind if kind == expected => Ok(payload),
        "error" => {
            let said = get(payload, "error").and_then(Value::as_str).unwrap_or("no reason");
            Err(format!("an error: {}", said.chars().take(400).collect::<String>()))
        }
        kind => Err(format!("a message `{}`, expected `{expected}`", kind.chars().take(40).collect::<String>())),
    }
}

/// Actions of the response to message `seq`, in the units of [`Preset::action`], for an arm with `arm_dof` joints.
///
/// # Errors
/// Describes the problem.
pub fn chunk(answer: &Value, seq: u64, preset: Preset, arm_dof: usize) -> Result<Vec<Vec<f32>>, String> {
    let rows = rows(answer, seq, preset.action().length(arm_dof))?;
    Ok(rows.iter().map(|row| preset.scaled(row)).collect())
}

/// Action rows of a response: one action or a chunk.
fn rows(answer: &Value, seq: u64, length: usize) -> Result<Vec<Vec<f64>>, String> {
    let payload = payload(answer, "action")?;
    let announced = get(answer, "seq").and_then(Value::as_u64);
    if announced != Some(seq) {
        return Err(format!("message {announced:?}, expected the answer to {seq}"));
    }
    let actions = get(payload, "actions").ok_or("no `actions`")?;
    let actions = Array::read(actions).map_err(|what| format!("invalid `actions`: {what}"))?;
    let fits = match actions.shape[..] {
        [width] => width == length,
        [count, width] => width == length && (1..=1000).contains(&count),
        _ => false,
    };
    if !fits {
        return Err(format!("`actions` of shape {:?}, expected [{length}] or [1 to 1000, {length}]", actions.shape));
    }
    let numbers = actions.reals();
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(format!("`actions` with {number}")),
        None => Ok(numbers.chunks_exact(length).map(<[f64]>::to_vec).collect()),
    }
}
