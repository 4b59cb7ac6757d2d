//! Collection of demonstrations into a run folder: attempts, their images, scenario files and the dataset.

mod attempts;
mod options;
mod runner;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_benchmark::Outcome;
use genmanip_core::{NotRun, Policy, TaskKind};
use genmanip_data::lerobot::{self, LerobotSettings};
use genmanip_data::{EpisodeStore, ExportSettings, Selection};
use genmanip_motion::Planner;
use genmanip_rollout::collect::{MakeCorrected, PipelineSettings, Resources};
use genmanip_rollout::{RolloutError, Stage};
use genmanip_workspace::{MAX_ROWS, attention, text_table};
use serde::Serialize;

use crate::folder::{Run, RunFolder, Timings};

use crate::not_run;
use crate::policies::{PolicyContext, PolicyFactory};
pub(crate) use attempts::share;
use attempts::{Outcomes, Planned};
use genmanip_agent_sim::demonstration_grasps;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::shard::Shard;
use genmanip_workspace::task_spool::TaskEntry;
use genmanip_workspace::worlds;
pub use options::CollectOptions;
use runner::{Made, Runner};

/// Result of [`collect`].
#[derive(Clone, Debug, PartialEq)]
pub struct Collected {
    /// Outcomes by task, one row each.
    pub rows: Vec<TaskRow>,
    /// Folder of the dataset; `None` if none was written.
    pub dataset: Option<PathBuf>,
    /// Number of attempts that the run comprises.
    pub attempts: usize,
    /// Number of finished attempts.
    pub finished: usize,
    /// True if interrupted; the same call continues.
    pub interrupted: bool,
    /// Ids of damaged episodes, which were omitted, each with a description of the damage.
    pub damaged: Vec<(String, String)>,
    /// Attempts that the policy to be corrected could not run (unreachable, or a mistake of it); the same call makes
    /// them.
    pub not_run: Vec<NotRun>,
    /// Shard that was collected; `None` for the whole run.
    pub shard: Option<Shard>,
}

/// Outcomes of the attempts of a task.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TaskRow {
    /// Id of the task.
    pub task: String,
    /// Kind of the task.
    pub kind: TaskKind,
    /// Number of finished attempts.
    pub attempts: usize,
    /// Number of verified attempts.
    pub verified: usize,
    /// Failure causes with evidence, one text per failed attempt.
    pub failures: Vec<String>,
    /// Wall-clock time of the task's attempts, s.
    pub seconds: f64,
}

/// Makes all missing attempts of a run, renders their images and writes their scenarios. Then exports the dataset, if
/// an attempt was verified and the settings request images.
///
/// Damaged episodes are reported and omitted, or attempted again with [`CollectOptions::repair`]. When `stop` becomes
/// true, attempts in progress are finished, and the others remain for the next call.
///
/// # Errors
/// When the folder holds another run or cannot be written to, or a stage fails; finished episodes are kept.
pub fn collect(
    path: &Path,
    run: Run,
    options: CollectOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Collected, WorkspaceError> {
    let grasps = demonstration_grasps::choice(&run.settings.grasps)?;
    let corrected = run.settings.corrects.as_deref().map(corrected).transpose()?;
    let skills = crate::skills::of_run(&run.settings.skills, &run.tasks, Catalogue::builtin())?;
    let begin = if options.shard.is_some() { RunFolder::begin_shard } else { RunFolder::begin };
    let folder = begin(path, &run)?;
    folder.claim(options.shard)?;
    let known_timings = folder.timings();
    let wants_dataset = run.settings.images.is_some() && options.shard.is_none();
    let hash = if wants_dataset { run.hash()? } else { String::new() };
    if wants_dataset {
        check_datasets(&folder, &hash)?;
    }
    let store = folder.store()?;
    let Run { tasks, settings, seed, episodes_per_task, .. } = run;
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let proposer = grasps.map(|choice| demonstration_grasps::source(&choice, &planner));
    let make_corrected = corrected.as_ref().map(|policy| maker(policy, &planner, &settings));
    let resources = Resources {
        grasp_proposer: proposer.as_ref(),
        corrected: make_corrected.as_ref().map(|make| make as &MakeCorrected),
        skills: skills.as_ref(),
        ..Resources::builtin(&planner)
    };
    let runner = Runner {
        tasks: &tasks,
        seed,
        settings: &settings,
        resources,
        folder: &folder,
        store: &store,
        options,
        writes_dataset: wants_dataset,
        progress,
        stop,
    };
    let started = Instant::now();
    let Made { attempts, outcomes, not_run, mut damaged, has_made, has_changed } = match options.verified {
        None => runner.fixed(episodes_per_task)?,
        Some(count) => runner.until_verified(count)?,
    };
    let all = attempts.len() + damaged.len();
    if let (Some(policy), Some(first)) = (&corrected, not_run.first()) {
        if outcomes.is_empty() {
            return Err(not_run::no_episode(policy.label(), first));
        }
        not_run::note(&not_run).iter().for_each(|note| progress.note(note));
    }
    // A call that finds everything finished does not add to the time of collecting.
    if has_made {
        folder.add_phase_time("collect", started.elapsed().as_secs_f64());
    }
    let interrupted = stop.load(Ordering::Relaxed);
    let is_wanted =
        wants_dataset && !interrupted && not_run.is_empty() && outcomes.values().any(|outcome| outcome.success);
    let dataset_since = Instant::now();
    let dataset = if is_wanted { export(&settings, hash, &folder, &store, &mut damaged, progress)? } else { None };
    if dataset.is_some() && (has_made || !folder.timings().phases.contains_key("dataset")) {
        folder.set_phase_time("dataset", dataset_since.elapsed().as_secs_f64());
    }
    if folder.timings() != known_timings {
        folder.save_timings()?;
    }
    let rows = rows(tasks.entries(), &attempts, &outcomes, &folder.timings());
    // Includes attempts in the store that an interrupted call did not inspect.
    let is_finished = |planned: &&Planned| outcomes.contains_key(&planned.id) || store.contains(&planned.id);
    let finished = attempts.iter().filter(is_finished).count();
    if has_changed {
        // The survey also updates the index on disk.
        folder.survey(&store)?;
    }
    Ok(Collected { rows, dataset, attempts: all, finished, interrupted, damaged, not_run, shard: options.shard })
}

/// Policy whose actions the expert corrects, by name; an error for policies that cannot be corrected.
fn corrected(name: &str) -> Result<PolicyFactory, WorkspaceError> {
    let policy = PolicyFactory::resolve(name)?;
    let why = if policy.needs_record() {
        "it needs episodes that were recorded before"
    } else if policy.account().is_some() {
        "it asks a service that costs money"
    } else {
        return Ok(policy);
    };
    Err(WorkspaceError::input(format!("policy {} cannot be corrected: {why}", policy.name()))
        .with_hint("expected clumsy, blind, random, or a policy of yours: openpi, vla-eval, python"))
}

/// Factory of the policy to be corrected, for episodes on a stage.
fn maker<'a>(
    policy: &'a PolicyFactory,
    planner: &'a Arc<Planner>,
    settings: &'a PipelineSettings,
) -> impl Fn(&Stage) -> Result<Box<dyn Policy>, RolloutError> + Sync + 'a {
    let grasps = GraspLibrary::builtin();
    move |stage| {
        let context = PolicyContext { stage, recorded: None, planner, grasps, settings, cores: None };
        policy.make(&context).map_err(|error| policy.refusal(error))
    }
}

impl Collected {
    /// True if the run is finished, has no damaged episode and at least one verified attempt; a shard needs no verified
    /// attempt. An attempt that was not run is not finished.
    pub fn is_met(&self) -> bool {
        let is_any_verified = self.shard.is_some() || self.rows.iter().any(|row| row.verified > 0);
        !self.interrupted && self.damaged.is_empty() && self.not_run.is_empty() && is_any_verified
    }

    /// Table of the rows with totals. Above [`MAX_ROWS`] tasks, unless `each` is true, it has a row per kind and the
    /// tasks without a verified demonstration.
    pub fn table(&self, each: bool) -> String {
        const TASKS: [&str; 6] = ["task", "kind", "attempts", "verified", "why others failed", "seconds"];
        let of_task = |row: &TaskRow| {
            let [attempts, verified, seconds] = sums([row].into_iter());
            let why = shortened(&row.failures.join("; "), 60);
            vec![row.task.clone(), row.kind.name().into(), attempts, verified, why, seconds]
        };
        let [attempts, verified, seconds] = sums(self.rows.iter());
        let count = |of: fn(&TaskRow) -> usize| self.rows.iter().map(of).sum::<usize>();
        let share = 100.0 * count(|row| row.verified) as f64 / count(|row| row.attempts).max(1) as f64;
        let share = format!("{share:.1} % verified");
        if each || self.rows.len() <= MAX_ROWS {
            let total = vec!["all".into(), String::new(), attempts, verified, share, seconds];
            let head = TASKS.map(String::from).to_vec();
            let lines = [head].into_iter().chain(self.rows.iter().map(of_task)).chain([total]);
            return text_table(&lines.collect::<Vec<_>>());
        }
        let mut kinds =
            vec![["kind", "tasks", "attempts", "verified", "why others failed", "seconds"].map(String::from).to_vec()];
        for kind in TaskKind::ALL {
            let own: Vec<&TaskRow> = self.rows.iter().filter(|row| row.kind == kind).collect();
            if !own.is_empty() {
                let [attempts, verified, seconds] = sums(own.iter().copied());
                kinds.push(vec![kind.name().into(), own.len().to_string(), attempts, verified, causes(&own), seconds]);
            }
        }
        kinds.push(vec!["all".into(), self.rows.len().to_string(), attempts, verified, share, seconds]);
        let unsolved: Vec<Vec<String>> = self.rows.iter().filter(|row| row.verified == 0).map(of_task).collect();
        let attention = match unsolved.len() {
            0 => "every task has a verified demonstration\n".into(),
            count => format!("{count} tasks without a verified demonstration\n{}", attention(&TASKS, &unsolved)),
        };
        format!("{}\n{attention}each task: --each, or the report of the run\n", text_table(&kinds))
    }
}

/// Total attempts, verified attempts and seconds of tasks, as texts.
fn sums<'a>(rows: impl Iterator<Item = &'a TaskRow>) -> [String; 3] {
    // Start from 0.0, since the empty sum of floats is -0.0.
    let (attempts, verified, seconds) = rows.fold((0, 0, 0.0), |(attempts, verified, seconds), row| {
        (attempts + row.attempts, verified + row.verified, seconds + row.seconds)
    });
    [attempts.to_string(), verified.to_string(), format!("{seconds:.1}")]
}

/// Text of the failure causes with their counts, most frequent first.
fn causes(rows: &[&TaskRow]) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for failure in rows.iter().flat_map(|row| &row.failures) {
        *counts.entry(failure.split(':').next().unwrap_or_default()).or_default() += 1;
    }
    let mut counts: Vec<(&str, usize)> = counts.into_iter().collect();
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    shortened(&counts.iter().map(|(cause, count)| format!("{cause} {count}")).collect::<Vec<_>>().join(", "), 60)
}

/// Fails before collecting if the dataset could not be written at the end.
fn check_datasets(folder: &RunFolder, hash: &str) -> Result<(), WorkspaceError> {
    let path = folder.join("dataset");
    for target in [lerobot::depth_path(&path), path] {
        lerobot::check_owner(&target, Some(hash))
            .map_err(|error| WorkspaceError::input("the data set of this run has no place").because(error))?;
    }
    Ok(())
}

/// Exports the dataset of a run whose settings request images; returns its folder.
fn export(
    settings: &PipelineSettings,
    hash: String,
    folder: &RunFolder,
    store: &EpisodeStore,
    damaged: &mut Vec<(String, String)>,
    progress: &dyn Progress,
) -> Result<Option<PathBuf>, WorkspaceError> {
    let Some(images) = &settings.images else { return Ok(None) };
    let rows = ExportSettings {
        fps: images.fps,
        cameras: images.cameras.clone(),
        is_varied: settings.is_varied(),
        has_corrections: settings.corrects.is_some(),
        expert: settings.expert.style,
        ..ExportSettings::default()
    };
    let dataset = LerobotSettings { export: rows, run: Some(hash), ..LerobotSettings::default() };
    let selection = if settings.keep_failed { Selection::Recorded } else { Selection::Verified };
    let path = folder.join("dataset");
    let robot = worlds::robot(&settings.world)?;
    let exported = lerobot::export(store, &selection, &robot, &dataset, &path).map_err(|error| {
        WorkspaceError::broken("cannot write the dataset", error).with_hint("the episodes are safe; start again")
    })?;
    for (id, why) in
        exported.left_out.into_iter().filter(|(id, _)| damaged.iter().all(|(known, _)| known != id)).collect::<Vec<_>>()
    {
        progress.note(&format!("episode {id} is damaged and left out: {why}"));
        damaged.push((id, why));
    }
    Ok(Some(path))
}

fn rows(tasks: &[TaskEntry], attempts: &[Planned], outcomes: &Outcomes, timings: &Timings) -> Vec<TaskRow> {
    let mut of_task: BTreeMap<usize, Vec<(&str, &Outcome)>> = BTreeMap::new();
    for Planned { id, task, .. } in attempts {
        if let Some(outcome) = outcomes.get(id) {
            of_task.entry(*task).or_default().push((id, outcome));
        }
    }
    // A shard may have no attempt at some task, which then has no row.
    let planned: BTreeSet<usize> = attempts.iter().map(|attempt| attempt.task).collect();
    let entries = tasks.iter().enumerate().filter(|(index, _)| planned.contains(index));
    entries
        .map(|(index, task)| {
            let mine = || of_task.get(&index).into_iter().flatten();
            TaskRow {
                task: task.id.clone(),
                kind: task.kind,
                attempts: mine().count(),
                verified: mine().filter(|(_, outcome)| outcome.success).count(),
                failures: mine().filter_map(|(_, outcome)| Some(outcome.failure()?.to_string())).collect(),
                // Added 0.0, since the empty sum of floats is -0.0.
                seconds: mine().filter_map(|(id, _)| timings.attempts.get(*id)).sum::<f64>() + 0.0,
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

#[cfg(test)]
mod tests {
    use super::*;

    fn collected(tasks: usize) -> Collected {
        let row = |index: usize| TaskRow {
            task: format!("t{index:03}"),
            kind: TaskKind::ALL[index % 2],
            attempts: 2,
            verified: if index % 40 == 7 { 0 } else { 2 },
            failures: if index % 40 == 7 { vec!["slipped: it fell".into(); 2] } else { vec![] },
            seconds: 1.0,
        };
        let rows = (0..tasks).map(row).collect();
        Collected {
            rows,
            dataset: None,
            attempts: 0,
            finished: 0,
            interrupted: false,
            damaged: vec![],
            not_run: vec![],
            shard: None,
        }
    }

    #[test]
    fn many_tasks_are_summed_up_by_kind_and_only_what_needs_attention_is_listed() {
        let count = |text: &str| text.lines().filter(|line| line.starts_with("t0")).count();
        assert_eq!(count(&collected(30).table(false)), 30);
        assert_eq!(count(&collected(100).table(true)), 100);
        let text = collected(100).table(false);
        assert_eq!(count(&text), 3, "{text}");
        let kinds = "pick_and_place  50     100       100                          50.0\n\
                     spatial         50     100       94        slipped 6          50.0\n";
        for part in [kinds, "97.0 % verified", "3 tasks without a verified demonstration", "--each"] {
            assert!(text.contains(part), "{part} in {text}");
        }
    }
}
