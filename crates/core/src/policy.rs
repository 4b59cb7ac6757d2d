//! Policies: functions from observations to actions.

use std::collections::BTreeMap;
use std::error::Error;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{ActionSpec, AgentFailure, Camera, CameraRequest, Frame, ObjectState, RgbdImage, Scenario, Seed};

/// A robot controller. Synchronous; one instance per episode in flight.
pub trait Policy: Send {
    /// Required observations and returned actions. The rollout rejects a spec that it cannot serve.
    fn spec(&self) -> PolicySpec;

    /// Called once before the first observation of an episode.
    ///
    /// # Errors
    /// If the policy cannot work on this episode.
    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError>;

    /// Returns the next actions.
    ///
    /// # Errors
    /// If the policy gives up; the episode then ends and the reason is recorded.
    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError>;

    /// Analysis by the policy of its own failed episode; `frames` is the recording. `None` if the policy has none.
    fn analyse(&self, _frames: &[Frame]) -> Option<AgentFailure> {
        None
    }
}

/// Observations that a policy needs, and actions that it returns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PolicySpec {
    /// Name in results, e.g. `expert`.
    pub name: String,
    /// Images rendered for each observation.
    pub cameras: Vec<CameraRequest>,
    /// Keys that must be present in [`Observation::state`].
    pub state_keys: Vec<String>,
    /// Layout of the action vector.
    pub action: ActionSpec,
    /// Rate at which actions of a chunk are executed, Hz; divides the control rate of the world.
    pub rate_hz: f64,
    /// Number of actions of a chunk executed before the next observation; 0 for all.
    pub execute_steps: usize,
    /// True if the policy reads simulator ground truth; its results are then marked `oracle`.
    pub privileged: bool,
}

impl PolicySpec {
    /// Interface of a policy that returns native actions, needs only proprioception, and executes every chunk
    /// completely.
    pub fn native(name: &str, rate_hz: f64) -> Self {
        Self {
            name: name.into(),
            cameras: Vec::new(),
            state_keys: vec![Observation::STATE.into()],
            action: ActionSpec::native(),
            rate_hz,
            execute_steps: 0,
            privileged: false,
        }
    }

    /// Number of control steps per action in a world of that control rate, Hz.
    ///
    /// # Errors
    /// Message about a rate that does not divide the control rate, with some rates that do.
    pub fn control_steps(&self, control_rate_hz: f64) -> Result<usize, String> {
        let steps = control_rate_hz / self.rate_hz;
        if steps >= 1.0 && steps.fract() == 0.0 {
            return Ok(steps as usize);
        }
        let divisors = [6.0, 4.0, 3.0, 2.0].map(|steps| control_rate_hz / steps);
        let whole = divisors.iter().filter(|rate_hz| rate_hz.fract() == 0.0).map(f64::to_string);
        let such = whole.collect::<Vec<_>>().join(", ");
        let expected = format!("actions per second that divide the control rate of {control_rate_hz} Hz");
        Err(format!("`rate_hz`: expected {expected}, such as {such} or {control_rate_hz}; got {}", self.rate_hz))
    }
}

/// Information given to a policy before an episode.
#[derive(Clone, Debug)]
pub struct EpisodeStart {
    /// Language instruction.
    pub instruction: String,
    /// Seed for the policy's own randomness.
    pub seed: Seed,
    /// The requested cameras, at the requested sizes.
    pub cameras: Vec<Camera>,
    /// The whole scenario; `None` except for privileged policies.
    pub scenario: Option<Arc<Scenario>>,
}

/// Observation of a policy at the time of a decision.
#[derive(Clone, Debug, Default)]
pub struct Observation {
    /// Time since the start of the episode, s.
    pub time_s: f64,
    /// Named state vectors; [`Observation::STATE`] holds arm joint positions and opening width.
    pub state: BTreeMap<String, Vec<f64>>,
    /// Requested images by camera name.
    pub images: BTreeMap<String, Arc<RgbdImage>>,
    /// Simulator ground truth; `None` except for privileged policies.
    pub privileged: Option<PrivilegedState>,
}

impl Observation {
    /// Key of the proprioceptive state: arm joint positions (rad), then opening width (m).
    pub const STATE: &'static str = "observation.state";
    /// Key of the command in force: arm joint targets (rad), then opening width (m).
    pub const COMMAND: &'static str = "observation.command";
    /// Key of the measured tool pose: position (m, world), then the unit quaternion, w first.
    pub const TOOL: &'static str = "observation.tool";
    /// Key of the tool pose that the last action requested, in the same form.
    pub const TOOL_TARGET: &'static str = "observation.tool_target";
    /// Names of the state vectors in Python, each with its key.
    pub const NAMES: [(&'static str, &'static str); 4] =
        [("state", Self::STATE), ("command", Self::COMMAND), ("tool", Self::TOOL), ("tool_target", Self::TOOL_TARGET)];
}

/// Simulator ground truth for privileged policies.
#[derive(Clone, Debug, PartialEq)]
pub struct PrivilegedState {
    /// Objects in the order of the scenario.
    pub objects: Vec<ObjectState>,
    /// Index of the object pressed by both fingers; `None` if there is none.
    pub grasped: Option<usize>,
}

/// Actions to execute, one per period of the policy's rate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActionChunk {
    /// Action vectors; their length follows from [`PolicySpec::action`] and the arm.
    pub actions: Vec<Vec<f32>>,
    /// True if the policy considers the task done once these actions are executed.
    pub finished: bool,
}

/// Reason why a policy cannot continue.
#[derive(Clone, Debug, thiserror::Error)]
pub enum PolicyError {
    /// The policy tried and found no solution; counted as data, not as a defect.
    #[error("{}", .0)]
    GaveUp(crate::Failure),
    /// The policy cannot work on this episode at all.
    #[error("policy cannot serve this episode: {0}")]
    Unsuited(String),
    /// An error of the policy's program: message with its place and, on a line that starts with `hint:`, its remedy.
    /// The episode is not run, does not count as a failure and is retried.
    #[error("{0}")]
    Mistake(String),
    /// The policy's endpoint, or a service that it asks, does not answer or answers wrongly, as the text says: the episode
    /// is not run, does not count as a failure and is retried.
    #[error("{0}")]
    Unreachable(String),
    /// A fault of the machine, e.g. a full disk: the run stops, and nothing counts as a failure of the policy.
    #[error("{0}")]
    Broken(#[source] Arc<dyn Error + Send + Sync>),
}
