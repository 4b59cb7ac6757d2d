//! Validity of a frozen suite, and success of the expert on it with fresh random streams.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use genmanip_benchmark::statistics::{Mean, Rate};
use genmanip_core::Seed;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::{EvaluateOptions, Suite, evaluate};
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;

use genmanip_benchmark::suites;
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;

/// Validity of a suite, and results of the expert on it.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Number of scenarios that were checked.
    pub scenarios: usize,
    /// Number of scenarios by kind of task.
    pub per_type: BTreeMap<String, usize>,
    /// Success rate of the expert, clustered by scenario.
    pub expert_success: Rate,
    /// Success weighted by path length (SPL), relative to the shortest path of the certificates; `None` if unknown.
    pub spl: Option<Mean>,
    /// Largest relative deviation of a balanced trait's frequency from an even share.
    pub worst_marginal: f64,
    /// Number of designs rejected while the suite was built, because the goal was clear without the property that
    /// defines
    /// their kind.
    pub necessity_rejected: usize,
    /// CPU time of checking the suite, s.
    pub check_s: f64,
    /// Faults found by the check, a text each; empty for a valid suite.
    pub faults: Vec<String>,
}

/// Checks a suite, and runs the expert on every scenario `episodes` times.
///
/// # Errors
/// If the suite cannot be read, or an episode raises an error.
pub fn measure(
    folder: &Path,
    episodes: usize,
    seed: Seed,
    workers: usize,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let mut clock = cpu_clock();
    let started = clock();
    let checked = suites::check(folder, workers, progress, &AtomicBool::new(false))?;
    let checked = checked.ok_or_else(|| LabError::input("the check was stopped"))?;
    let check_s = clock() - started;
    let shown = suites::show(folder)?;
    let suite = Suite::frozen(folder)?.with_episodes(episodes).with_seed(seed);
    let options = EvaluateOptions { workers, ..EvaluateOptions::default() };
    let expert = [PolicyFactory::resolve("expert")?];
    let reports = evaluate(&suite, &expert, &options, progress, &AtomicBool::new(false))?;
    let summary = &reports.first().ok_or_else(|| LabError::input("the expert was not evaluated"))?.summary;
    let mut per_type: BTreeMap<String, usize> = BTreeMap::new();
    for entry in &shown.file.scenarios {
        *per_type.entry(entry.kind.name().into()).or_default() += 1;
    }
    let refused = shown.file.funnel.iter().flat_map(|stage| &stage.refused);
    Ok(Report {
        scenarios: checked.scenarios,
        per_type,
        expert_success: summary.success,
        spl: summary.spl,
        worst_marginal: checked.worst_marginal,
        necessity_rejected: refused.filter(|(why, _)| why.contains("is clear without")).map(|(_, count)| count).sum(),
        check_s,
        faults: checked.faults,
    })
}

/// Text summary.
pub fn describe(report: &Report) -> String {
    let mut rows = vec![["type", "scenarios"].map(String::from).to_vec()];
    rows.extend(report.per_type.iter().map(|(kind, count)| vec![kind.clone(), count.to_string()]));
    let mut text = format!(
        "{}expert          {}\nSPL             {}\nworst marginal  {:.0} % of its share\nrefused         {} clear without their \
         clue\ncheck           {:.1} s of CPU time\n",
        text_table(&rows),
        report.expert_success,
        report.spl.map_or_else(|| "none".into(), |spl| format!("{:.3}", spl.value)),
        100.0 * report.worst_marginal,
        report.necessity_rejected,
        report.check_s,
    );
    for fault in &report.faults {
        text += &format!("  {fault}\n");
    }
    text
}
