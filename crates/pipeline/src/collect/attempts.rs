//! Attempts of a run: their order, their distribution over shards, and the unfinished ones.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::ops::Range;

use genmanip_benchmark::Outcome;
use genmanip_data::EpisodeStore;
use genmanip_rollout::collect::{PipelineSettings, attempt_id};
use genmanip_workspace::shard::Shard;
use genmanip_workspace::task_spool::TaskEntry;

use crate::folder::{Run, RunFolder};
use crate::index::IndexedAttempt;

/// Outcomes of finished attempts, by id.
pub(super) type Outcomes = BTreeMap<String, Outcome>;

/// An attempt that a run comprises, finished or not.
#[derive(Clone)]
pub(super) struct Planned {
    /// Id of the attempt.
    pub id: String,
    /// Index of the task in the run.
    pub task: usize,
    /// Number among the task's attempts, from 0.
    pub number: u64,
}

impl Planned {
    /// Attempts of a run, or of a shard of it, task by task.
    pub fn all(tasks: &[TaskEntry], per_task: usize, shard: Option<Shard>) -> Vec<Self> {
        let named = |(task, number): (usize, u64)| Self { id: attempt_id(&tasks[task].id, number), task, number };
        places(tasks.len(), per_task, shard).map(named).collect()
    }

    /// Attempts with these positions in a run without a fixed number of attempts, where the order is: the first attempt
    /// of
    /// every task, then the second of every task, and so on.
    pub fn round_robin(tasks: &[TaskEntry], range: Range<usize>) -> Vec<Self> {
        let named = |piece: usize| {
            let (task, number) = (piece % tasks.len(), (piece / tasks.len()) as u64);
            Self { id: attempt_id(&tasks[task].id, number), task, number }
        };
        range.map(named).collect()
    }
}

/// Index of the task and number of each attempt of a run, or of a shard of it, task by task.
fn places(tasks: usize, per_task: usize, shard: Option<Shard>) -> impl Iterator<Item = (usize, u64)> {
    let (first, step) = shard.map_or((0, 1), |shard| (shard.index(), shard.count()));
    (first..tasks.saturating_mul(per_task))
        .step_by(step)
        .map(move |piece| (piece / per_task, (piece % per_task) as u64))
}

/// Ids of the attempts of a run, or of a shard of it.
pub(crate) fn share(run: &Run, shard: Option<Shard>) -> impl Iterator<Item = String> {
    let tasks = run.tasks.entries();
    let named = |(task, number): (usize, u64)| attempt_id(&tasks[task].id, number);
    places(tasks.len(), run.episodes_per_task, shard).map(named)
}

/// Returns the unfinished ones of `attempts`; adds the outcomes of the finished ones to `outcomes`.
pub(super) fn left(
    attempts: &[Planned],
    known: &mut BTreeMap<String, IndexedAttempt>,
    folder: &RunFolder,
    store: &EpisodeStore,
    settings: &PipelineSettings,
    outcomes: &mut Outcomes,
) -> Vec<Planned> {
    let scenarios: BTreeSet<_> = std::fs::read_dir(folder.join("scenarios"))
        .map(|entries| entries.filter_map(|entry| Some(entry.ok()?.file_name())).collect())
        .unwrap_or_default();
    let has_all = |known: &IndexedAttempt| {
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
