//! Ablation of the agent: one setting changed at a time, compared on the same episodes.

use std::sync::atomic::AtomicBool;

use genmanip_benchmark::statistics::{Mean, StatisticsSettings, compare, wilson_interval};
use genmanip_core::EpisodeResult;
use genmanip_workspace::text_table;
use serde::Serialize;

use crate::evaluate::{EvaluateOptions, Suite, evaluate};
use crate::policies::PolicyFactory;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;

/// Arguments of the agent policy that can be ablated, with their values.
pub const ABLATIONS: [(&str, &[&str]); 6] = [
    ("ctof", &["yes"]),
    ("path", &["grid"]),
    ("loop", &["open"]),
    ("reasoning", &["yes"]),
    ("camera", &["left", "right"]),
    ("preset", &["paper"]),
];

/// Table of an ablation.
#[derive(Debug, Serialize)]
pub struct Ablation {
    /// Name of the suite or run.
    pub suite: String,
    /// True if any row's agent read simulator truth.
    pub oracle: bool,
    /// The unchanged agent (baseline), then one row per change.
    pub rows: Vec<Row>,
}

/// Results of one variant of the agent on all scenarios.
#[derive(Debug, Serialize)]
pub struct Row {
    /// Changed setting, e.g. `path=grid`; empty for the baseline.
    pub change: String,
    /// Label of its evaluation.
    pub label: String,
    /// Number of episodes that were run.
    pub episodes: usize,
    /// Success rate, 0 to 1.
    pub success: f64,
    /// 95 % Wilson interval of the success rate.
    pub success_interval: [f64; 2],
    /// Mean score, 0 to 1.
    pub score: f64,
    /// Success rate minus that of the baseline, on the episodes that both ran; `None` for the baseline.
    pub difference: Option<Mean>,
    /// Number of episodes that only this variant solves, and that only the baseline solves; `None` for the baseline.
    pub only: Option<[usize; 2]>,
    /// Two-sided p-value of the difference (exact McNemar test); `None` for the baseline.
    pub p_value: Option<f64>,
}

/// Evaluates the agent with `arguments` (`vlm=…,masks=…`), and again with each other value of the named settings
/// (`dials`). Finished evaluations are reused.
///
/// # Errors
/// Those of [`evaluate`]; an unknown setting, and one that `arguments` already fixes.
pub fn ablate(
    suite: &Suite,
    arguments: &str,
    dials: &[String],
    options: &EvaluateOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<Ablation>, WorkspaceError> {
    let changes = changes(arguments, dials)?;
    let policy = |change: &String| {
        let parts: Vec<&str> = [arguments, change].into_iter().filter(|part| !part.is_empty()).collect();
        PolicyFactory::resolve(&format!("agent:{}", parts.join(",")))
    };
    let policies = changes.iter().map(policy).collect::<Result<Vec<_>, _>>()?;
    let reports = evaluate(suite, &policies, options, progress, stop)?;
    if reports.len() < policies.len() {
        return Ok(None);
    }
    let base = reports[0].results.clone();
    let rows =
        changes.into_iter().zip(&reports).map(|(change, report)| row(change, &report.label, &report.results, &base));
    Ok(Some(Ablation {
        suite: reports[0].suite.clone(),
        oracle: reports.iter().any(|report| report.oracle),
        rows: rows.collect::<Result<_, _>>()?,
    }))
}

/// All changes as `NAME=VALUE`; the first is empty, for the baseline.
fn changes(arguments: &str, dials: &[String]) -> Result<Vec<String>, WorkspaceError> {
    let known: Vec<&str> = ABLATIONS.iter().map(|(name, _)| *name).collect();
    if let Some(unknown) = dials.iter().find(|dial| !known.contains(&dial.as_str())) {
        return Err(WorkspaceError::unknown("setting", "settings", unknown, &known));
    }
    let mut changes = vec![String::new()];
    for (name, values) in ABLATIONS.iter().filter(|(name, _)| dials.is_empty() || dials.iter().any(|dial| dial == name))
    {
        let is_set = arguments.split(',').any(|part| part.split('=').next() == Some(name));
        if is_set && !dials.is_empty() {
            return Err(WorkspaceError::input(format!("`{name}` is both set and to be changed"))
                .with_hint("leave it out of --agent, or out of --vary"));
        }
        changes.extend(values.iter().filter(|_| !is_set).map(|value| format!("{name}={value}")));
    }
    Ok(changes)
}

fn row(change: String, label: &str, results: &[EpisodeResult], base: &[EpisodeResult]) -> Result<Row, WorkspaceError> {
    let settings = StatisticsSettings::default();
    let successes = results.iter().filter(|result| result.success).count();
    let count = results.len().max(1) as f64;
    let paired = match change.is_empty() {
        true => None,
        false => {
            let paired = compare(results, base, &settings);
            Some(paired.map_err(|error| WorkspaceError::broken("the evaluations cannot be compared", error))?)
        }
    };
    Ok(Row {
        change,
        label: label.into(),
        episodes: results.len(),
        success: successes as f64 / count,
        success_interval: wilson_interval(successes, results.len(), settings.z),
        score: results.iter().map(|result| result.verdict.score).sum::<f64>() / count,
        only: paired.as_ref().map(|paired| [paired.only_first, paired.only_second]),
        p_value: paired.as_ref().map(|paired| paired.p_value),
        difference: paired.map(|paired| paired.difference),
    })
}

/// The table as text.
pub fn describe(ablation: &Ablation) -> String {
    let head = ["change", "episodes", "success", "95 %", "score", "difference", "only this, only as it is", "p"];
    let mut rows = vec![head.map(String::from).to_vec()];
    let percent = |share: f64| format!("{:.1}", 100.0 * share);
    for row in &ablation.rows {
        let [low, high] = row.success_interval.map(percent);
        let name = if row.change.is_empty() { "as it is" } else { &row.change };
        rows.push(vec![
            name.to_owned(),
            row.episodes.to_string(),
            format!("{} %", percent(row.success)),
            format!("{low}–{high} %"),
            format!("{:.3}", row.score),
            row.difference.as_ref().map_or_else(String::new, |mean| format!("{:+.1} points", 100.0 * mean.value)),
            row.only.map_or_else(String::new, |[this, base]| format!("{this}, {base}")),
            row.p_value.map_or_else(String::new, |p| format!("{p:.3}")),
        ]);
    }
    let oracle = if ablation.oracle { " (oracle)" } else { "" };
    format!("{}{oracle}\n{}", ablation.suite, text_table(&rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_setting_changes_at_a_time_and_none_that_is_set() {
        let all = changes("vlm=oracle", &[]).unwrap();
        let expected =
            ["", "ctof=yes", "path=grid", "loop=open", "reasoning=yes", "camera=left", "camera=right", "preset=paper"];
        assert_eq!(all, expected);
        assert_eq!(changes("path=grid,vlm=oracle", &[]).unwrap().len(), all.len() - 1);
        assert_eq!(changes("", &["loop".into()]).unwrap(), ["", "loop=open"]);
        let cases = [("", "lop", "unknown setting `lop`"), ("path=grid", "path", "both set and to be changed")];
        for (arguments, dial, expected) in cases {
            let error = changes(arguments, &[dial.into()]).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        // Every value must be accepted by the policy.
        for change in &all {
            PolicyFactory::resolve(&format!("agent:{change}")).unwrap();
        }
    }
}
