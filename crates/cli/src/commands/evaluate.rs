//! `genmanip evaluate`.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use genmanip_assets::Catalogue;
use genmanip_bench::{EvaluationReport, StatisticsSettings};
use genmanip_core::{Document, Scenario};
use genmanip_rollout::collect::Resources;
use genmanip_rollout::evaluate::{BuiltinPolicy, evaluate};

use crate::args::EvaluateArguments;
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::printer::{Printer, table};
use crate::run_folder::RunFolder;

pub fn run(arguments: &EvaluateArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let stop = crate::stop::on_interrupt();
    let reports = evaluate_run(arguments, printer, &stop)?;
    let values: Vec<_> = reports.iter().map(Document::to_value).collect();
    printer.data(&values, &summary(&reports));
    Ok(if stop.load(Ordering::Relaxed) { ExitStatus::NotMet } else { ExitStatus::Done })
}

/// Evaluates the policies on the scenarios of a run and writes one file per policy.
pub fn evaluate_run(
    arguments: &EvaluateArguments,
    printer: &Printer,
    stop: &AtomicBool,
) -> Result<Vec<EvaluationReport>, Failed> {
    let policies = chosen(&arguments.policies)?;
    let (folder, run) = RunFolder::open(&arguments.run)?;
    let store = folder.store()?;
    let planner = inputs::planner(&run.settings.planner)?;
    let resources = Resources { catalogue: Catalogue::builtin(), planner: &planner };
    let scenarios = recorded_scenarios(&store)?;
    if scenarios.is_empty() {
        return Err(Failed::new(format!("{} has no scenario to evaluate on", arguments.run.display()))
            .hint("collect episodes first"));
    }
    let mut reports = Vec::new();
    for policy in policies {
        let started = Instant::now();
        let bar = printer.progress(policy.name(), scenarios.len());
        let workers = inputs::workers(arguments.workers);
        let evaluated = evaluate(&store, policy, resources, &run.settings, workers, stop, &|_| bar.inc(1))
            .map_err(|error| Failed::because(format!("evaluating {} stopped", policy.name()), &error))?;
        bar.finish_and_clear();
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let name = arguments.run.file_name().unwrap_or_default().to_string_lossy();
        let report = EvaluationReport::new(
            &name,
            &scenarios,
            evaluated.results,
            &BTreeMap::new(),
            &StatisticsSettings::default(),
        )
        .map_err(|error| Failed::because(format!("cannot summarise {}", policy.name()), &error))?
        .leaving(evaluated.not_run);
        let path = folder.join("evaluation").join(format!("{}.json", policy.name()));
        inputs::write_file(&path, report.to_json().as_bytes())?;
        folder.time_phase(&format!("evaluate {}", policy.name()), started.elapsed().as_secs_f64());
        reports.push(report);
    }
    folder.save_timings()?;
    Ok(reports)
}

/// Scenarios of all recorded attempts, in the order of their ids.
pub fn recorded_scenarios(store: &genmanip_data::EpisodeStore) -> Result<Vec<Scenario>, Failed> {
    let unreadable = |error| Failed::because("cannot read the episodes", &error);
    let mut scenarios = Vec::new();
    for id in store.ids().map_err(unreadable)? {
        if store.is_recorded(&id).map_err(unreadable)? {
            scenarios.extend(store.read_scenario(&id).map_err(unreadable)?);
        }
    }
    Ok(scenarios)
}

/// A table of success rates with their intervals.
pub fn summary(reports: &[EvaluationReport]) -> String {
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
    table(&lines)
}

fn chosen(names: &[String]) -> Result<Vec<BuiltinPolicy>, Failed> {
    if names.is_empty() {
        return Ok(BuiltinPolicy::ALL.to_vec());
    }
    names
        .iter()
        .map(|name| {
            BuiltinPolicy::ALL.into_iter().find(|policy| policy.name() == name).ok_or_else(|| {
                let known = BuiltinPolicy::ALL.map(BuiltinPolicy::name).join(", ");
                Failed::new(format!("unknown policy `{name}`")).hint(format!("policies are {known}"))
            })
        })
        .collect()
}
