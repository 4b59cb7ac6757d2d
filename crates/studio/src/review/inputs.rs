//! Inputs of a review that the user names: evaluations of reference policies, target shares, and planted scenarios.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use genmanip_benchmark::EvaluationReport;
use genmanip_benchmark::balance::{Successes, successes};
use genmanip_benchmark::leaderboard_files::evaluations_below;
use genmanip_benchmark::suite_format::Targets;
use genmanip_core::{EpisodeResult, limits};
use genmanip_workspace::{Progress, WorkspaceError, documents};

/// Results, targets and planted scenarios, all empty unless the user names them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReviewInputs {
    /// Successes of reference policies, which give the axis `difficulty`.
    pub successes: Successes,
    /// Target share of each value of an axis; an axis without targets wants all its values equally often.
    pub targets: Targets,
    /// Ids of the scenarios with planted faults, which no suite takes.
    pub planted: BTreeSet<String>,
}

impl ReviewInputs {
    /// Reads evaluation files, or all of those below a folder such as a run; a JSON file of targets; and a file with the
    /// ids of planted scenarios, the first word of each line.
    ///
    /// # Errors
    /// When a file is missing or damaged, a folder has no evaluation, or the targets do not fit ([`check_targets`]).
    pub fn read(
        results: &[PathBuf],
        targets: Option<&Path>,
        planted: Option<&Path>,
        progress: &dyn Progress,
    ) -> Result<Self, WorkspaceError> {
        let mut all: Vec<EpisodeResult> = Vec::new();
        for path in results {
            if path.is_dir() {
                all.extend(evaluations_below(path, progress, |report| report.results)?.into_iter().flatten());
            } else {
                let report: EvaluationReport = documents::read_document(path, limits::EVALUATION)?;
                all.extend(report.results);
            }
        }
        Ok(Self {
            successes: successes(&all),
            targets: targets.map(read_targets).transpose()?.unwrap_or_default(),
            planted: planted.map(read_planted).transpose()?.unwrap_or_default(),
        })
    }
}

/// Checks that the target shares of each axis are from 0 to 1 and sum to 1.
///
/// # Errors
/// A message that names the axis.
pub fn check_targets(targets: &Targets) -> Result<(), String> {
    for (axis, shares) in targets {
        let sum: f64 = shares.values().sum();
        if shares.values().any(|share| !(0.0..=1.0).contains(share)) || (sum - 1.0).abs() > 1e-6 {
            return Err(format!("the shares of `{axis}` sum to {sum}"));
        }
    }
    Ok(())
}

/// Form of targets, as a hint for errors.
pub const TARGETS_HINT: &str =
    r#"expected target shares from 0 to 1 that sum to 1: {"relation": {"left": 0.5, "right": 0.5}}"#;

fn read_targets(path: &Path) -> Result<Targets, WorkspaceError> {
    let wrong =
        |message: String| WorkspaceError::input(format!("{}: {message}", path.display())).with_hint(TARGETS_HINT);
    let text = documents::read_text(path, limits::SETTINGS)?;
    let value = genmanip_core::json::parse(&text).map_err(|error| wrong(error.to_string()))?;
    let targets: Targets = serde_json::from_value(value).map_err(|error| wrong(error.to_string()))?;
    check_targets(&targets).map_err(wrong)?;
    Ok(targets)
}

fn read_planted(path: &Path) -> Result<BTreeSet<String>, WorkspaceError> {
    let text = documents::read_text(path, limits::SETTINGS)?;
    Ok(text.lines().filter_map(|line| line.split_whitespace().next()).map(String::from).collect())
}
