//! What a frozen suite is worth: that it is sound, and how often the expert solves it by streams it was not chosen by.

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

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Scenarios of the suite.
    pub scenarios: usize,
    /// Of each type.
    pub per_type: BTreeMap<String, usize>,
    /// Success of the expert, by scenario.
    pub expert_success: Rate,
    /// Success weighted by path length, against the shortest way of the certificates.
    pub spl: Option<Mean>,
    /// Largest deviation of a balanced trait from its even share, as a part of that.
    pub worst_marginal: f64,
    /// Designs refused since their goal was clear without what their type is about.
    pub necessity_rejected: usize,
    /// Processor time of checking the suite, s.
    pub check_s: f64,
    /// What is wrong with the suite.
    pub faults: Vec<String>,
}

/// Checks a suite, and lets the expert try every scenario `episodes` times.
///
/// # Errors
/// When the suite cannot be read, or an episode broke.
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

/// The same in words.
pub fn in_words(report: &Report) -> String {
    let mut rows = vec![["type", "scenarios"].map(String::from).to_vec()];
    rows.extend(report.per_type.iter().map(|(kind, count)| vec![kind.clone(), count.to_string()]));
    let mut text = format!(
        "{}expert          {}\nSPL             {}\nworst marginal  {:.0} % of its share\nrefused         {} clear without their \
         clue\ncheck           {:.1} s of processor time\n",
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
