//! Learned policies in episodes: network inputs from observations, actions from predicted chunks.

use std::io;
use std::path::Path;
use std::sync::Arc;

use genmanip_core::limits::Limit;
use genmanip_core::{ActionChunk, EpisodeStart, Observation, Policy, PolicyError, PolicySpec, RobotModel};
use genmanip_policy::{Ensemble, Inputs, Network, PolicyDescription, Prediction, Seen, instruction_words};
use genmanip_rollout::Stage;
use genmanip_workspace::{WorkspaceError, documents};

use super::Execution;
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
    /// Description of the network, with the chosen number of executed actions.
    description: PolicyDescription,
    ensemble: Option<f64>,
}

/// Loads a policy.
///
/// # Errors
/// When its files cannot be read, contradict each other, or require other inputs than this version of the program
/// makes; when more actions are to be executed than a chunk holds.
pub(crate) fn load(folder: &Path, execution: Execution) -> Result<Arc<Learned>, WorkspaceError> {
    let mut description: PolicyDescription = documents::read_document(&folder.join(DESCRIPTION), MAX_DESCRIPTION)?;
    if description.inputs != inputs::layout(description.preset) {
        return Err(WorkspaceError::input(format!("{} was trained on other inputs", folder.display()))
            .with_hint("train it again, or use the version of the program that trained it"));
    }
    let weights = folder.join(WEIGHTS);
    let bytes = documents::read_bytes(&weights, MAX_WEIGHTS)?;
    let network = Network::new(description.clone(), &bytes).map_err(|error| {
        WorkspaceError::file("read", &weights, error).or_hint("copy the whole folder of the policy, or train it again")
    })?;
    let Execution { execute, ensemble } = execution;
    let usual = if ensemble.is_some() { 1 } else { description.execute };
    description.execute = execute.unwrap_or(usual);
    if !(1..=description.model.chunk).contains(&description.execute) {
        let what = format!("policy learned: execute={} is not possible", description.execute);
        return Err(WorkspaceError::input(what)
            .with_hint(format!("expected 1 to {}, the actions of a chunk", description.model.chunk)));
    }
    Ok(Arc::new(Learned { network, description, ensemble }))
}

impl Learned {
    /// Description of the policy, with the chosen number of executed actions.
    pub(crate) fn description(&self) -> &PolicyDescription {
        &self.description
    }

    /// The policy for one episode.
    ///
    /// # Errors
    /// When the robot or the goal is of a kind that the policy was not trained for.
    pub(crate) fn act_on(self: &Arc<Self>, stage: &Stage) -> Result<Box<dyn Policy>, WorkspaceError> {
        let policy = ChunkPolicy::new(NAME, self.description(), self.predict(), stage)?;
        Ok(Box::new(policy.ensembling(self.ensemble)))
    }

    /// The policy without object inputs, for a robot outside the simulator.
    pub(crate) fn act_unseen(self: &Arc<Self>, robot: &Arc<RobotModel>) -> Box<dyn Policy> {
        let observer = Observer::of_robot(&self.description().inputs, robot);
        let policy = ChunkPolicy::seeing(NAME, self.description(), self.predict(), observer);
        Box::new(policy.ensembling(self.ensemble))
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
    /// Number of actions executed in the episode so far.
    row: usize,
    /// Decay of temporal ensembling, and the predictions of the episode; `None` without it.
    ensemble: Option<(f64, Ensemble)>,
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
        Self { spec, description: description.clone(), predict, observer, words: Vec::new(), row: 0, ensemble: None }
    }

    /// The policy with temporal ensembling of this decay; unchanged with `None`.
    fn ensembling(mut self, decay: Option<f64>) -> Self {
        if let Some(decay) = decay {
            self.ensemble = Some((decay, Ensemble::new(decay)));
            // Rows are counted by returned actions, so all of them must be executed before the next observation: the
            // policy is not asked ahead.
            self.spec.execute_steps = 0;
        }
        self
    }
}

impl<F: FnMut(&Seen) -> io::Result<Prediction> + Send> Policy for ChunkPolicy<F> {
    fn spec(&self) -> PolicySpec {
        self.spec.clone()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.words = instruction_words(&start.instruction, self.description.inputs.words);
        self.row = 0;
        self.ensemble = self.ensemble.take().map(|(decay, _)| (decay, Ensemble::new(decay)));
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let seen = self.seen(observation)?;
        let predicted = (self.predict)(&seen).map_err(|error| PolicyError::Unsuited(error.to_string()))?;
        let Prediction { actions, end } = match &mut self.ensemble {
            Some((_, ensemble)) => ensemble.add(self.row, predicted),
            None => predicted,
        };
        let scale = &self.description.normalisation.action;
        let coming = actions.iter().zip(&end).take(self.description.execute).take_while(|(_, end)| **end <= OVER);
        let actions: Vec<Vec<f32>> = coming.map(|(action, _)| scale.restore(action).collect()).collect();
        // Only an empty chunk means that the policy has finished; after a short chunk it predicts again.
        let finished = actions.is_empty();
        self.row += actions.len();
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
        Ok(Seen { numbers, words: self.words.clone(), rgb, row: self.row })
    }
}

#[cfg(test)]
mod tests {
    use genmanip_assets::robots;
    use genmanip_core::{ActionContract, ActionSpace, RotationEncoding, Seed};
    use genmanip_data::export::choice::action;
    use genmanip_policy::{ModelSettings, Normalisation, Preset, Scale, TrainingFacts, TrainingSettings};

    use super::*;

    const CHUNK: usize = 4;
    const ENTRIES: usize = 10;

    fn description(execute: usize) -> PolicyDescription {
        let scale = |width: usize, deviation: f32| Scale { mean: vec![0.0; width], deviation: vec![deviation; width] };
        let inputs = inputs::layout(Preset::State);
        PolicyDescription {
            preset: Preset::State,
            privileged: true,
            model: ModelSettings {
                width: 4,
                heads: 1,
                feed_forward: 4,
                encoder_layers: 1,
                decoder_layers: 1,
                chunk: CHUNK,
                ..ModelSettings::default()
            },
            normalisation: Normalisation {
                robot: scale(inputs.robot.len(), 1.0),
                object: scale(inputs.object.len(), 1.0),
                action: scale(ENTRIES, 2.0),
            },
            inputs: Inputs { slots: 0, ..inputs },
            contract: ActionContract {
                action: action(ActionSpace::EePose, RotationEncoding::SixD),
                rate_hz: 15.0,
                robot: "panda".into(),
                names: vec!["entry".into(); ENTRIES],
            },
            execute,
            training: TrainingFacts {
                run: String::new(),
                sources: Vec::new(),
                demonstrations: 0,
                rows: 0,
                seed: Seed::new(0),
                steps: 0,
                settings: TrainingSettings::default(),
                final_l1: 0.0,
                parameters: 0,
                genmanip_version: String::new(),
            },
            tensors_sha256: String::new(),
        }
    }

    /// First entries of the actions that a policy returns in `calls` calls, and whether it has finished. The place
    /// `at` of its prediction `call` is 100 · call + at, and over from place `end` on.
    fn acted(execute: usize, ensemble: Option<f64>, calls: usize, end: usize) -> Vec<(Vec<f32>, bool)> {
        let robot = robots::named("panda").unwrap();
        let description = description(execute);
        let observer = Observer::of_robot(&description.inputs, &robot);
        let mut call = 0;
        let predict = move |_: &Seen| {
            let actions = (0..CHUNK).map(|at| vec![(100 * call + at) as f32; ENTRIES]).collect();
            call += 1;
            Ok(Prediction { actions, end: (0..CHUNK).map(|at| f32::from(u8::from(at >= end))).collect() })
        };
        let mut policy = ChunkPolicy::seeing(NAME, &description, predict, observer).ensembling(ensemble);
        let start =
            EpisodeStart { instruction: String::new(), seed: Seed::new(0), cameras: Vec::new(), scenario: None };
        policy.reset(&start).unwrap();
        let mut observation = Observation::default();
        let state = robot.home.iter().copied().chain([0.08]).collect();
        observation.state.insert(Observation::STATE.into(), state);
        (0..calls)
            .map(|_| {
                let chunk = policy.act(&observation).unwrap();
                // The scale of actions doubles what the network says.
                (chunk.actions.iter().map(|action| action[0] / 2.0).collect(), chunk.finished)
            })
            .collect()
    }

    #[test]
    fn as_many_actions_of_a_chunk_are_executed_as_were_asked_for() {
        assert_eq!(acted(1, None, 2, CHUNK), [(vec![0.0], false), (vec![100.0], false)]);
        assert_eq!(acted(3, None, 2, CHUNK), [(vec![0.0, 1.0, 2.0], false), (vec![100.0, 101.0, 102.0], false)]);
        assert_eq!(acted(3, None, 1, 2), [(vec![0.0, 1.0], false)], "the episode ends within the chunk");
        assert_eq!(acted(3, None, 1, 0), [(vec![], true)]);
    }

    #[test]
    fn an_ensemble_averages_what_chunks_say_of_the_same_row() {
        // Asked at every row, call n finds n + 1 predictions of its row, at most a chunk: 100 i + (n − i).
        let mean = |decay: f64, call: usize| {
            let oldest = (call + 1).saturating_sub(CHUNK);
            let weights: Vec<f64> = (0..=call - oldest).map(|age| (-decay * age as f64).exp()).collect();
            let values = (oldest..=call).map(|one| (100 * one + call - one) as f64);
            (values.zip(&weights).map(|(value, weight)| value * weight).sum::<f64>() / weights.iter().sum::<f64>())
                as f32
        };
        for decay in [0.0, 0.3] {
            for (call, (actions, finished)) in acted(1, Some(decay), 9, CHUNK).into_iter().enumerate() {
                let expected = mean(decay, call);
                assert!((actions[0] - expected).abs() < 1e-2, "call {call}: {actions:?}, expected {expected}");
                assert_eq!((actions.len(), finished), (1, false));
            }
        }
        // Two rows at a time, the second chunk has the first one's last two places.
        let twice = acted(2, Some(0.0), 2, CHUNK);
        assert_eq!(twice, [(vec![0.0, 1.0], false), (vec![51.0, 52.0], false)]);
        // Half of the predictions of the second row say that the episode is over: not more likely than not.
        assert_eq!(acted(1, Some(0.0), 3, 1)[1..], [(vec![50.5], false), (vec![], true)]);
    }
}
