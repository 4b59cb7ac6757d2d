//! `genmanip collect`: demonstrations of tasks by the expert, as a run.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use genmanip_benchmark::distributions::Distributions;
use genmanip_core::Seed;
use genmanip_pipeline::Run;
use genmanip_pipeline::collect::{CollectOptions, Collected, collect};
use genmanip_pipeline::merge::merge;
use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::expert::ExpertSettings;
use genmanip_rollout::images::ImageSettings;
use genmanip_viz::render::AppearanceFactor;
use genmanip_workspace::documents::nearest_folder;
use genmanip_workspace::task_spool::Tasks;
use genmanip_workspace::{task_files, workers, worlds};

use super::plural;
use crate::args::{CollectArguments, MergeArguments, Part};
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

/// Default number of attempts per task.
const ATTEMPTS_PER_TASK: usize = 2;
/// Default number of attempts per layout of a suite: only the first attempt uses the frozen layout.
const ATTEMPTS_PER_LAYOUT: usize = 1;

pub fn run(arguments: &CollectArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let Planned { tasks, seed, attempts, suite } = planned(arguments)?;
    let (vary, vary_physics) = varied(arguments)?;
    let world = worlds::read_world_with(arguments.world.as_deref(), arguments.robot.as_deref())?;
    let world = suite.map_or_else(|| world.clone(), |suite| suite.judged_in(&world));
    let cameras = worlds::cameras(&world, &arguments.cameras)?;
    let images = (!arguments.no_dataset).then(|| ImageSettings {
        fps: arguments.rate,
        cameras,
        vary,
        ..ImageSettings::default()
    });
    let (keep_failed, grasps) = (arguments.keep_failed, arguments.grasps.clone());
    let corrects = arguments.corrections.clone();
    let expert = ExpertSettings { style: arguments.expert, ..ExpertSettings::default() };
    let settings = PipelineSettings {
        images,
        keep_failed,
        grasps,
        vary_physics,
        corrects,
        expert,
        skills: genmanip_pipeline::skills::files(&arguments.skill)?,
        ..PipelineSettings::in_world(world)
    };
    let run = Run::new(tasks, if arguments.verified.is_some() { 0 } else { attempts }, settings, seed);
    let stop = genmanip_terminal::on_interrupt();
    let shard = arguments.shard.map(|choice| choice.resolve(&genmanip_terminal::environment)).transpose()?;
    let options = CollectOptions {
        workers: workers::workers(arguments.workers),
        repair: arguments.repair,
        shard,
        verified: arguments.verified,
        keep_going: arguments.keep_going,
    };
    let out = shard.map_or_else(|| arguments.out.clone(), |shard| arguments.out.join(shard.name()));
    let collected = collect_run(&out, run, options, printer, &stop)?;
    if let Some(shard) = shard {
        printer.say(format!("{shard}: {}", out.display()));
    }
    printer.data(&collected.rows, &collected.table(arguments.each));
    Ok(status(&collected))
}

/// Tasks and attempts that the arguments of `collect` select.
pub struct Planned {
    /// The tasks; of a suite of task distributions, one per layout.
    pub tasks: Tasks,
    /// Seed of the run's attempts.
    pub seed: Seed,
    /// Number of attempts per task.
    pub attempts: usize,
    /// Suite of task distributions; `None` if task files were given.
    pub suite: Option<Distributions>,
}

/// Reads the tasks, or draws those of a suite of task distributions, as the arguments say.
pub fn planned(arguments: &CollectArguments) -> Result<Planned, Failed> {
    let Some((suite, choice)) = arguments.layouts.layouts(arguments.suite.as_deref())? else {
        let tasks = task_files::spool_tasks(&arguments.tasks, &arguments.out)?;
        let attempts = arguments.episodes.unwrap_or(ATTEMPTS_PER_TASK);
        return Ok(Planned { tasks, seed: Seed::new(arguments.seed), attempts, suite: None });
    };
    let folder = nearest_folder(&arguments.out).unwrap_or_else(|| ".".into());
    let tasks = Tasks::spool(suite.draw(&choice)?.into_iter().map(|drawn| drawn.task), &folder)?;
    let attempts = arguments.episodes.unwrap_or(ATTEMPTS_PER_LAYOUT);
    Ok(Planned { tasks, seed: suite.seed(), attempts, suite: Some(suite) })
}

pub fn merge_run(arguments: &MergeArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let stop = genmanip_terminal::on_interrupt();
    let options = CollectOptions { workers: workers::workers(arguments.workers), ..CollectOptions::default() };
    let merged = merge(&arguments.shards, &arguments.out, arguments.finish, options, printer, &stop)?;
    tell(&merged, printer);
    printer.data(&merged.rows, &merged.table(arguments.each));
    Ok(status(&merged))
}

/// Appearance factors that are randomised in every episode, and true if physics is randomised as well.
fn varied(arguments: &CollectArguments) -> Result<(Vec<AppearanceFactor>, bool), Failed> {
    if arguments.variation.is_none() {
        return Ok((Vec::new(), false));
    }
    let named = |part: &Part| if let Part::Appearance(look) = part { Some(*look) } else { None };
    let looks: Vec<AppearanceFactor> = arguments.vary.iter().filter_map(named).collect();
    let physics = arguments.vary.contains(&Part::Physics);
    if arguments.no_dataset && (!looks.is_empty() || !physics) {
        return Err(Failed::misused("--no-dataset draws no pictures, so their look cannot differ")
            .hint("with it only `--vary physics` has an effect"));
    }
    Ok((if physics && looks.is_empty() { Vec::new() } else { vary(&looks) }, physics))
}

/// Randomised appearance factors: the named ones in canonical order, or all if none is named.
pub fn vary(named: &[AppearanceFactor]) -> Vec<AppearanceFactor> {
    AppearanceFactor::ALL.into_iter().filter(|part| named.is_empty() || named.contains(part)).collect()
}

/// Collects a run and prints its result; also used by `demo`.
pub fn collect_run(
    out: &Path,
    run: Run,
    options: CollectOptions,
    printer: &Printer,
    stop: &AtomicBool,
) -> Result<Collected, Failed> {
    let collected = collect(out, run, options, printer, stop)?;
    tell(&collected, printer);
    Ok(collected)
}

fn tell(collected: &Collected, printer: &Printer) {
    if let Some(dataset) = &collected.dataset {
        printer.say(format!("dataset: {}", dataset.display()));
    }
    if collected.interrupted {
        let Collected { finished, attempts, .. } = collected;
        printer.say(format!("interrupted after {finished} of {attempts} attempts; start again to continue"));
    }
    if !collected.not_run.is_empty() {
        let count = collected.not_run.len();
        printer.say(format!("not run: {}; start again to make them", plural(count, "attempt")));
    }
    if !collected.damaged.is_empty() {
        let count = collected.damaged.len();
        printer
            .say(format!("{} left out; start again with --repair to make them anew", plural(count, "damaged episode")));
    }
}

pub fn status(collected: &Collected) -> ExitStatus {
    if collected.is_met() { ExitStatus::Done } else { ExitStatus::NotMet }
}
