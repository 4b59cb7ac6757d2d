//! Candidate tasks of a suite: recorded ones, then designed ones, balanced over their traits.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::convert::Infallible;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::suite_format::{BuildStep, balanced_traits};
use genmanip_assets::Catalogue;
use genmanip_assets::metadata::Split;
use genmanip_core::{AssetUid, Atom, Relation, Seed, Task, TaskKind};
use genmanip_rollout::collect::in_parallel;
use genmanip_tasks::designer::{DesignSettings, Series};
use genmanip_tasks::references::{self, Clue, clues_at_places, is_needless};

use super::KINDS;
use genmanip_workspace::Progress;

/// Maximum number of designed tasks of a kind per wanted candidate.
const DESIGNS_PER_CANDIDATE: usize = 200;
/// Numbers of steps of long-horizon tasks, in equal shares, each with the number of batches composed in parallel.
/// Designs with more steps rarely succeed: with three about one in 1,000, with four one in 7,000.
const LOTS_OF_STEPS: [(usize, usize); 3] = [(2, 1), (3, 2), (4, 6)];
/// Maximum number of random draws for one long-horizon design.
const DRAWS_OF_STEPS: usize = 40_000;
/// Frequency from which a trait value counts as frequent, as a multiple of the mean over the values of that trait.
const FREQUENT: f64 = 1.1;
/// Minimum frequency of each relation in spatial and appearance tasks, as a share of the mean over relations.
const OF_EACH_RELATION: f64 = 0.1;
/// Maximum number of designs with a frequent value skipped per selected candidate; fewer if a design takes seconds.
const PASSED_OVER: usize = 10;
const PASSED_OVER_OF_STEPS: usize = 2;

/// Request for the tasks of a suite.
pub struct CandidateRequest<'a> {
    /// Number of tasks per kind.
    pub of_each_kind: usize,
    /// Recorded tasks, used before any are designed.
    pub recorded: &'a [Task],
    /// Catalogue of the objects.
    pub catalogue: &'a Catalogue,
    /// Seed of the designs.
    pub seed: Seed,
    /// Number of threads.
    pub workers: usize,
}

/// A batch of designs of one kind, composed sequentially.
struct Lot {
    kind: TaskKind,
    settings: DesignSettings,
    seed: Seed,
    /// Number of tasks requested of this batch.
    share: usize,
    passed_over: usize,
    /// Candidates of the kind so far, which the batch continues to balance.
    chosen: Chosen,
}

/// Candidate tasks of every kind, each of which cannot be understood without the clue of its kind, and the record of
/// this selection step; `None` if interrupted.
pub fn design(wanted: &CandidateRequest, progress: &dyn Progress, stop: &AtomicBool) -> Option<(Vec<Task>, BuildStep)> {
    let mut stage = BuildStep::new("say what their kind is about, and need it");
    progress.begin("designing", wanted.of_each_kind * KINDS.len());
    for task in wanted.recorded.iter().filter(|task| !KINDS.contains(&task.kind)) {
        stage.refuse(format!("{}, recorded: a suite has no such kind", task.kind.name()));
    }
    let mut chosen = Vec::new();
    for kind in KINDS {
        let mut recorded = Chosen { wanted: wanted.of_each_kind, ..Chosen::default() };
        for task in wanted.recorded.iter().filter(|task| task.kind == kind) {
            match recorded.refusal(task) {
                Some(reason) => stage.refuse(format!("{}, recorded: {reason}", kind.name())),
                None => {
                    recorded.take(task.clone(), wanted.catalogue);
                    progress.advance();
                }
            }
        }
        chosen.push((kind, recorded));
    }
    let mut said: BTreeSet<String> =
        chosen.iter().flat_map(|(_, own)| &own.tasks).map(|task| task.instruction.clone()).collect();
    for lots_of in [lots_of_steps, lots_of_relations, lots_of_the_rest] {
        let mut lots = lots_of(&chosen, wanted.seed);
        // The slowest batches start first.
        lots.sort_by_key(|lot| Reverse(lot.settings.steps[0]));
        let compose = |lot: &Lot| Ok::<_, Infallible>((lot.kind, compose(lot, wanted.catalogue, progress, stop)));
        let Ok(composed) = in_parallel(&lots, wanted.workers, stop, &compose);
        for (kind, (designed, refusals)) in composed {
            refusals.into_iter().for_each(|reason| stage.refuse(format!("{}: {reason}", kind.name())));
            let Some((_, own)) = chosen.iter_mut().find(|(other, _)| *other == kind) else { continue };
            for mut task in designed {
                let reason = own.refusal(&task).or_else(|| {
                    (!said.insert(task.instruction.clone())).then(|| "another one says the same".to_owned())
                });
                match reason {
                    Some(reason) => stage.refuse(format!("{}: {reason}", kind.name())),
                    None => {
                        task.id = format!("{}-{}-{:05}", kind.name(), wanted.seed, own.tasks.len());
                        own.take(task, wanted.catalogue);
                    }
                }
            }
        }
    }
    progress.end();
    if stop.load(Ordering::Relaxed) {
        return None;
    }
    let tasks: Vec<Task> = chosen.into_iter().flat_map(|(_, own)| own.tasks).collect();
    tasks.iter().for_each(|task| stage.pass(task.kind));
    Some((tasks, stage))
}

/// Batches of the kinds without a prescribed relation. Long-horizon tasks have equal shares of each number of steps.
fn lots_of_steps(chosen: &[(TaskKind, Chosen)], seed: Seed) -> Vec<Lot> {
    let mut lots = Vec::new();
    for (kind, own) in chosen {
        let left = own.left();
        match kind {
            TaskKind::LongHorizon => {
                for ((steps, count), share) in LOTS_OF_STEPS.into_iter().zip(shares(left, LOTS_OF_STEPS.len())) {
                    let settings =
                        DesignSettings { steps: [steps; 2], max_draws: DRAWS_OF_STEPS, ..DesignSettings::default() };
                    for (number, share) in shares(share, count).enumerate() {
                        let name = format!("{steps} steps, lot {number}");
                        lots.push(Lot::new(*kind, &name, settings.clone(), share, seed).passing(PASSED_OVER_OF_STEPS));
                    }
                }
            }
            TaskKind::CommonSense => lots.push(Lot::new(*kind, "needs", DesignSettings::default(), left, seed)),
            _ => {}
        }
    }
    lots
}

/// Batches of the other kinds; most of their tasks are for the relations that are rarest so far.
fn lots_of_relations(chosen: &[(TaskKind, Chosen)], seed: Seed) -> Vec<Lot> {
    let count = |relation| {
        let tasks = chosen.iter().flat_map(|(_, own)| &own.tasks);
        tasks.filter(|task| asks_for(task, relation)).count() as f64
    };
    let counts = Relation::ALL.map(count);
    let chosen: Vec<_> =
        chosen.iter().filter(|(kind, _)| [TaskKind::Spatial, TaskKind::Appearance].contains(kind)).collect();
    let left: usize = chosen.iter().map(|(_, own)| own.left()).sum();
    let mean = (counts.iter().sum::<f64>() + left as f64) / counts.len() as f64;
    // A few tasks for every relation, so that no kind lacks one.
    let wanted = counts.map(|count| (mean - count).max(0.0) + OF_EACH_RELATION * mean);
    let mut lots = Vec::new();
    for (kind, own) in chosen {
        let mut sum = 0.0;
        let until = |sum: f64| (own.left() as f64 * sum / wanted.iter().sum::<f64>() + 0.5) as usize;
        for (relation, wanted) in Relation::ALL.into_iter().zip(wanted) {
            let share = until(sum + wanted) - until(sum);
            sum += wanted;
            let settings = DesignSettings { goal_relation: Some(relation), ..DesignSettings::default() };
            lots.push(Lot::new(*kind, relation.name(), settings, share, seed));
        }
    }
    lots
}

/// Batches for the tasks that all previous batches failed to give.
fn lots_of_the_rest(chosen: &[(TaskKind, Chosen)], seed: Seed) -> Vec<Lot> {
    let rest = |(kind, own): &(TaskKind, Chosen)| {
        let lot = Lot::new(*kind, "rest", DesignSettings::default(), own.left(), seed);
        Lot { chosen: own.clone(), ..lot }
    };
    chosen.iter().map(rest).collect()
}

impl Lot {
    fn new(kind: TaskKind, name: &str, settings: DesignSettings, share: usize, seed: Seed) -> Self {
        let seed = seed.fork(&format!("{}, {name}", kind.name()));
        let chosen = Chosen { wanted: share, ..Chosen::default() };
        Self { kind, settings, seed, share, passed_over: PASSED_OVER, chosen }
    }

    fn passing(self, passed_over: usize) -> Self {
        Self { passed_over, ..self }
    }
}

/// Splits a number into parts that differ by at most one, larger first.
fn shares(number: usize, parts: usize) -> impl Iterator<Item = usize> {
    (0..parts).map(move |part| number / parts + usize::from(part < number % parts))
}

/// Tasks of a batch, and the reasons why designs were rejected.
fn compose(lot: &Lot, catalogue: &Catalogue, progress: &dyn Progress, stop: &AtomicBool) -> (Vec<Task>, Vec<String>) {
    let kinds = [lot.kind];
    let (mut tasks, mut refusals, mut passed_over) = (Vec::new(), Vec::new(), 0);
    let mut chosen = lot.chosen.clone();
    let Ok(mut series) = Series::new(&kinds, catalogue.cards(), lot.seed, &lot.settings, false) else {
        return (tasks, refusals);
    };
    for _ in 0..DESIGNS_PER_CANDIDATE * lot.share {
        if tasks.len() >= lot.share || stop.load(Ordering::Relaxed) {
            break;
        }
        let Ok(task) = series.compose() else {
            refusals.push("no such task could be composed".to_owned());
            continue;
        };
        if lot.settings.goal_relation.is_some_and(|relation| !asks_for(&task, relation)) {
            refusals.push("its kind has no goals of that relation".into());
        } else if let Some(reason) = chosen.refusal(&task) {
            refusals.push(reason);
        } else if chosen.is_frequent(&task, catalogue) && passed_over < lot.passed_over * (tasks.len() + 1) {
            passed_over += 1;
            refusals.push("others like it are frequent already".to_owned());
        } else {
            chosen.take(task.clone(), catalogue);
            tasks.push(task);
            progress.advance();
        }
    }
    (tasks, refusals)
}

/// Candidates of a kind selected so far.
#[derive(Clone, Default)]
struct Chosen {
    tasks: Vec<Task>,
    /// Number of candidates requested of this kind.
    wanted: usize,
    /// Number of candidates by stated need.
    needs: BTreeMap<String, usize>,
    /// Number of spatial candidates in which one object is identified by its place.
    with_one_clue: usize,
    /// Number of candidates by trait and value; 0 for values only seen in rejected designs.
    traits: BTreeMap<String, BTreeMap<String, usize>>,
}

impl Chosen {
    /// Number of candidates still missing.
    fn left(&self) -> usize {
        self.wanted.saturating_sub(self.tasks.len())
    }

    fn take(&mut self, task: Task, catalogue: &Catalogue) {
        if let Some(need) = need(&task) {
            *self.needs.entry(need).or_default() += 1;
        }
        self.with_one_clue += usize::from(has_one_clue(&task));
        for (name, values) in traits(&task, catalogue) {
            for value in values {
                *self.traits.entry(name.clone()).or_default().entry(value).or_default() += 1;
            }
        }
        self.tasks.push(task);
    }

    /// True if a trait of the task has a value with more candidates than the mean over the values seen, see
    /// [`FREQUENT`].
    fn is_frequent(&mut self, task: &Task, catalogue: &Catalogue) -> bool {
        let mut is_frequent = false;
        for (name, values) in traits(task, catalogue) {
            let counts = self.traits.entry(name).or_default();
            for value in values {
                counts.entry(value.clone()).or_default();
                let mean = counts.values().sum::<usize>() as f64 / counts.len() as f64;
                is_frequent |= counts[&value] as f64 > FREQUENT * mean + 1.0;
            }
        }
        is_frequent
    }

    /// Reason why a task cannot be a candidate; `None` if it can.
    fn refusal(&self, task: &Task) -> Option<String> {
        match Clue::of(task.kind).filter(|&clue| is_needless(task, clue)) {
            Some(Clue::Need) => return Some("what is meant is clear without the need".into()),
            Some(Clue::Place) => return Some("what is meant is clear without where it is".into()),
            Some(Clue::Trait) => return Some("what is meant is clear without what it looks like".into()),
            None => {}
        }
        if need(task).is_some_and(|need| self.needs.get(&need).is_some_and(|&count| count >= 2)) {
            return Some("its need occurs twice already".into());
        }
        // The rule-based reader may fail to parse a recorded sentence, but must not give it another meaning.
        match references::check(task) {
            Ok(()) => {}
            Err(mismatch) if references::is_beyond_the_reader(task, &mismatch) => {}
            Err(mismatch) => return Some(format!("its sentence does not mean its goal: {mismatch}")),
        }
        // At least half of the spatial candidates identify two objects by their place.
        let is_half = 2 * self.with_one_clue >= self.wanted.max(self.tasks.len());
        (has_one_clue(task) && is_half).then(|| "enough tasks with one clue".into())
    }
}

/// True if some alternative of a goal contains a relation.
fn asks_for(task: &Task, relation: Relation) -> bool {
    let is_asked = |atom: &Atom| matches!(atom, Atom::Relation { relation: asked, .. } if *asked == relation);
    task.goal.alternatives.iter().flatten().any(is_asked)
}

/// Need that a common-sense task states before its request, in lower case; `None` for other kinds.
pub(crate) fn need(task: &Task) -> Option<String> {
    let need = || task.instruction.split(['.', ':', ';']).next().unwrap_or_default().to_lowercase();
    (task.kind == TaskKind::CommonSense).then(need)
}

fn has_one_clue(task: &Task) -> bool {
    task.kind == TaskKind::Spatial && clues_at_places(task).is_ok_and(|count| count < 2)
}

/// Balanced traits of a task, by name.
pub fn traits(task: &Task, catalogue: &Catalogue) -> BTreeMap<String, Vec<String>> {
    let is_unseen = |uid: &AssetUid| catalogue.split(uid) != Split::Train;
    balanced_traits(task, clues_at_places(task).unwrap_or(0), &is_unseen)
}
