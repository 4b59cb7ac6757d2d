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
    /// Damaged episodes that were left out, with what is wrong.
    pub damaged: Vec<(String, String)>,
}

/// How a run is collected, whatever its result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CollectOptions {
    /// Worker threads.
    pub workers: usize,
    /// Whether damaged episodes are set aside, in `damaged/` of the run, and made anew; else they are left out.
    pub repair: bool,
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
/// Damaged episodes are named and left out, or with [`CollectOptions::repair`] made anew.
/// When `stop` becomes true, attempts under way are finished and the rest is left for the next call.
///
/// # Errors
/// When the folder holds another run, cannot be written, or a stage broke; finished episodes are kept.
pub fn collect(
    path: &Path,
    run: &Run,
    options: CollectOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Collected, RunError> {
    let folder = RunFolder::begin(path, run)?;
    if run.settings.images.is_some() {
        check_datasets(&folder, run)?;
    }
    let store = folder.store()?;
    let planner = inputs::planner(&run.settings.world, &run.settings.planner)?;
    let resources = Resources { catalogue: Catalogue::builtin(), planner: &planner, grasps: GraspLibrary::builtin() };
    let mut attempts = Attempt::all(&run.tasks, run.episodes_per_task, run.seed);
    let all = attempts.len();
    let mut damaged = damaged(&folder, &store, &attempts, options.repair, progress)?;
    attempts.retain(|attempt| damaged.iter().all(|(id, _)| *id != attempt.id()));

    let started = Instant::now();
    let has_made = AtomicBool::new(false);
    progress.begin("collecting", attempts.len());
    let heard = |result: &EpisodeResult, seconds: f64| {
        if seconds > 0.0 {
            has_made.store(true, Ordering::Relaxed);
            folder.time_attempt(&result.id, seconds);
        }
        progress.advance();
        if let Some(failure) = result.failure() {
            progress.note(&format!("{}: {failure}", result.id));
        }
    };
    let results =
        genmanip_rollout::collect::collect(&attempts, resources, &store, &run.settings, options.workers, stop, &heard);
    let results = results.map_err(|error| {
        RunError::broken("collecting stopped", error).with_hint("finished episodes are kept; start again to continue")
    })?;
    progress.end();
    // A call that only looks at what is finished says nothing about how long it took to make.
    if has_made.into_inner() {
        folder.time_phase("collect", started.elapsed().as_secs_f64());
    }
    let interrupted = stop.load(Ordering::Relaxed);
    for id in results.iter().filter(|result| !result.scenario_id.is_empty()).map(|result| &result.id) {
        write_scenario(&folder, &store, id)?;
    }
    let is_wanted = !interrupted && results.iter().any(|result| result.success);
    let dataset = if is_wanted { export(run, &folder, &store, &mut damaged, progress)? } else { None };
    folder.save_timings()?;
    let rows = rows(&run.tasks, &results, &folder.timings());
    // Also those that an interrupted call had no time to look at.
    let finished = attempts.iter().filter(|attempt| store.contains(&attempt.id())).count();
    Ok(Collected { rows, dataset, attempts: all, finished, interrupted, damaged })
}

impl Collected {
    /// Whether the run is over, nothing of it damaged, and at least one attempt was verified.
    pub fn is_met(&self) -> bool {
        !self.interrupted && self.damaged.is_empty() && self.rows.iter().any(|row| row.verified > 0)
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
            format!("{:.1}", self.rows.iter().map(|row| row.seconds).sum::<f64>() + 0.0),
        ]);
        text_table(&lines)
    }
}

/// Damaged attempts of the run; with `repair` there are none left afterwards.
fn damaged(
    folder: &RunFolder,
    store: &EpisodeStore,
    attempts: &[Attempt],
    repair: bool,
    progress: &dyn Progress,
) -> Result<Vec<(String, String)>, RunError> {
    let mut damaged = Vec::new();
    for id in attempts.iter().map(Attempt::id).filter(|id| store.is_taken(id)) {
        // What is to be mended is read whole; else sizes must do, and damage within shows when it is read.
        let looked_at = if repair { store.verify(&id) } else { store.look_at(&id) };
        let Err(error) = looked_at else { continue };
        if !repair {
            progress.note(&format!("episode {id} is damaged and left out: {error}"));
            damaged.push((id, error.to_string()));
            continue;
        }
        let aside =
            (0..).map(|number| folder.join("damaged").join(format!("{id}.{number}"))).find(|path| !path.exists());
        let aside = aside.unwrap_or_default();
        store.move_out(&id, &aside).map_err(|error| RunError::broken(format!("cannot set {id} aside"), error))?;
        progress.note(&format!("episode {id} is damaged, set aside as {} and made anew: {error}", aside.display()));
    }
    let listing = store.list().map_err(|error| RunError::broken("cannot list the episodes", error))?;
    for name in listing.strangers.iter().filter(|name| attempts.iter().all(|attempt| attempt.id() != **name)) {
        progress.note(&format!("{name} in the episodes is no episode; it is ignored"));
    }
    Ok(damaged)
}

/// Refuses to begin work whose data set could not be written in the end.
fn check_datasets(folder: &RunFolder, run: &Run) -> Result<(), RunError> {
    let path = folder.join("dataset");
    for target in [lerobot::depth_path(&path), path] {
        lerobot::check_owner(&target, Some(&run.hash())).map_err(|error| {
            let hint = error.hint().unwrap_or_default();
            RunError::input("the data set of this run has no place").because(error).with_hint(hint)
        })?;
    }
    Ok(())
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
fn export(
    run: &Run,
    folder: &RunFolder,
    store: &EpisodeStore,
    damaged: &mut Vec<(String, String)>,
    progress: &dyn Progress,
) -> Result<Option<PathBuf>, RunError> {
    let Some(images) = &run.settings.images else { return Ok(None) };
    let started = Instant::now();
    let settings = LerobotSettings { fps: images.fps, run: Some(run.hash()), ..LerobotSettings::default() };
    let selection = if run.settings.keep_failed { Selection::Recorded } else { Selection::Verified };
    let path = folder.join("dataset");
    let robot = inputs::robot(&run.settings.world)?;
    let exported = lerobot::export(store, &selection, &robot, &settings, &path).map_err(|error| {
        RunError::broken("cannot write the dataset", error).with_hint("the episodes are safe; start again")
    })?;
    for (id, why) in
        exported.left_out.into_iter().filter(|(id, _)| damaged.iter().all(|(known, _)| known != id)).collect::<Vec<_>>()
    {
        progress.note(&format!("episode {id} is damaged and left out: {why}"));
        damaged.push((id, why));
    }
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
                // A sum of nothing is -0.0.
                seconds: mine().filter_map(|result| timings.attempts.get(&result.id)).sum::<f64>() + 0.0,
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
