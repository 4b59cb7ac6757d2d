//! Paired comparison of two evaluations of one suite.

use std::collections::BTreeMap;
use std::path::Path;

use crate::statistics::{PairedComparison, detectable_difference};
use crate::suite_format::Perturbation;
use crate::{EvaluationReport, StatisticsSettings, compare as compare_results};
use genmanip_core::{EpisodeResult, TaskKind, limits};
use genmanip_workspace::text_table;
use serde::Serialize;

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Numbers of scenarios for which the smallest detectable difference is reported.
const SIZES: [usize; 6] = [50, 100, 200, 400, 800, 1600];

/// Paired comparison of two evaluations.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Name of the suite.
    pub suite: String,
    /// [`crate::suite_hash`] of the suite's scenarios.
    pub suite_hash: String,
    /// For each of the two evaluations, true if its policy read simulator truth.
    pub oracle: [bool; 2],
    /// Differences in time limits and stop rules, which make the comparison unfair; one text each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Comparison over all common episodes.
    pub overall: PairedComparison,
    /// Comparisons by kind of task; p-values are not corrected for multiple comparisons.
    pub kinds: Vec<KindComparison>,
    /// Smallest detectable differences for suites of other sizes.
    pub power: Vec<PowerRow>,
}

/// Comparison over the tasks of one kind.
#[derive(Clone, Debug, Serialize)]
pub struct KindComparison {
    /// Kind of task.
    pub kind: TaskKind,
    /// Comparison over the common episodes of this kind.
    #[serde(flatten)]
    pub pair: PairedComparison,
}

/// Statistical power of a suite of a given size.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PowerRow {
    /// Number of scenarios, one episode each.
    pub scenarios: usize,
    /// Smallest difference of success rates detectable with 80 % power, at this comparison's rate of discordant pairs;
    /// `None` if even the largest is not.
    pub detectable_difference: Option<f64>,
}

/// Compares the evaluations in two files.
///
/// # Errors
/// If a file is not an evaluation, the two are of different suites, or no episode is in both.
pub fn compare_files(first: &Path, second: &Path) -> Result<Comparison, WorkspaceError> {
    let read = |path: &Path| -> Result<EvaluationReport, WorkspaceError> {
        if path.is_dir() {
            return Err(WorkspaceError::input(format!("{} is a folder", path.display()))
                .with_hint("name an evaluation, such as RUN/evaluation/expert.json"));
        }
        documents::read_document(path, limits::EVALUATION)
    };
    let reports = [read(first)?, read(second)?];
    if origin(&reports[0]) != origin(&reports[1]) {
        let of = |report: &EvaluationReport| format!("suite {} ({})", report.suite, report.suite_hash);
        let [ours, theirs] = [of(&reports[0]), of(&reports[1])];
        return Err(WorkspaceError::input(format!(
            "{} is of {ours}, {} of {theirs}",
            first.display(),
            second.display()
        ))
        .with_hint("evaluate both policies on the same scenarios: only then can episodes be paired"));
    }
    compare_reports(&reports).map_err(|error| match error {
        None => WorkspaceError::input(format!("no episode is in both {} and {}", first.display(), second.display()))
            .with_hint("expected evaluations with the same scenarios and seeds"),
        Some(error) => WorkspaceError::broken("the evaluations cannot be compared", error),
    })
}

/// Hash of a report's suite, or of the suite it was derived from: a perturbed suite has the scenarios of its baseline,
/// each changed in one respect.
fn origin(report: &EvaluationReport) -> &str {
    report.perturbation.as_ref().map_or(&report.suite_hash, |perturbation| &perturbation.of_hash)
}

/// Compares two reports; `Err(None)` if they have no common episode.
fn compare_reports(reports: &[EvaluationReport; 2]) -> Result<Comparison, Option<crate::StatisticsError>> {
    let [first, second] = reports;
    let settings = StatisticsSettings::default();
    let of = |report: &EvaluationReport, kind: Option<TaskKind>| -> Vec<EpisodeResult> {
        let is_meant =
            |result: &&EpisodeResult| kind.is_none_or(|kind| report.kinds.get(&result.task_id) == Some(&kind));
        // Evaluations are distinguished by their labels, which include cameras.
        let label = arm(report);
        let named = |result: &EpisodeResult| EpisodeResult { policy: label.clone(), ..result.clone() };
        report.results.iter().filter(is_meant).map(named).collect()
    };
    let paired = |kind| compare_results(&of(first, kind), &of(second, kind), &settings).map_err(Some);
    let overall = paired(None)?;
    if overall.pairs == 0 {
        return Err(None);
    }
    let mut kinds = Vec::new();
    for kind in TaskKind::ALL {
        let pair = paired(Some(kind))?;
        if pair.pairs > 0 {
            kinds.push(KindComparison { kind, pair });
        }
    }
    let share = (overall.only_first + overall.only_second) as f64 / overall.pairs as f64;
    let row = |&scenarios: &usize| PowerRow {
        scenarios,
        detectable_difference: detectable_difference(scenarios, share, 1.0 - settings.coverage),
    };
    Ok(Comparison {
        suite: first.suite.clone(),
        suite_hash: first.suite_hash.clone(),
        oracle: [first.oracle, second.oracle],
        warnings: warnings(reports),
        power: SIZES.iter().map(row).collect(),
        overall,
        kinds,
    })
}

/// Texts on differences in time limits or stop rules of the common episodes.
fn warnings([first, second]: &[EvaluationReport; 2]) -> Vec<String> {
    let mut warnings = Vec::new();
    let horizons_s = |report: &EvaluationReport| -> BTreeMap<_, _> {
        report.results.iter().map(|it| ((it.scenario_id.clone(), it.seed), it.horizon_s)).collect()
    };
    let theirs = horizons_s(second);
    let differ = |(episode, &ours): (_, &f64)| Some((ours, *theirs.get(episode)?)).filter(|(a, b)| a != b);
    let unequal: Vec<(f64, f64)> = horizons_s(first).iter().filter_map(differ).collect();
    if let Some((a, b)) = unequal.first() {
        let count = unequal.len();
        warnings.push(format!("the horizons of {count} episodes differ (A {a} s, B {b} s): not the same task"));
    }
    if first.stop_on_success != second.stop_on_success {
        let (with, without) = if first.stop_on_success { ("A", "B") } else { ("B", "A") };
        warnings.push(format!(
            "episodes of {with} ended once the goal held, those of {without} when the policy was finished"
        ));
    }
    warnings
}

/// Label of an evaluation, with the perturbation of its suite.
fn arm(report: &EvaluationReport) -> String {
    let changed = |it: &Perturbation| format!("{} ({} {})", report.label, it.axis, it.dial);
    report.perturbation.as_ref().map_or_else(|| report.label.clone(), changed)
}

/// Text summary.
pub fn describe(comparison: &Comparison) -> String {
    let all = &comparison.overall;
    let oracle = |index: usize| if comparison.oracle[index] { " (oracle)" } else { "" };
    let mut text = format!(
        "{}: {} scenarios, {} episodes that both ran\nA  {}{}: {}\nB  {}{}: {}\n\n",
        comparison.suite,
        all.scenarios,
        all.pairs,
        all.first,
        oracle(0),
        all.first_success,
        all.second,
        oracle(1),
        all.second_success,
    );
    let head = ["kind", "episodes", "A", "B", "A - B", "95 %", "only A, only B", "p"];
    let mut rows = vec![head.map(String::from).to_vec(), row("all", all)];
    rows.extend(comparison.kinds.iter().map(|kind| row(kind.kind.name(), &kind.pair)));
    text += &text_table(&rows);
    text += &format!("\n{}\n", verdict(comparison));
    text.extend(comparison.warnings.iter().map(|warning| format!("warning: {warning}\n")));
    if all.unpaired > 0 {
        text += &format!("{} episodes of only one of them are left out\n", all.unpaired);
    }
    text + &describe_power(&comparison.power)
}

fn row(name: &str, pair: &PairedComparison) -> Vec<String> {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let points = |share: f64| format!("{:+.1}", 100.0 * share);
    vec![
        name.to_owned(),
        pair.pairs.to_string(),
        percent(pair.first_success.value),
        percent(pair.second_success.value),
        points(pair.difference.value),
        format!("{} to {}", points(pair.difference.low), points(pair.difference.high)),
        format!("{}, {}", pair.only_first, pair.only_second),
        if pair.p_value < 1e-4 { "< 0.0001".into() } else { format!("{:.4}", pair.p_value) },
    ]
}

/// Conclusion of the comparison in one or two sentences.
fn verdict(comparison: &Comparison) -> String {
    let all = &comparison.overall;
    let alpha = 1.0 - StatisticsSettings::default().coverage;
    let test = if all.scenarios == all.pairs { "exact McNemar test" } else { "exact permutation test by scenario" };
    let better = if all.difference.value > 0.0 { "A" } else { "B" };
    let mut text = match (all.p_value <= alpha, all.detectable_difference) {
        (true, _) => format!("{better} is better ({test}, p = {})", Short(all.p_value)),
        (false, Some(least)) => format!(
            "no difference found ({test}, p = {:.3}); a difference of {:.1} points is detectable with 80 % power",
            all.p_value,
            100.0 * least
        ),
        (false, None) => {
            format!("no difference found ({test}, p = {:.3}); these scenarios are too few to find any", all.p_value)
        }
    };
    if let Some(count) = all.sequential.decided_after {
        text += &format!("\nsequential test: {count} of {} scenarios would have been enough", all.scenarios);
    }
    text
}

/// Formatter of a p-value with two significant digits, tiny ones included.
struct Short(f64);

impl std::fmt::Display for Short {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 < 1e-3 {
            true => write!(f, "{:.1e}", self.0),
            false => write!(f, "{:.3}", self.0),
        }
    }
}

fn describe_power(power: &[PowerRow]) -> String {
    let head = ["scenarios", "difference detectable with 80 % power"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for row in power {
        let least = row.detectable_difference;
        rows.push(vec![
            row.scenarios.to_string(),
            least.map_or_else(|| "none".into(), |least| format!("{:.1} points", 100.0 * least)),
        ]);
    }
    format!("\nwhere policies differ as often as these two:\n{}", text_table(&rows))
}
