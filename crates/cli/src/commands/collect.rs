//! `genmanip collect`.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use genmanip_assets::{Catalogue, panda};
use genmanip_core::{Document, EpisodeResult, Seed, Task, TaskKind};
use genmanip_data::EpisodeStore;
use genmanip_data::lerobot::{self, LerobotSettings, Selection};
use genmanip_rollout::collect::{Attempt, CollectSettings, Resources, collect};
use genmanip_rollout::images::ImageSettings;
use serde::Serialize;

use crate::args::CollectArguments;
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::printer::{Printer, table};
use crate::run_folder::{Run, RunFolder};

/// One line of the table: a task and what became of its attempts.
#[derive(Debug, Serialize)]
pub struct TaskRow {
    pub task: String,
    pub kind: TaskKind,
    pub attempts: usize,
    pub verified: usize,
    pub failures: Vec<String>,
    pub seconds: f64,
}

pub fn run(arguments: &CollectArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let tasks = inputs::read_tasks(&arguments.tasks)?;
    let stop = crate::stop::on_interrupt();
    let collected = collect_run(arguments, tasks, printer, &stop)?;
    printer.data(&collected.rows, &collected.text());
    Ok(collected.status())
}

/// What a run came to.
pub struct Collected {
    pub folder: RunFolder,
    pub rows: Vec<TaskRow>,
    pub interrupted: bool,
}

impl Collected {
    pub fn status(&self) -> ExitStatus {
        let any = self.rows.iter().any(|row| row.verified > 0);
        if any && !self.interrupted { ExitStatus::Done } else { ExitStatus::NotMet }
    }

    pub fn text(&self) -> String {
        let mut lines =
            vec![["task", "kind", "attempts", "verified", "why others failed", "seconds"].map(String::from).to_vec()];
        for row in &self.rows {
            lines.push(vec![
                row.task.clone(),
                row.kind.name().into(),
                row.attempts.to_string(),
                row.verified.to_string(),
                shortened(&row.failures.join("; "), 60),
                format!("{:.1}", row.seconds),
            ]);
        }
        let (attempts, verified) = self.rows.iter().fold((0, 0), |(a, v), row| (a + row.attempts, v + row.verified));
        let share = 100.0 * verified as f64 / attempts.max(1) as f64;
        lines.push(vec![
            "all".into(),
            String::new(),
            attempts.to_string(),
            verified.to_string(),
            format!("{share:.1} % verified"),
            format!("{:.1}", self.rows.iter().map(|row| row.seconds).sum::<f64>()),
        ]);
        table(&lines)
    }
}

/// Collects, draws and exports a run; also used by the demo.
pub fn collect_run(
    arguments: &CollectArguments,
    tasks: Vec<Task>,
    printer: &Printer,
    stop: &Arc<AtomicBool>,
) -> Result<Collected, Failed> {
    let images = (!arguments.no_dataset).then(|| ImageSettings { fps: arguments.fps, ..ImageSettings::default() });
    let settings = CollectSettings { images, keep_failed: arguments.keep_failed, ..CollectSettings::default() };
    let run = Run {
        seed: Seed::new(arguments.seed),
        episodes_per_task: arguments.episodes,
        tasks,
        settings,
        engine: genmanip_sim::engine_version(),
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
    };
    let folder = RunFolder::begin(&arguments.out, &run)?;
    let store = folder.store()?;
    let planner = inputs::planner(&run.settings.planner)?;
    let resources = Resources { catalogue: Catalogue::builtin(), planner: &planner };
    let attempts = Attempt::all(&run.tasks, run.episodes_per_task, run.seed);

    let started = Instant::now();
    let bar = printer.progress("collecting", attempts.len());
    let results = collect(
        &attempts,
        resources,
        &store,
        &run.settings,
        inputs::workers(arguments.workers),
        stop,
        &|result: &EpisodeResult, seconds: f64| {
            if seconds > 0.0 {
                folder.time_attempt(&result.id, seconds);
            }
            bar.inc(1);
            if let Some(failure) = result.failure() {
                bar.suspend(|| printer.say(format!("{}: {failure}", result.id)));
            }
        },
    )
    .map_err(|error| {
        Failed::because("collecting stopped", &error).hint("finished episodes are kept; start again to continue")
    })?;
    bar.finish_and_clear();
    folder.time_phase("collect", started.elapsed().as_secs_f64());
    let interrupted = stop.load(Ordering::Relaxed);
    for id in results.iter().filter(|result| !result.scenario_id.is_empty()).map(|result| &result.id) {
        write_scenario(&folder, &store, id)?;
    }
    if !arguments.no_dataset && !interrupted && results.iter().any(|result| result.success) {
        export(arguments, &folder, &store, printer)?;
    }
    folder.save_timings()?;
    if interrupted {
        printer.say(format!(
            "interrupted after {} of {} attempts; start again to continue",
            results.len(),
            attempts.len()
        ));
    }
    Ok(Collected { rows: rows(&run.tasks, &results, &folder), folder, interrupted })
}

fn write_scenario(folder: &RunFolder, store: &EpisodeStore, id: &str) -> Result<(), Failed> {
    let path = folder.join("scenarios").join(format!("{id}.json"));
    if path.exists() {
        return Ok(());
    }
    match store.read_scenario(id).map_err(|error| Failed::because(format!("cannot read episode {id}"), &error))? {
        Some(scenario) => inputs::write_file(&path, scenario.to_json().as_bytes()),
        None => Ok(()),
    }
}

fn export(
    arguments: &CollectArguments,
    folder: &RunFolder,
    store: &EpisodeStore,
    printer: &Printer,
) -> Result<(), Failed> {
    let started = Instant::now();
    let settings = LerobotSettings { fps: arguments.fps, replace: true, ..LerobotSettings::default() };
    let selection = if arguments.keep_failed { Selection::Recorded } else { Selection::Verified };
    lerobot::export(store, &selection, &panda(), &settings, &folder.join("dataset")).map_err(|error| {
        Failed::because("cannot write the dataset", &error).hint("the episodes are safe; start again")
    })?;
    folder.time_phase("dataset", started.elapsed().as_secs_f64());
    printer.say(format!("dataset: {}", folder.join("dataset").display()));
    Ok(())
}

fn rows(tasks: &[Task], results: &[EpisodeResult], folder: &RunFolder) -> Vec<TaskRow> {
    let timings = folder.timings();
    tasks
        .iter()
        .map(|task| {
            let mine = || results.iter().filter(|result| result.task_id == task.id);
            TaskRow {
                task: task.id.clone(),
                kind: task.kind,
                attempts: mine().count(),
                verified: mine().filter(|result| result.success).count(),
                failures: mine().filter_map(|result| Some(result.failure()?.to_string())).collect(),
                seconds: mine().filter_map(|result| timings.attempts.get(&result.id)).sum(),
            }
        })
        .collect()
}

fn shortened(text: &str, length: usize) -> String {
    if text.chars().count() <= length {
        return text.to_owned();
    }
    text.chars().take(length - 1).chain(['…']).collect()
}
