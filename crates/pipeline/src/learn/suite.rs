//! Demonstrations of the training layouts of a suite of task distributions.

use std::sync::atomic::AtomicBool;

use genmanip_assets::worlds::default_world;
use genmanip_benchmark::distributions::{Distributions, Split, SplitChoice};
use genmanip_core::ExpertStyle;
use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::expert::ExpertSettings;
use genmanip_workspace::documents::nearest_folder;
use genmanip_workspace::task_spool::Tasks;
use genmanip_workspace::{Progress, WorkspaceError};

use super::options::SuiteDemonstrations;
use crate::collect::{CollectOptions, collect};
use crate::folder::Run;

/// Collects the demonstrations that the run lacks, as `genmanip collect --suite SUITE --split train --verified N
/// --expert consistent --no-dataset` does; false if interrupted.
///
/// # Errors
/// When the distribution does not exist, the folder holds another run, or a layout is never solved.
pub fn demonstrate(
    options: &SuiteDemonstrations,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<bool, WorkspaceError> {
    let SuiteDemonstrations { suite, distribution, count, run, workers } = options;
    let suite = Distributions::open(suite)?;
    let choice = SplitChoice { split: Split::Train, distribution: distribution.clone(), first: None };
    let folder = nearest_folder(run).unwrap_or_else(|| ".".into());
    let tasks = Tasks::spool(suite.draw(&choice)?.into_iter().map(|drawn| drawn.task), &folder)?;
    let expert = ExpertSettings { style: ExpertStyle::Consistent, ..ExpertSettings::default() };
    let settings = PipelineSettings { expert, ..PipelineSettings::in_world(suite.judged_in(&default_world())) };
    let asked = CollectOptions { workers: *workers, verified: Some(*count), ..CollectOptions::default() };
    let collected = collect(run, Run::new(tasks, 0, settings, suite.seed()), asked, progress, stop)?;
    let verified: usize = collected.rows.iter().map(|row| row.verified).sum();
    if !collected.interrupted && verified < *count {
        return Err(WorkspaceError::input(format!("{} has {verified} of {count} demonstrations", run.display()))
            .with_hint("ask for fewer; `genmanip report` on that run says why attempts failed"));
    }
    Ok(!collected.interrupted)
}
