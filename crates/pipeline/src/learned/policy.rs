//! Learned policies in episodes: network inputs from observations, actions from predicted chunks.

use std::io;
use std::path::Path;
use std::sync::Arc;

use genmanip_core::limits::Limit;
use genmanip_core::{ActionChunk, EpisodeStart, Observation, Policy, PolicyError, PolicySpec, RobotModel};
use genmanip_policy::{Inputs, Network, PolicyDescription, Prediction, Seen, instruction_words};
use genmanip_rollout::Stage;
use genmanip_workspace::{WorkspaceError, documents};

use super::inputs::{self, Moment, Observer};
use crate::policy_spec::check_robot;

/// File of a policy's description in its folder.
pub(crate) const DESCRIPTION: &str = "policy.json";
/// File of a policy's weights in its folder.
pub(crate) const WEIGHTS: &str = "weights.safetensors";
/// Size limits of the two files.
pub(crate) const MAX_DESCRIPTION: Limit = Limit { what: "the description of a policy", bytes: 4 << 20 };
pub(crate) const MAX_WEIGHTS: Limit = Limit { what: "the weights of a policy", bytes: 4 << 30 };
/// Predicted probability above which the episode counts as finished.
const OVER: f32 = 0.5;

/// A policy loaded from a folder, shared by its episodes.
pub(crate) struct Learned {
    network: Network,
}

/// Loads a policy.
///
/// # Errors
/// When its files cannot be read, contradict each other, or require other inputs than this version of the program
/// makes.
pub(crate) fn load(folder: &Path) -> Result<Arc<Learned>, WorkspaceError> {
    let description: PolicyDescription = documents::read_document(&folder.join(DESCRIPTION), MAX_DESCRIPTION)?;
    if description.inputs != inputs::layout(description.preset) {
        return Err(WorkspaceError::input(format!("{} was trained on other inputs", folder.display()))
            .with_hint("train it again, or use the version of the program that trained it"));
    }
    let weights = folder.join(WEIGHTS);
    let bytes = documents::read_bytes(&weights, MAX_WEIGHTS)?;
    let network = Network::new(description, &bytes).map_err(|error| {
        WorkspaceError::file("read", &weights, error).or_hint("copy the whole folder of the policy, or train it again")
    })?;
    Ok(Arc::new(Learned { network }))
}

impl Learned {
    /// Description of the policy.
    pub(crate) fn description(&self) -> &PolicyDescription {
        self.network.description()
    }

    /// The policy for one episode.
    ///
    /// # Errors
    /// When the robot or the goal is of a kind that the policy was not trained for.
    pub(crate) fn act_on(self: &Arc<Self>, stage: &Stage) -> Result<Box<dyn Policy>, WorkspaceError> {
        Ok(Box::new(ChunkPolicy::new(NAME, self.description(), self.predict(), stage)?))
    }

    /// The policy without object inputs, for a robot outside the simulator.
    pub(crate) fn act_unseen(self: &Arc<Self>, robot: &Arc<RobotModel>) -> Box<dyn Policy> {
        let observer = Observer::of_robot(&self.description().inputs, robot);
        Box::new(ChunkPolicy::seeing(NAME, self.description(), self.predict(), observer))
    }

    /// Predictor of action chunks.
    pub(crate) fn predict(self: &Arc<Self>) -> impl FnMut(&Seen) -> io::Result<Prediction> + Send + 'static {
        let learned = Arc::clone(self);
        move |seen: &Seen| learned.network.predict(seen)
    }
}

/// Name of the policy in results.
const NAME: &str = "learned";

/// Policy that executes predicted chunks; all learned policies and their controls use it.
pub(crate) struct ChunkPolicy<F> {
    spec: PolicySpec,
    description: PolicyDescription,
    predict: F,
    observer: Observer,
    /// Encoded words of the instruction.
    words: Vec<f32>,
}

impl<F: FnMut(&Seen) -> io::Result<Prediction> + Send> ChunkPolicy<F> {
    /// The policy for an episode of a stage.
    ///
    /// # Errors
    /// When the robot or the goal is of a kind that the description does not include.
    pub fn new(name: &str, description: &PolicyDescription, predict: F, stage: &Stage) -> Result<Self, WorkspaceError> {
        check_robot(&description.contract.robot, stage)?;
        let observer = Observer::new(&description.inputs, &stage.scenario, &stage.models, &stage.robot)
            .map_err(|reason| WorkspaceError::input(format!("scenario {}: {reason}", stage.scenario.id)))?;
        Ok(Self::seeing(name, description, predict, observer))
    }

    /// The policy with inputs from this observer.
    fn seeing(name: &str, description: &PolicyDescription, predict: F, observer: Observer) -> Self {
        let contract = &description.contract;
        let spec = PolicySpec {
            action: contract.action,
            execute_steps: description.execute,
            privileged: description.privileged,
            cameras: inputs::cameras(&description.inputs.images),
            ..PolicySpec::native(name, contract.rate_hz)
        };
        Self { spec, description: description.clone(), predict, observer, words: Vec::new() }
    }
}

impl<F: FnMut(&Seen) -> io::Result<Prediction> + Send> Policy for ChunkPolicy<F> {
    fn spec(&self) -> PolicySpec {
        self.spec.clone()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.words = instruction_words(&start.instruction, self.description.inputs.words);
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let seen = self.seen(observation)?;
        let predicted = (self.predict)(&seen).map_err(|error| PolicyError::Unsuited(error.to_string()))?;
        let Prediction { actions, end } = predicted;
        let scale = &self.description.normalisation.action;
        let coming = actions.iter().zip(&end).take(self.description.execute).take_while(|(_, end)| **end <= OVER);
        let actions: Vec<Vec<f32>> = coming.map(|(action, _)| scale.restore(action).collect()).collect();
        // Only an empty chunk means that the policy has finished; after a short chunk it predicts again.
        let finished = actions.is_empty();
        Ok(ActionChunk { actions, finished })
    }
}

impl<F> ChunkPolicy<F> {
    /// Inputs of the network from an observation.
    fn seen(&self, observation: &Observation) -> Result<Seen, PolicyError> {
        let missing = |what: &str| PolicyError::Unsuited(format!("`{what}` is missing"));
        let Inputs { slots, images, .. } = &self.description.inputs;
        let state = observation.state.get(Observation::STATE).and_then(|state| state.split_last());
        let (width_m, arm) = state.ok_or_else(|| missing(Observation::STATE))?;
        let truth = observation.privileged.as_ref();
        if *slots > 0 && truth.is_none() {
            return Err(missing("simulator truth"));
        }
        let objects = truth.map_or(&[][..], |truth| &truth.objects);
        let held = truth.and_then(|truth| truth.grasped);
        let numbers = self.observer.numbers(Moment { arm, width_m: *width_m, objects, held });
        let mut rgb = Vec::new();
        for image in images {
            let seen = observation.images.get(&image.camera).ok_or_else(|| missing(&image.camera))?;
            rgb.extend(&seen.rgb);
        }
        Ok(Seen { numbers, words: self.words.clone(), rgb })
    }
}
