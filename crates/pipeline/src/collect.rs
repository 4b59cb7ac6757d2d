//! Collecting demonstrations into a run folder: attempts, their pictures, scenario files and the dataset.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use genmanip_assets::GraspLibrary;
use genmanip_benchmark::Outcome;
use genmanip_core::{Document, EpisodeResult, Policy, TaskKind};
use genmanip_data::lerobot::{self, LerobotSettings};
use genmanip_data::{EpisodeStore, ExportSettings, Selection};
use genmanip_motion::Planner;
use genmanip_rollout::collect::{
    Attempt, MakeCorrected, PipelineSettings, Resources, attempt_id, complete, in_parallel,
};
use genmanip_rollout::{RolloutError, Stage};
use genmanip_workspace::{MOST_ROWS, attention, text_table};
use serde::Serialize;

use crate::folder::{Run, RunFolder, Timings};
use crate::index::{Known, Survey};
use crate::policies::{PolicyContext, PolicyFactory};
use genmanip_agent_sim::demonstration_grasps;
use genmanip_workspace::Progress;
use genmanip_workspace::disk_space::Estimate;
use genmanip_workspace::documents;
use genmanip_workspace::shard::Shard;
use genmanip_workspace::task_spool::TaskEntry;
use genmanip_workspace::worlds;
use genmanip_workspace::{RunError, Stopped};

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
    /// Which part of the run it is, where it is not all of it.
    pub shard: Option<Shard>,
}

/// How a run is collected, whatever its result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CollectOptions {
    /// Worker threads.
    pub workers: usize,
    /// Whether damaged episodes are set aside, in `damaged/` of the run, and made anew; else they are left out.
    pub repair: bool,
    /// The part of the run that is made, without its dataset; `None` for all of it.
    pub shard: Option<Shard>,
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
    run: Run,
    options: CollectOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Collected, RunError> {
    let grasps = demonstration_grasps::choice(&run.settings.grasps)?;
    let corrected = run.settings.corrects.as_deref().map(corrected).transpose()?;
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
        ..Resources::builtin(&planner)
    };
    let mut attempts = Planned::all(tasks.entries(), episodes_per_task, options.shard);
    let all = attempts.len();
    let survey = folder.survey(&store)?;
    let mut damaged = damaged(&folder, &store, &attempts, &survey, options.repair, progress)?;
    attempts.retain(|attempt| damaged.iter().all(|(id, _)| *id != attempt.id));
    // What was set aside is to be made anew.
    let survey = if options.repair { folder.survey(&store)? } else { survey };
    let mut outcomes = Outcomes::new();
    let left = left(&attempts, survey, &folder, &store, &settings, &mut outcomes);

    let started = Instant::now();
    let has_made = AtomicBool::new(false);
    progress.begin("collecting", attempts.len());
    let heard = |id: &str, outcome: &Outcome| {
        progress.advance();
        if let Some(failure) = outcome.failure() {
            progress.note(&format!("{id}: {failure}"));
        }
    };
    // What an earlier call has told is not told again.
    outcomes.iter().for_each(|_| progress.advance());
    let finished = |result: EpisodeResult, seconds: f64| -> Result<(String, Outcome), Stopped> {
        if seconds > 0.0 {
            has_made.store(true, Ordering::Relaxed);
            folder.time_attempt(&result.id, seconds);
        }
        if !result.scenario_id.is_empty() {
            write_scenario(&folder, &store, &result.id)?;
        }
        let outcome = Outcome::of(&result);
        heard(&result.id, &outcome);
        Ok((result.id, outcome))
    };
    let estimate = Estimate::new(path, left.len(), wants_dataset);
    store.sweep_partial().map_err(|error| RunError::broken("cannot use the episodes", error))?;
    let made = in_parallel(&left, options.workers, stop, &|planned| {
        let since = Instant::now();
        let task = tasks.read(planned.task).map_err(Stopped::Run)?;
        let attempt = Attempt::of(&task, planned.number, seed);
        let (result, was_there) = complete(&attempt, resources, &store, &settings)?;
        estimate.add(&store.root().join(&result.id), progress).map_err(Stopped::Run)?;
        finished(result, if was_there { 0.0 } else { since.elapsed().as_secs_f64() })
    });
    let made = made.map_err(|stopped| match stopped {
        Stopped::Run(error) => error,
        Stopped::Episode(error) => RunError::broken("collecting stopped", error)
            .with_hint("finished episodes are kept; start again to continue"),
    })?;
    outcomes.extend(made);
    progress.end();
    // A call that only looks at what is finished says nothing about how long it took to make.
    let has_made = has_made.into_inner();
    if has_made {
        folder.lengthen_phase("collect", started.elapsed().as_secs_f64());
    }
    let interrupted = stop.load(Ordering::Relaxed);
    let is_wanted = wants_dataset && !interrupted && outcomes.values().any(|outcome| outcome.success);
    let dataset_since = Instant::now();
    let dataset = if is_wanted { export(&settings, hash, &folder, &store, &mut damaged, progress)? } else { None };
    if dataset.is_some() && (has_made || !folder.timings().phases.contains_key("dataset")) {
        folder.time_phase("dataset", dataset_since.elapsed().as_secs_f64());
    }
    if folder.timings() != known_timings {
        folder.save_timings()?;
    }
    let rows = rows(tasks.entries(), &attempts, &outcomes, &folder.timings());
    // Also those that an interrupted call had no time to look at.
    let is_finished = |planned: &&Planned| outcomes.contains_key(&planned.id) || store.contains(&planned.id);
    let finished = attempts.iter().filter(is_finished).count();
    if !left.is_empty() {
        // Brings the index up to date.
        folder.survey(&store)?;
    }
    Ok(Collected { rows, dataset, attempts: all, finished, interrupted, damaged, shard: options.shard })
}

/// The policy that is to be corrected.
fn corrected(name: &str) -> Result<PolicyFactory, RunError> {
    let policy = PolicyFactory::resolve(name)?;
    let why = if policy.needs_record() {
        "it needs episodes that were recorded before"
    } else if policy.account().is_some() {
        "it asks a service that costs money"
    } else {
        return Ok(policy);
    };
    Err(RunError::input(format!("policy {} cannot be corrected: {why}", policy.name()))
        .with_hint("expected clumsy, blind, random, or a policy of yours: openpi, vla-eval, python"))
}

/// Makes that policy for the episodes of a stage.
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

/// An attempt that is to be made.
#[derive(Clone)]
struct Planned {
    id: String,
    /// Place of the task in the run.
    task: usize,
    /// Number among the task's attempts.
    number: u64,
}

impl Planned {
    /// The attempts of a run or of a shard of it, task by task.
    fn all(tasks: &[TaskEntry], per_task: usize, shard: Option<Shard>) -> Vec<Self> {
        let named = |(task, number): (usize, u64)| Self { id: attempt_id(&tasks[task].id, number), task, number };
        places(tasks.len(), per_task, shard).map(named).collect()
    }
}

/// Place of the task and number of each attempt of a run or of a shard of it, task by task.
fn places(tasks: usize, per_task: usize, shard: Option<Shard>) -> impl Iterator<Item = (usize, u64)> {
    let (first, step) = shard.map_or((0, 1), |shard| (shard.index(), shard.count()));
    (first..tasks.saturating_mul(per_task))
        .step_by(step)
        .map(move |piece| (piece / per_task, (piece % per_task) as u64))
}

/// Ids of the attempts of a run or of a shard of it.
pub(crate) fn share(run: &Run, shard: Option<Shard>) -> impl Iterator<Item = String> {
    let tasks = run.tasks.entries();
    let named = |(task, number): (usize, u64)| attempt_id(&tasks[task].id, number);
    places(tasks.len(), run.episodes_per_task, shard).map(named)
}

/// How attempts went, by their ids: all that is kept of each.
type Outcomes = BTreeMap<String, Outcome>;

/// The attempts that something is to be done for; the outcomes of the others are told.
fn left(
    attempts: &[Planned],
    survey: Survey,
    folder: &RunFolder,
    store: &EpisodeStore,
    settings: &PipelineSettings,
    outcomes: &mut Outcomes,
) -> Vec<Planned> {
    let scenarios: BTreeSet<_> = std::fs::read_dir(folder.join("scenarios"))
        .map(|entries| entries.filter_map(|entry| Some(entry.ok()?.file_name())).collect())
        .unwrap_or_default();
    let mut known: BTreeMap<String, Known> = survey.sound.into_iter().map(|known| (known.id.clone(), known)).collect();
    let has_all = |known: &Known| {
        let has_scenario = !known.has_scenario || scenarios.contains(OsStr::new(&format!("{}.json", known.id)));
        let has_pictures = settings.images.as_ref().is_none_or(|images| {
            let is_drawn = known.outcome.success || settings.keep_failed && known.recorded;
            !is_drawn || store.has_tracks(&known.id, images.fps, &images.cameras)
        });
        known.is_settled() && has_scenario && has_pictures
    };
    let is_left = |attempt: &&Planned| match known.remove(&attempt.id) {
        Some(known) if has_all(&known) => {
            outcomes.insert(known.id, known.outcome);
            false
        }
        _ => true,
    };
    attempts.iter().filter(is_left).cloned().collect()
}

impl Collected {
    /// Whether the run is over, nothing of it damaged, and at least one attempt was verified; of a shard, which may hold
    /// few attempts, none need be.
    pub fn is_met(&self) -> bool {
        let is_any_verified = self.shard.is_some() || self.rows.iter().any(|row| row.verified > 0);
        !self.interrupted && self.damaged.is_empty() && is_any_verified
    }

    /// The rows as a table with their sum; above [`MOST_ROWS`] tasks, unless `each` is asked for, a row per kind and the
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
        if each || self.rows.len() <= MOST_ROWS {
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

/// Attempts, verified ones and seconds of tasks.
fn sums<'a>(rows: impl Iterator<Item = &'a TaskRow>) -> [String; 3] {
    // A sum of nothing is -0.0.
    let (attempts, verified, seconds) = rows.fold((0, 0, 0.0), |(attempts, verified, seconds), row| {
        (attempts + row.attempts, verified + row.verified, seconds + row.seconds)
    });
    [attempts.to_string(), verified.to_string(), format!("{seconds:.1}")]
}

/// How often each cause stands in the failures of tasks, most frequent first.
fn causes(rows: &[&TaskRow]) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for failure in rows.iter().flat_map(|row| &row.failures) {
        *counts.entry(failure.split(':').next().unwrap_or_default()).or_default() += 1;
    }
    let mut counts: Vec<(&str, usize)> = counts.into_iter().collect();
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    shortened(&counts.iter().map(|(cause, count)| format!("{cause} {count}")).collect::<Vec<_>>().join(", "), 60)
}

/// Damaged attempts of the run; with `repair` there are none left afterwards.
fn damaged(
    folder: &RunFolder,
    store: &EpisodeStore,
    attempts: &[Planned],
    survey: &Survey,
    repair: bool,
    progress: &dyn Progress,
) -> Result<Vec<(String, String)>, RunError> {
    let looks_sound: BTreeSet<&str> = survey.sound.iter().map(|known| known.id.as_str()).collect();
    let mut damaged = Vec::new();
    for Planned { id, .. } in attempts.iter().filter(|known| repair || !looks_sound.contains(known.id.as_str())) {
        if !store.has_folder(id) {
            continue;
        }
        // What is to be mended is read whole; else sizes must do, and damage within shows when it is read.
        let looked_at = if repair { store.verify(id) } else { store.inspect(id).map(drop) };
        let Err(error) = looked_at else { continue };
        if !repair {
            progress.note(&format!("episode {id} is damaged and left out: {error}"));
            damaged.push((id.clone(), error.to_string()));
            continue;
        }
        let aside =
            (0..).map(|number| folder.join("damaged").join(format!("{id}.{number}"))).find(|path| !path.exists());
        let aside = aside.unwrap_or_default();
        store.move_out(id, &aside).map_err(|error| RunError::broken(format!("cannot set {id} aside"), error))?;
        progress.note(&format!("episode {id} is damaged, set aside as {} and made anew: {error}", aside.display()));
    }
    let own: BTreeSet<&str> = attempts.iter().map(|known| known.id.as_str()).collect();
    for name in survey.strangers.iter().filter(|name| !own.contains(name.as_str())) {
        progress.note(&format!("{name} in the episodes is no episode; it is ignored"));
    }
    Ok(damaged)
}

/// Refuses to begin work whose data set could not be written in the end.
fn check_datasets(folder: &RunFolder, hash: &str) -> Result<(), RunError> {
    let path = folder.join("dataset");
    for target in [lerobot::depth_path(&path), path] {
        lerobot::check_owner(&target, Some(hash)).map_err(|error| {
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
    scenario.map_or(Ok(()), |scenario| documents::write_file(&path, scenario.to_json().as_bytes()))
}

/// The dataset of a run whose settings ask for images, and where it is.
fn export(
    settings: &PipelineSettings,
    hash: String,
    folder: &RunFolder,
    store: &EpisodeStore,
    damaged: &mut Vec<(String, String)>,
    progress: &dyn Progress,
) -> Result<Option<PathBuf>, RunError> {
    let Some(images) = &settings.images else { return Ok(None) };
    let rows = ExportSettings {
        fps: images.fps,
        is_varied: settings.is_varied(),
        has_corrections: settings.corrects.is_some(),
        ..ExportSettings::default()
    };
    let dataset = LerobotSettings { export: rows, run: Some(hash), ..LerobotSettings::default() };
    let selection = if settings.keep_failed { Selection::Recorded } else { Selection::Verified };
    let path = folder.join("dataset");
    let robot = worlds::robot(&settings.world)?;
    let exported = lerobot::export(store, &selection, &robot, &dataset, &path).map_err(|error| {
        RunError::broken("cannot write the dataset", error).with_hint("the episodes are safe; start again")
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
    // A shard may have no attempt of a task.
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
                // A sum of nothing is -0.0.
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
        Collected { rows, dataset: None, attempts: 0, finished: 0, interrupted: false, damaged: vec![], shard: None }
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
