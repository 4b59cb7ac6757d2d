//! Check before any training: recorded rows on the way of a learned policy's output must solve their layouts.
//!
//! It fails when the actions do not mean what the policy's contract says, when rows are off by one or of another rate,
//! or when normalisation, chunks or the end of an episode are handled wrongly.

use std::collections::BTreeMap;
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_benchmark::statistics::{Rate, StatisticsSettings};
use genmanip_core::Policy;
use genmanip_policy::{Demonstration, Inputs, PolicyDescription, Prediction, Seen, TrainingFacts};
use genmanip_workspace::{Progress, WorkspaceError};

use super::demonstrations::{self, RunDemonstrations};
use super::options::{CheckOptions, Checked};
use super::presets::{PresetSettings, settings};
use crate::evaluate::{EvaluateOptions, Suite, evaluate};
use crate::learned::policy::ChunkPolicy;
use crate::policies::{PolicyContext, PolicyFactory};

/// Least share of the layouts that the recorded rows must solve: open loop, at the rate of the rows.
const EXPECTED: f64 = 0.95;

/// Replays demonstrations of a run; `None` if stopped.
///
/// # Errors
/// When the run cannot be read, or an episode broke.
pub fn check(
    options: &CheckOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<Checked>, WorkspaceError> {
    let preset = settings(options.preset, false);
    // Recorded rows need neither images nor words.
    let inputs = Inputs { images: Vec::new(), words: 0, ..preset.inputs.clone() };
    let preset = PresetSettings { inputs, ..preset };
    let read = demonstrations::read(&options.run, &preset, options.workers, progress, stop)?;
    let Some(RunDemonstrations { arrays, ids, contract, run, .. }) = read else { return Ok(None) };
    let PresetSettings { model, execute, training, privileged, .. } = preset;
    let normalisation = arrays.normalisation();
    let description = PolicyDescription {
        preset: options.preset,
        privileged,
        inputs: arrays.inputs.clone(),
        execute,
        contract,
        training: TrainingFacts {
            run,
            demonstrations: ids.len(),
            rows: arrays.total_rows(),
            seed: genmanip_core::Seed::new(0),
            steps: 0,
            settings: training,
            final_l1: 0.0,
            parameters: 0,
            genmanip_version: env!("CARGO_PKG_VERSION").into(),
        },
        tensors_sha256: String::new(),
        normalisation,
        model,
    };
    let mut suite = Suite::of_run(&options.run)?;
    let by_id: BTreeMap<String, Demonstration> = ids.into_iter().zip(arrays.episodes).collect();
    let (scenarios, mut cases) = (std::mem::take(&mut suite.scenarios), std::mem::take(&mut suite.cases));
    cases.retain(|case| by_id.contains_key(&case.id));
    cases.truncate(options.demonstrations);
    let is_kept = |id: &str| cases.iter().any(|case| case.scenario.id == id);
    suite.scenarios = scenarios.into_iter().filter(|scenario| is_kept(&scenario.id)).collect();
    let by_scenario: BTreeMap<String, Vec<Vec<f32>>> = cases
        .iter()
        .filter_map(|case| {
            let actions = by_id.get(&case.id)?.actions.chunks_exact(description.contract.names.len());
            let rows = actions.map(|action| description.normalisation.action.normalise(action).collect());
            Some((case.scenario.id.clone(), rows.collect()))
        })
        .collect();
    suite.cases = cases;
    let (description, by_scenario) = (Arc::new(description), Arc::new(by_scenario));
    let replay = PolicyFactory::of("recorded_rows", move |episode: &PolicyContext| {
        let rows = by_scenario.get(&episode.stage.scenario.id).cloned().unwrap_or_default();
        let (chunk, execute) = (description.model.chunk, description.execute);
        let predict = lookup(rows, chunk, execute);
        let policy = ChunkPolicy::new("recorded_rows", &description, predict, episode.stage)?;
        Ok(Box::new(policy) as Box<dyn Policy>)
    })?;
    let evaluation = EvaluateOptions { workers: options.workers, ..EvaluateOptions::default() };
    let reports = evaluate(&suite, &[replay], &evaluation, progress, stop)?;
    let Some(report) = reports.first() else { return Ok(None) };
    let successes = report.results.iter().filter(|result| result.success).count();
    let demonstrations = report.results.len();
    let replay_success = Rate::new(successes, demonstrations, &StatisticsSettings::default());
    Ok(Some(Checked { demonstrations, replay_success, expected: EXPECTED }))
}

/// Predictions from recorded rows: at each call those that follow the executed ones.
fn lookup(rows: Vec<Vec<f32>>, chunk: usize, execute: usize) -> impl FnMut(&Seen) -> io::Result<Prediction> + Send {
    let mut next = 0;
    move |_| {
        let row = |place: usize| rows.get(place).or(rows.last()).cloned().unwrap_or_default();
        let window = next..next + chunk;
        let end = window.clone().map(|place| if place < rows.len() { 0.0 } else { 1.0 }).collect();
        next += execute;
        Ok(Prediction { actions: window.map(row).collect(), end })
    }
}
