//! Controls of a learned policy: variants that differ from it in one respect, compared with it by success on the same
//! unseen layouts.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use genmanip_benchmark::distributions::{Distributions, Split, SplitChoice};
use genmanip_benchmark::statistics::{PairedComparison, Rate, StatisticsSettings, compare};
use genmanip_core::EpisodeResult;
use genmanip_pipeline::evaluate::{EvaluateOptions, Suite, evaluate};
use genmanip_pipeline::learn::controls;
use genmanip_workspace::Progress;
use serde::Serialize;

use crate::LabError;

/// Settings of [`measure`].
#[derive(Clone, Debug)]
pub struct ControlArguments {
    /// Folder of the learned policy.
    pub policy: PathBuf,
    /// Run that the policy was trained on.
    pub run: PathBuf,
    /// Folder of a suite of task distributions, with the unseen layouts.
    pub suite: PathBuf,
    /// Name of the only distribution to use; `None` for all.
    pub distribution: Option<String>,
    /// Number of unseen layouts of each distribution.
    pub layouts: usize,
    /// Names of the controls to evaluate; all if empty.
    pub only: Vec<String>,
    /// Number of worker threads.
    pub workers: usize,
}

/// Success of the policy and of its controls.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// Success rate of the unchanged policy.
    pub learned: Rate,
    /// Results of the controls.
    pub controls: Vec<Control>,
}

/// Result of one control.
#[derive(Clone, Debug, Serialize)]
pub struct Control {
    /// Name of the control.
    pub control: String,
    /// Success rate of the control.
    pub success: Rate,
    /// Paired comparison of the policy (first) with the control (second).
    pub comparison: PairedComparison,
}

/// Evaluates a policy and its [`controls`] on layouts of the split `familiar`.
///
/// # Errors
/// When policy, run or suite cannot be read, a control is unknown, or an episode raises an error.
pub fn measure(arguments: &ControlArguments, progress: &dyn Progress) -> Result<Measured, LabError> {
    let ControlArguments { policy, run, suite, distribution, layouts, only, workers } = arguments;
    let (stop, settings) = (AtomicBool::new(false), StatisticsSettings::default());
    let stopped = || LabError::input("the measurement was stopped");
    let mut policies = controls(policy, run, *workers, progress, &stop)?.ok_or_else(stopped)?;
    let known: Vec<String> = policies.iter().skip(1).map(|policy| policy.name().to_owned()).collect();
    if let Some(unknown) = only.iter().find(|name| !known.contains(name)) {
        return Err(LabError::input(format!("no control `{unknown}` of this policy; expected {}", known.join(", "))));
    }
    let mut place = 0;
    policies.retain(|policy| {
        place += 1;
        place == 1 || only.is_empty() || only.iter().any(|name| name == policy.name())
    });
    let choice =
        SplitChoice { split: Split::Familiar, distribution: distribution.clone(), first: Some(*layouts as u64) };
    let suite = Distributions::open(suite)?;
    let suite = Suite::of_split(&suite, &choice, *workers, progress, &stop)?.ok_or_else(stopped)?;
    let options = EvaluateOptions { workers: *workers, ..EvaluateOptions::default() };
    let reports = evaluate(&suite, &policies, &options, progress, &stop)?;
    let success = |results: &[EpisodeResult]| Rate::of(results.iter().map(|result| result.success), &settings);
    let Some((learned, others)) = reports.split_first() else { return Err(stopped()) };
    let others = others.iter().map(|report| {
        let comparison = compare(&learned.results, &report.results, &settings);
        let comparison = comparison.map_err(|error| LabError::input(error.to_string()))?;
        Ok(Control { control: report.label.clone(), success: success(&report.results), comparison })
    });
    Ok(Measured { learned: success(&learned.results), controls: others.collect::<Result<_, LabError>>()? })
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let mut text = format!("{:<16} {}\n", "learned", measured.learned);
    for Control { control, success, comparison } in &measured.controls {
        let difference = &comparison.difference;
        text += &format!(
            "{control:<16} {success}; learned minus it {:+.1} points ({:+.1} to {:+.1}), p = {:.3}\n",
            100.0 * difference.value,
            100.0 * difference.low,
            100.0 * difference.high,
            comparison.p_value
        );
    }
    text
}
