//! Policies that describe themselves over openpi's protocol, as `genmanip serve policy` offers them; client and server.
//!
//! The server's metadata holds the robot and the policy's [`PolicySpec`]. A request holds `prompt`, the state and an
//! RGB image per camera in the sizes of the spec, under LeRobot's names; the response `actions` in the layout of the
//! spec, and `finished`.

use std::sync::Arc;

use genmanip_core::{
    ActionChunk, EpisodeStart, Intrinsics, Observation, Policy, PolicyError, PolicySpec, Pose, RgbdImage,
};
use rmpv::Value;
use serde_json::Value as Json;

use crate::connection::{Connection, RemoteError, Timeouts};
use crate::numpy::{Array, Numbers, get};
use crate::wire;

/// Key of the robot's name in the metadata.
const ROBOT: &str = "robot";
/// Key of the spec in the metadata.
const SPEC: &str = "policy_spec";
/// Prefix of the keys of images, before the camera's name.
const IMAGES: &str = "observation.images.";
/// Maximum actions of a chunk. Bounds memory for invalid responses.
const MAX_ACTIONS: usize = 1000;

/// A policy on a server that describes itself, with one connection per episode.
pub struct ServedPolicy {
    connection: Connection,
    spec: PolicySpec,
    arm_dof: usize,
    instruction: String,
}

/// Connection to a server before its policy is known.
pub struct Offer {
    connection: Connection,
    /// Name of the robot that the policy moves.
    pub robot: String,
    /// Spec of the policy as JSON.
    pub spec: Json,
}

impl Offer {
    /// Connects and reads the server's metadata.
    ///
    /// # Errors
    /// If the server is unreachable or does not describe a policy.
    pub fn of(url: &str, timeouts: Timeouts) -> Result<Self, RemoteError> {
        let (connection, metadata) = Connection::open(url, None, timeouts)?;
        let robot = get(&metadata, ROBOT).and_then(Value::as_str).map(str::to_owned);
        let spec = get(&metadata, SPEC).and_then(|spec| wire::json(spec).ok());
        match (robot, spec) {
            (Some(robot), Some(spec)) => Ok(Self { connection, robot, spec }),
            _ => Err(connection.wrong(format!(
                "its metadata has no `{ROBOT}` and `{SPEC}`; expected a server that `genmanip serve policy` started"
            ))),
        }
    }

    /// The policy for one episode, with its spec as read by the caller, for an arm with `arm_dof` joints.
    pub fn policy(self, spec: PolicySpec, arm_dof: usize) -> ServedPolicy {
        ServedPolicy { connection: self.connection, spec, arm_dof, instruction: String::new() }
    }
}

impl Policy for ServedPolicy {
    fn spec(&self) -> PolicySpec {
        self.spec.clone()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.instruction.clone_from(&start.instruction);
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let question = question(&self.spec, &self.instruction, observation).map_err(PolicyError::Unsuited)?;
        let answer = self.connection.request(&wire::encoded(&question));
        let answer = answer.map_err(|error| PolicyError::Unreachable(error.to_string()))?;
        chunk(&answer, self.spec.action.length(self.arm_dof))
            .map_err(|what| PolicyError::Unreachable(self.connection.wrong(what).to_string()))
    }
}

/// Metadata by which a server describes its policy.
pub fn metadata(robot: &str, spec: &PolicySpec) -> Value {
    map(vec![("server", "genmanip".into()), (ROBOT, robot.into()), (SPEC, wire::of(spec))])
}

/// Request for an observation.
///
/// # Errors
/// If the observation lacks the state or an image.
pub fn question(spec: &PolicySpec, instruction: &str, observation: &Observation) -> Result<Value, String> {
    let missing = |what: &str| format!("needs `{what}`");
    let state = observation.state.get(Observation::STATE).ok_or_else(|| missing(Observation::STATE))?;
    let mut entries = vec![
        (Value::from("prompt"), Value::from(instruction)),
        (Value::from(Observation::STATE), Array::vector(state.iter().copied()).value()),
    ];
    for camera in &spec.cameras {
        let image = observation.images.get(&camera.name).ok_or_else(|| missing(&camera.name))?;
        let picture = Array::picture(image.width() as usize, image.height() as usize, image.rgb.clone());
        entries.push((format!("{IMAGES}{}", camera.name).into(), picture.value()));
    }
    Ok(Value::Map(entries))
}

/// Instruction and observation of a request to a policy that moves an arm with `arm_dof` joints. The images have no
/// camera poses.
///
/// # Errors
/// Names the entry, the expected form and what came.
pub fn read_question(question: &Value, spec: &PolicySpec, arm_dof: usize) -> Result<(String, Observation), String> {
    let entry = |key: &str| get(question, key).ok_or_else(|| format!("`{key}` is missing"));
    let array = |key: &str| Array::read(entry(key)?).map_err(|what| format!("`{key}`: {what}"));
    let prompt = entry("prompt")?.as_str().ok_or("`prompt`: expected a string")?;
    let state = array(Observation::STATE)?;
    let numbers = state.reals();
    if state.shape != [arm_dof + 1] || numbers.iter().any(|number| !number.is_finite()) {
        let expected = format!("{arm_dof} joint positions [rad] and the opening [m]");
        return Err(format!("`{}` of shape {:?}: expected {expected}", Observation::STATE, state.shape));
    }
    let mut observation = Observation::default();
    observation.state.insert(Observation::STATE.into(), numbers);
    for camera in &spec.cameras {
        let key = format!("{IMAGES}{}", camera.name);
        let picture = array(&key)?;
        let [height, width] = match (&picture.shape[..], camera.size) {
            (&[height, width, 3], None) => [height, width],
            (&[height, width, 3], Some(size)) if [width as u64, height as u64] == size.map(u64::from) => {
                [height, width]
            }
            (shape, size) => {
                let expected = size.map_or("height, width".into(), |[width, height]| format!("{height}, {width}"));
                return Err(format!("`{key}` of shape {shape:?}: expected [{expected}, 3]"));
            }
        };
        let Numbers::U8(rgb) = picture.numbers else { return Err(format!("`{key}`: expected 8-bit RGB, dtype |u1")) };
        let intrinsics = Intrinsics::from_vertical_fov(width as u32, height as u32, 1.0);
        let image = RgbdImage { rgb, ..RgbdImage::of_depth(intrinsics, Pose::IDENTITY, Vec::new()) };
        observation.images.insert(camera.name.clone(), Arc::new(image));
    }
    Ok((prompt.to_owned(), observation))
}

/// Response with a chunk of actions of `length` numbers each, computed in `seconds`.
pub fn answer(chunk: &ActionChunk, length: usize, seconds: f64) -> Value {
    let actions = Array { shape: vec![chunk.actions.len(), length], numbers: Numbers::F32(chunk.actions.concat()) };
    let timing = map(vec![("infer_ms", (1e3 * seconds).into())]);
    map(vec![("actions", actions.value()), ("finished", chunk.finished.into()), ("server_timing", timing)])
}

/// Action chunk in a response; `Err` describes what is invalid.
fn chunk(answer: &Value, length: usize) -> Result<ActionChunk, String> {
    let actions = Array::read(get(answer, "actions").ok_or("no `actions`")?);
    let Array { shape, numbers } = actions.map_err(|what| format!("invalid `actions`: {what}"))?;
    let finished = get(answer, "finished").and_then(Value::as_bool).unwrap_or_default();
    match (&shape[..], numbers) {
        // Only a policy that has finished may return no actions.
        ([count @ 0..=MAX_ACTIONS, width], Numbers::F32(numbers)) if *width == length && (*count > 0 || finished) => {
            Ok(ActionChunk { actions: numbers.chunks_exact(length).map(<[f32]>::to_vec).collect(), finished })
        }
        (shape, _) => Err(format!("`actions` of shape {shape:?}, expected float32 of [1 to {MAX_ACTIONS}, {length}]")),
    }
}

fn map(entries: Vec<(&str, Value)>) -> Value {
    Value::Map(entries.into_iter().map(|(key, value)| (key.into(), value)).collect())
}
