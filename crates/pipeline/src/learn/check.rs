//! Check before training: recorded rows, executed like predictions of a learned policy, must solve their layouts.
//!
//! The check fails if the actions do not mean what the policy's contract says, if rows are shifted by one or have
//! another rate, or if normalisation, chunks or the end of an episode are handled wrongly.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_benchmark::statistics::{Rate, StatisticsSettings};
use genmanip_core::Policy;
use genmanip_workspace::{Progress, WorkspaceError};

use super::demonstrations;
use super::options::{CheckOptions, Checked};
use super::presets::settings;
use super::recorded::{Recorded, without_images};
use crate::evaluate::{EvaluateOptions, Suite, evaluate};
use crate::learned::policy::ChunkPolicy;
use crate::policies::{PolicyContext, PolicyFactory};

/// Minimum success rate of the recorded rows, played back open loop at their own rate. Chosen by hand.
const EXPECTED: f64 = 0.95;

/// Replays demonstrations of a run; `None` if interrupted.
///
/// # Errors
/// When the run cannot be read, or an episode raises an error.
pub fn check(
    options: &CheckOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<Checked>, WorkspaceError> {
    let preset = without_images(settings(options.preset, false));
    let Some(read) = demonstrations::read(&options.run, &[], &preset, options.workers, progress, stop)? else {
        return Ok(None);
    };
    let recorded = Arc::new(Recorded::of(options.preset, preset, &read));
    let places: BTreeMap<String, usize> = read.ids.into_iter().zip(0..).collect();
    let mut suite = Suite::of_run(&options.run)?;
    let (scenarios, mut cases) = (std::mem::take(&mut suite.scenarios), std::mem::take(&mut suite.cases));
    cases.retain(|case| places.contains_key(&case.id));
    cases.truncate(options.demonstrations);
    let is_kept = |id: &str| cases.iter().any(|case| case.scenario.id == id);
    suite.scenarios = scenarios.into_iter().filter(|scenario| is_kept(&scenario.id)).collect();
    let by_scenario: BTreeMap<String, usize> =
        cases.iter().filter_map(|case| Some((case.scenario.id.clone(), *places.get(&case.id)?))).collect();
    suite.cases = cases;
    let replay = PolicyFactory::of("recorded_rows", move |episode: &PolicyContext| {
        let own = by_scenario.get(&episode.stage.scenario.id).copied();
        let predict = recorded.lookup(move |_, _| own);
        let policy = ChunkPolicy::new("recorded_rows", &recorded.description, predict, episode.stage)?;
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
