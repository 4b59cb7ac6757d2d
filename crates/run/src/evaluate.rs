//! Evaluating policies on the scenarios of a run: one results file per policy in `evaluation/`.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_bench::{EvaluationReport, StatisticsSettings, reference_paths_m, text_table};
use genmanip_core::{Document, EpisodeResult, Scenario};
use genmanip_data::EpisodeStore;
use genmanip_rollout::RolloutError;
use genmanip_rollout::collect::Resources;

use crate::error::RunError;
use crate::folder::RunFolder;
use crate::inputs;
use crate::policies::{PolicyContext, PolicyFactory};
use crate::progress::Progress;

/// Evaluates the policies, one after the other, on every scenario of a run, and writes one file for each.
///
/// When `stop` becomes true, the policy under way writes nothing and the reports of those before it are returned.
///
/// # Errors
/// When there is no run or no scenario, a file cannot be written, or an episode broke.
pub fn evaluate(
    path: &Path,
    policies: &[PolicyFactory],
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Vec<EvaluationReport>, RunError> {
    let (folder, run) = RunFolder::open(path)?;
    let store = folder.store()?;
    let planner = inputs::planner(&run.settings.world, &run.settings.planner)?;
    let resources = Resources { catalogue: Catalogue::builtin(), planner: &planner, grasps: GraspLibrary::builtin() };
    let scenarios = recorded_scenarios(&store)?;
    if scenarios.is_empty() {
        return Err(RunError::input(format!("{} has no scenario to evaluate on", path.display()))
            .with_hint("collect episodes first"));
    }
    let references = reference_paths_m(&collected_results(&store)?);
    let suite = path.file_name().unwrap_or_default().to_string_lossy();
    let mut reports = Vec::new();
    for policy in policies {
        let started = Instant::now();
        progress.begin(policy.label(), scenarios.len());
        let make = |stage: &_, recorded: &_| {
            let episode = PolicyContext {
                stage,
                recorded: Some(recorded),
                planner: &planner,
                grasps: resources.grasps,
                settings: &run.settings,
            };
            let unsuited =
                |error: RunError| RolloutError::Spec { policy: policy.label().into(), reason: error.to_string() };
            policy.make(&episode).map_err(unsuited)
        };
        let evaluated =
            genmanip_rollout::evaluate::evaluate(&store, &make, resources, &run.settings, workers, stop, &|_| {
                progress.advance()
            })
            .map_err(|error| RunError::broken(format!("evaluating {} stopped", policy.label()), error))?;
        progress.end();
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let report =
            EvaluationReport::new(&suite, &scenarios, evaluated.results, &references, &StatisticsSettings::default())
                .map_err(|error| RunError::broken(format!("cannot summarise {}", policy.label()), error))?
                .leaving(evaluated.not_run);
        let file = folder.join("evaluation").join(format!("{}.json", policy.label()));
        inputs::write_file(&file, report.to_json().as_bytes())?;
        folder.time_phase(&format!("evaluate {}", policy.label()), started.elapsed().as_secs_f64());
        reports.push(report);
    }
    folder.save_timings()?;
    Ok(reports)
}

/// A table of success rates with their intervals.
pub fn table(reports: &[EvaluationReport]) -> String {
    let mut lines = vec![["policy", "episodes", "success at end", "95 % interval", "score"].map(String::from).to_vec()];
    for report in reports {
        let success = &report.summary.success;
        lines.push(vec![
            format!("{}{}", report.policy, if report.oracle { " (oracle)" } else { "" }),
            success.trials.to_string(),
            format!("{:.1} %", 100.0 * success.value),
            format!("{:.1}–{:.1} %", 100.0 * success.low, 100.0 * success.high),
            format!("{:.3}", report.summary.score.value),
        ]);
    }
    text_table(&lines)
}

/// Scenarios of all recorded attempts, in the order of their ids.
fn recorded_scenarios(store: &EpisodeStore) -> Result<Vec<Scenario>, RunError> {
    let unreadable = |error| RunError::broken("cannot read the episodes", error);
    let mut scenarios = Vec::new();
    for id in store.ids().map_err(unreadable)? {
        if store.is_recorded(&id).map_err(unreadable)? {
            scenarios.extend(store.read_scenario(&id).map_err(unreadable)?);
        }
    }
    Ok(scenarios)
}

/// Results of all collected episodes, in the order of their ids.
fn collected_results(store: &EpisodeStore) -> Result<Vec<EpisodeResult>, RunError> {
    let unreadable = |error| RunError::broken("cannot read the episodes", error);
    let ids = store.ids().map_err(unreadable)?;
    ids.iter().map(|id| store.read_result(id).map_err(unreadable)).collect()
}
