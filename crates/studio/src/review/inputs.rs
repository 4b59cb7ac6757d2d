//! Inputs of a review that the user names: evaluations of reference policies, target shares, and planted scenarios.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use genmanip_benchmark::EvaluationReport;
use genmanip_benchmark::balance::{MeasuredContents, measured_contents};
use genmanip_benchmark::leaderboard_files::evaluations_below;
use genmanip_benchmark::suite_format::Targets;
use genmanip_core::limits;
use genmanip_workspace::{Progress, WorkspaceError, documents};

/// Results, targets and planted scenarios, all empty unless the user names them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReviewInputs {
    /// Results of reference policies by content of the scenario, which give the axis `difficulty`.
    pub measured: MeasuredContents,
    /// Numbers of episodes that measure nothing here, by reason.
    pub left_out: BTreeMap<LeftOut, usize>,
    /// Target share of each value of an axis; an axis without targets wants all its values equally often.
    pub targets: Targets,
    /// Ids of the scenarios with planted faults, which no suite takes.
    pub planted: BTreeSet<String>,
}

impl ReviewInputs {
    /// Inputs with the results of these reports that name the content they are of; the others are counted.
    #[must_use]
    pub fn with_reports(mut self, reports: &[EvaluationReport]) -> Self {
        let engine = genmanip_sim::engine_version();
        let mut counted = Vec::new();
        for report in reports {
            for result in &report.results {
                let left_out = match report.scenario_sha256.get(&result.scenario_id) {
                    None => LeftOut::UnknownContent,
                    Some(_) if report.cameras.is_some() => LeftOut::OtherCameras,
                    Some(_) if result.engine != engine => LeftOut::OtherEngine,
                    Some(content) => {
                        counted.push((content.as_str(), result));
                        continue;
                    }
                };
                *self.left_out.entry(left_out).or_default() += 1;
            }
        }
        self.measured = measured_contents(counted);
        self
    }

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
        let mut reports: Vec<EvaluationReport> = Vec::new();
        for path in results {
            if path.is_dir() {
                reports.extend(evaluations_below(path, progress, |report| report)?);
            } else {
                reports.push(documents::read_document(path, limits::EVALUATION)?);
            }
        }
        let inputs = Self::default().with_reports(&reports);
        for (reason, episodes) in &inputs.left_out {
            progress.note(&format!("episodes of --results left out: {episodes}, {}", reason.text()));
        }
        Ok(Self {
            targets: targets.map(read_targets).transpose()?.unwrap_or_default(),
            planted: planted.map(read_planted).transpose()?.unwrap_or_default(),
            ..inputs
        })
    }
}

/// Reason why an episode of a reference policy measures no scenario of the review.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LeftOut {
    /// Its file names no content, as those of older versions.
    UnknownContent,
    /// Other cameras replaced those of the scenario.
    OtherCameras,
    /// Another version of the physics engine simulated it.
    OtherEngine,
    /// It is of a scenario under review, which was changed before or after.
    OtherContent,
}

impl LeftOut {
    /// The reason in words that complete a sentence about the episodes.
    pub const fn text(self) -> &'static str {
        match self {
            Self::UnknownContent => "since their evaluation is of an older version and does not name what it evaluated",
            Self::OtherCameras => "since other cameras replaced those of the scenarios",
            Self::OtherEngine => "since another version of the physics engine simulated them",
            Self::OtherContent => "since the scenario was different when they were run",
        }
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
