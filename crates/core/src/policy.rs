//! Policies: whatever turns observations into actions.

use std::collections::BTreeMap;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{ActionSpec, Camera, CameraRequest, ObjectState, RgbdImage, Scenario, Seed};

/// Anything that controls the robot. Synchronous; one instance per episode in flight.
pub trait Policy: Send {
    /// What the policy needs and what it returns. The rollout refuses a spec it cannot serve.
    fn spec(&self) -> PolicySpec;

    /// Called once before the first observation of an episode.
    ///
    /// # Errors
    /// When the policy cannot work on this episode.
    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError>;

    /// The next actions.
    ///
    /// # Errors
    /// When the policy gives up; the episode then ends and the reason is recorded.
    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError>;
}

/// A policy's contract.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PolicySpec {
    /// Name in results, e.g. `expert`.
    pub name: String,
    /// Images that must be rendered for each observation.
    pub cameras: Vec<CameraRequest>,
    /// Entries of `Observation::state` that must be present.
    pub state_keys: Vec<String>,
    /// What the numbers in an action mean.
    pub action: ActionSpec,
    /// How often an action is taken from a chunk, hertz; the 60 Hz control rate is a whole multiple.
    pub rate_hz: f64,
    /// How many actions of a chunk are executed before the next observation; 0 for all of them.
    pub execute_steps: usize,
    /// Whether the policy reads simulator truth; every result made with it then says `oracle`.
    pub privileged: bool,
}

impl PolicySpec {
    /// Native actions at a rate, from the robot's own state alone, every chunk executed whole.
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
}

/// What a policy is told before an episode.
#[derive(Clone, Debug)]
pub struct EpisodeStart {
    /// The sentence.
    pub instruction: String,
    /// Stream for the policy's own chance.
    pub seed: Seed,
    /// The cameras the policy asked for, at the sizes it asked for.
    pub cameras: Vec<Camera>,
    /// The whole scenario, for privileged policies only.
    pub scenario: Option<Arc<Scenario>>,
}

/// What a policy sees.
#[derive(Clone, Debug, Default)]
pub struct Observation {
    /// Time since the start of the episode.
    pub time_s: f64,
    /// Named state vectors; [`Observation::STATE`] = arm joint positions and gripper width.
    pub state: BTreeMap<String, Vec<f64>>,
    /// Images of the cameras asked for, by name.
    pub images: BTreeMap<String, Arc<RgbdImage>>,
    /// Simulator truth, for privileged policies only.
    pub privileged: Option<PrivilegedState>,
}

impl Observation {
    /// Key of the robot's own state: arm joint positions, then the opening width, rad and m.
    pub const STATE: &'static str = "observation.state";
}

/// Simulator truth.
#[derive(Clone, Debug, PartialEq)]
pub struct PrivilegedState {
    /// Objects in the order of the scenario.
    pub objects: Vec<ObjectState>,
    /// Index of the object that both fingers touch.
    pub grasped: Option<usize>,
}

/// Actions to execute, one per period of the policy's rate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActionChunk {
    /// Each of the dimension the spec implies.
    pub actions: Vec<Vec<f32>>,
    /// The policy considers the task done once these are executed.
    pub finished: bool,
}

/// Why a policy cannot go on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PolicyError {
    /// It tried and found no way; the cause is data, not a defect.
    #[error("{}", .0)]
    GaveUp(crate::Failure),
    /// It cannot work on this episode at all.
    #[error("policy cannot serve this episode: {0}")]
    Unsuited(String),
    /// Its end cannot be reached: the episode is not run and may be tried again, which is no failure.
    #[error("policy cannot be reached: {0}")]
    Unreachable(String),
}
