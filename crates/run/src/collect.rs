//! Collecting demonstrations into a run folder: attempts, their pictures, scenario files and the dataset.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_bench::text_table;
use genmanip_core::{Document, EpisodeResult, Task, TaskKind};
use genmanip_data::EpisodeStore;
use genmanip_data::lerobot::{self, LerobotSettings, Selection};
use genmanip_rollout::collect::{Attempt, Resources};
use serde::Serialize;

use crate::error::RunError;
use crate::folder::{Run, RunFolder, Timings};
use crate::inputs;
use crate::progress::Progress;

/// What a run came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Collected {
    /// One row per task.
    pub rows: Vec<TaskRow>,
    /// The dataset, if one was written.
    pub dataset: Option<PathBuf>,
    /// Attempts of the run, and how many of them are finished.
    pub attempts: usize,
    /// Attempts that are finished.
    pub finished: usize,
    /// Whether it was told to stop; the same call continues it.
    pub interrupted: bool,
}

/// A task and what became of its attempts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TaskRow {
    /// Id of the task.
    pub task: String,
    /// Its kind.
    pub kind: TaskKind,
    /// Finished attempts.
    pub attempts: usize,
    /// Those with a verified demonstration.
    pub verified: usize,
    /// Why the others failed.
    pub failures: Vec<String>,
    /// Wall-clock time of the attempts, s.
    pub seconds: f64,
}

/// Makes all attempts of a run that its folder does not hold yet, draws them, writes their scenarios, and exports the
/// dataset if any was verified and the settings ask for images.
///
/// When `stop` becomes true, attempts under way are finished and the rest is left for the next call.
///
/// # Errors
/// When the folder holds another run, cannot be written, or a stage broke; finished episodes are kept.
pub fn collect(
    path: &Path,
    run: &Run,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Collected, RunError> {
    let folder = RunFolder::begin(path, run)?;
    let store = folder.store()?;
    let planner = inputs::planner(&run.settings.world, &run.settings.planner)?;
    let resources = Resources { catalogue: Catalogue::builtin(), planner: &planner, grasps: GraspLibrary::builtin() };
    let attempts = Attempt::all(&run.tasks, run.episodes_per_task, run.seed);

    let started = Instant::now();
    progress.begin("collecting", attempts.len());
    let heard = |result: &EpisodeResult, seconds: f64| {
        if seconds > 0.0 {
            folder.time_attempt(&result.id, seconds);
        }
        progress.advance();
        if let Some(failure) = result.failure() {
            progress.note(&format!("{}: {failure}", result.id));
        }
    };
    let results =
        genmanip_rollout::collect::collect(&attempts, resources, &store, &run.settings, workers, stop, &heard);
    let results = results.map_err(|error| {
        RunError::broken("collecting stopped", error).with_hint("finished episodes are kept; start again to continue")
    })?;
    progress.end();
    folder.time_phase("collect", started.elapsed().as_secs_f64());
    let interrupted = stop.load(Ordering::Relaxed);
    for id in results.iter().filter(|result| !result.scenario_id.is_empty()).map(|result| &result.id) {
        write_scenario(&folder, &store, id)?;
    }
    let is_wanted = !interrupted && results.iter().any(|result| result.success);
    let dataset = if is_wanted { export(run, &folder, &store)? } else { None };
    folder.save_timings()?;
    let rows = rows(&run.tasks, &results, &folder.timings());
    Ok(Collected { rows, dataset, attempts: attempts.len(), finished: results.len(), interrupted })
}

impl Collected {
    /// Whether the run is over and at least one attempt was verified.
    pub fn is_met(&self) -> bool {
        !self.interrupted && self.rows.iter().any(|row| row.verified > 0)
    }

    /// The rows as a table with their sum.
    pub fn table(&self) -> String {
        let head = ["task", "kind", "attempts", "verified", "why others failed", "seconds"];
        let mut lines = vec![head.map(String::from).to_vec()];
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
        text_table(&lines)
    }
}

fn write_scenario(folder: &RunFolder, store: &EpisodeStore, id: &str) -> Result<(), RunError> {
    let path = folder.join("scenarios").join(format!("{id}.json"));
    if path.exists() {
        return Ok(());
    }
    let scenario =
        store.read_scenario(id).map_err(|error| RunError::broken(format!("cannot read episode {id}"), error))?;
    scenario.map_or(Ok(()), |scenario| inputs::write_file(&path, scenario.to_json().as_bytes()))
}

/// The dataset of a run whose settings ask for images, and where it is.
fn export(run: &Run, folder: &RunFolder, store: &EpisodeStore) -> Result<Option<PathBuf>, RunError> {
    let Some(images) = &run.settings.images else { return Ok(None) };
    let started = Instant::now();
    let settings = LerobotSettings { fps: images.fps, replace: true, ..LerobotSettings::default() };
    let selection = if run.settings.keep_failed { Selection::Recorded } else { Selection::Verified };
    let path = folder.join("dataset");
    let robot = inputs::robot(&run.settings.world)?;
    lerobot::export(store, &selection, &robot, &settings, &path).map_err(|error| {
        RunError::broken("cannot write the dataset", error).with_hint("the episodes are safe; start again")
    })?;
    folder.time_phase("dataset", started.elapsed().as_secs_f64());
    Ok(Some(path))
}

fn rows(tasks: &[Task], results: &[EpisodeResult], timings: &Timings) -> Vec<TaskRow> {
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
