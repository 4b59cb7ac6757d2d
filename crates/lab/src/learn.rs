//! Learned policies from nothing: one family of tasks is designed, demonstrations are collected, a policy is trained and
//! evaluated on unseen layouts.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use genmanip_assets::Catalogue;
use genmanip_assets::worlds::default_world;
use genmanip_benchmark::distributions::layout_hash;
use genmanip_benchmark::statistics::{Rate, StatisticsSettings};
use genmanip_core::{ExpertStyle, Goal, GraphEdge, GraphNode, ObjectCard, Relation, SceneGraph, Seed, Task, TaskKind};
use genmanip_layout::LayoutSettings;
use genmanip_pipeline::collect::{CollectOptions, collect};
use genmanip_pipeline::evaluate::{EndingRules, EvaluateOptions, Suite, evaluate};
use genmanip_pipeline::layouts::{LayoutOutput, lay_out};
use genmanip_pipeline::learn::{CheckOptions, Length, Preset, TRAINING, TrainOptions, check, train};
use genmanip_pipeline::{PolicyFactory, Run, RunFolder};
use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::expert::ExpertSettings;
use genmanip_workspace::Progress;
use genmanip_workspace::task_spool::Tasks;
use rand::RngExt;
use serde::Serialize;

use crate::LabError;
use crate::clock::process_clock;

/// Settings of [`measure`].
#[derive(Clone, Debug)]
pub struct LearnArguments {
    /// Inputs and sizes.
    pub preset: Preset,
    /// Number of demonstrations.
    pub demos: usize,
    /// Number of steps or time of the training.
    pub length: Length,
    /// Simulator labels in training, where the inputs hold no simulator truth.
    pub labels: bool,
    /// Number of unseen layouts.
    pub layouts: usize,
    /// Cores that are used.
    pub workers: usize,
}

/// Results.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// Number of demonstrations.
    pub demos: usize,
    /// Number of samples seen in training.
    pub samples: u64,
    /// CPU time of collecting, s.
    pub cpu_s_collect: f64,
    /// CPU time of training, reading the demonstrations included, s.
    pub cpu_s_train: f64,
    /// Wall-clock time of everything, evaluation included, s.
    pub wall_s: f64,
    /// Number of parameters.
    pub parameters: usize,
    /// Share of unseen layouts solved at the end.
    pub success: f64,
    /// Lower end of its 95 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// L1 error of normalised actions on training samples.
    pub final_l1: f64,
    /// True if a short training that is stopped and continued gives the tensors of one that is not.
    pub resumed_identical: bool,
    /// Share of training layouts that recorded rows solve as a learned policy's output.
    pub replay_success: f64,
}

/// Objects that the family moves; chosen: one grasp from above fits all of them.
const INSTANCES: usize = 8;
/// Largest and smallest side of a moved object, m: what a gripper that opens 8 cm holds.
const GRASPABLE_M: (f64, f64) = (0.03, 0.074);
/// Number of other objects at most.
const MAX_OTHERS: usize = 3;
/// Demonstrations that are replayed.
const REPLAYED: usize = 60;
/// Steps of the short training that is stopped and continued.
const SHORT: u64 = 60;
/// Time limit of the policy as a multiple of the expert's median time.
const HORIZON: f64 = 3.0;

/// Measures one family in a new folder.
///
/// # Errors
/// When a stage fails, or too few layouts are found.
pub fn measure(
    arguments: &LearnArguments,
    seed: Seed,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let LearnArguments { preset, demos, length, labels, layouts, workers } = *arguments;
    let (started, stop, run) = (Instant::now(), AtomicBool::new(false), folder.join("run"));
    fs::create_dir(folder).map_err(|error| LabError::file("create", folder, error))?;
    let tasks = family(seed.fork("family"))?;
    let expert = ExpertSettings { style: ExpertStyle::Consistent, ..ExpertSettings::default() };
    let settings = PipelineSettings { expert, ..PipelineSettings::in_world((*default_world()).clone()) };
    let mut clock = process_clock();
    let record = Run::new(Tasks::spool(tasks.iter().cloned(), folder)?, 0, settings, seed.fork("demonstrations"));
    let options = CollectOptions { workers, verified: Some(demos), ..CollectOptions::default() };
    collect(&run, record, options, progress, &stop)?;
    let cpu_s_collect = clock();
    let checked =
        check(&CheckOptions { run: run.clone(), preset, demonstrations: REPLAYED, workers }, progress, &stop)?;
    let stopped = || LabError::input("the measurement was stopped");
    let replay_success = checked.ok_or_else(stopped)?.replay_success.value;
    let training = |out: &str, length| TrainOptions {
        run: run.clone(),
        preset,
        length,
        seed: seed.fork("training"),
        labels,
        out: folder.join(out),
        threads: workers,
    };
    let resumed_identical = resumed_identical(&training, progress)?;
    let mut clock = process_clock();
    let trained = train(&training("policy", length), progress, &stop)?.ok_or_else(stopped)?;
    let cpu_s_train = clock();
    let success = evaluated(&tasks, seed, &trained.policy, (layouts, workers), folder, progress)?;
    Ok(Measured {
        demos: trained.demonstrations,
        samples: trained.samples,
        cpu_s_collect,
        cpu_s_train,
        wall_s: started.elapsed().as_secs_f64(),
        parameters: trained.parameters,
        success: success.value,
        low: success.low,
        high: success.high,
        final_l1: trained.final_l1,
        resumed_identical,
        replay_success,
    })
}

/// Tasks of one family: one of eight objects goes into a container; it lies on any side of it, among up to three others.
fn family(seed: Seed) -> Result<Vec<Task>, LabError> {
    let cards = Catalogue::builtin().cards();
    let mut rng = seed.rng();
    let container = cards.iter().find(|card| card.uid == CONTAINER);
    let container = container.ok_or_else(|| LabError::input("the catalogue has no wicker basket"))?;
    let fits = |card: &&ObjectCard| {
        let sides = card.size_m.to_array();
        card.can_grasp && !card.is_container && sides.iter().all(|side| (GRASPABLE_M.0..=GRASPABLE_M.1).contains(side))
    };
    let mut graspable: Vec<&ObjectCard> = cards.iter().filter(fits).collect();
    for end in (1..graspable.len()).rev() {
        graspable.swap(end, rng.random_range(0..=end));
    }
    let (moved, others) = graspable.split_at(INSTANCES.min(graspable.len()));
    let mut tasks = Vec::new();
    for (number, card) in moved.iter().enumerate() {
        for (turn, side) in Relation::SIDES.into_iter().enumerate() {
            let count = (number + turn) % (MAX_OTHERS + 1);
            let others: Vec<&ObjectCard> =
                (0..count.min(others.len())).map(|at| others[(number + at) % others.len()]).collect();
            tasks.push(task(card, container, side, &others));
        }
    }
    Ok(tasks)
}

/// The wicker basket, wide enough for all objects.
const CONTAINER: &str = "051";

fn task(card: &ObjectCard, container: &ObjectCard, side: Relation, others: &[&ObjectCard]) -> Task {
    let edge = |subject: &ObjectCard, relation| GraphEdge {
        subject: subject.uid.clone(),
        relation,
        reference: container.uid.clone(),
        second_reference: None,
    };
    let at = Relation::SIDES.iter().position(|one| *one == side).unwrap_or(0);
    let around = others.iter().enumerate().map(|(number, other)| edge(other, Relation::SIDES[(at + 1 + number) % 4]));
    let cards: Vec<&ObjectCard> = [card, container].into_iter().chain(others.iter().copied()).collect();
    Task {
        id: format!("{}_{}_{}", card.uid, side.facts().name, TaskKind::PickAndPlace.name()),
        kind: TaskKind::PickAndPlace,
        instruction: format!("Put the {} into the {}.", card.name.to_lowercase(), container.name.to_lowercase()),
        goal: Goal { alternatives: vec![vec![edge(card, Relation::In).atom()]] },
        scene_graph: SceneGraph {
            description: String::new(),
            nodes: cards.iter().map(|card| GraphNode::of(card)).collect(),
            edges: std::iter::once(edge(card, side)).chain(around).collect(),
        },
        objects: cards.into_iter().map(|card| Arc::new(card.clone())).collect(),
        surfaces: Vec::new(),
        interchangeable: Vec::new(),
        source: "lab learn".into(),
    }
}

/// True if a short training that is stopped half-way and continued gives the tensors of one in one go.
fn resumed_identical(
    training: &impl Fn(&str, Length) -> TrainOptions,
    progress: &dyn Progress,
) -> Result<bool, LabError> {
    let stopped = || LabError::input("the measurement was stopped");
    let stop = AtomicBool::new(false);
    let length = Length::Steps(SHORT);
    let whole = train(&training("short", length), progress, &stop)?.ok_or_else(stopped)?;
    let halves = StopAfter { inner: progress, steps: SHORT / 2, seen: Mutex::new(None), stop: AtomicBool::new(false) };
    let first = train(&training("halves", length), &halves, &halves.stop)?;
    let second = train(&training("halves", length), progress, &stop)?.ok_or_else(stopped)?;
    let was_stopped = first.is_none() && second.resumed_from.is_some_and(|from| (1..SHORT).contains(&from));
    Ok(was_stopped && second.tensors_sha256 == whole.tensors_sha256)
}

/// Stops a training after a number of steps.
struct StopAfter<'a> {
    inner: &'a dyn Progress,
    steps: u64,
    /// Steps that are finished; `None` before the training, since reading the demonstrations counts units of its own.
    seen: Mutex<Option<u64>>,
    stop: AtomicBool,
}

impl StopAfter<'_> {
    fn seen(&self) -> MutexGuard<'_, Option<u64>> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Progress for StopAfter<'_> {
    fn begin(&self, what: &str, total: usize) {
        *self.seen() = (what == TRAINING).then_some(0);
        self.inner.begin(what, total);
    }

    fn advance(&self) {
        let mut seen = self.seen();
        *seen = seen.map(|seen| seen + 1);
        self.stop.fetch_or(*seen == Some(self.steps), Ordering::Relaxed);
        self.inner.advance();
    }

    fn end(&self) {
        self.inner.end();
    }

    fn note(&self, text: &str) {
        self.inner.note(text);
    }
}

/// Success of the policy on layouts that differ from all of the training.
fn evaluated(
    tasks: &[Task],
    seed: Seed,
    policy: &Path,
    (layouts, workers): (usize, usize),
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Rate, LabError> {
    let (stop, scenarios) = (AtomicBool::new(false), folder.join("unseen"));
    let output = LayoutOutput { folder: scenarios.clone(), explain: false };
    let each = (layouts * 5).div_ceil(tasks.len() * 4);
    let (world, settings) = (default_world(), LayoutSettings::default());
    lay_out(tasks, each, &world, &settings, seed.fork("unseen"), &output, workers, progress, &stop, &mut |_| {})?;
    let trained_on = Suite::of_run(&folder.join("run"))?;
    let known: BTreeSet<String> = trained_on.scenarios.iter().map(|scenario| layout_hash(scenario)).collect();
    let mut suite = Suite::of_scenarios(&[scenarios])?;
    suite.cases.retain(|case| !known.contains(&layout_hash(&case.scenario)));
    // Layouts of all tasks in turn.
    suite.cases.sort_by_key(|case| case.scenario.id.rsplit('-').next().map(str::to_owned));
    suite.cases.truncate(layouts);
    let kept: BTreeSet<&str> = suite.cases.iter().map(|case| case.scenario.id.as_str()).collect();
    suite.scenarios.retain(|scenario| kept.contains(scenario.id.as_str()));
    let horizon_s = HORIZON * median_duration_s(&folder.join("run"))?;
    let ending = EndingRules { horizon_s: Some(horizon_s), ..EndingRules::default() };
    let learned = PolicyFactory::resolve(&format!("learned:{}", policy.display()))?;
    let options = EvaluateOptions { workers, ending, ..EvaluateOptions::default() };
    let reports = evaluate(&suite, &[learned], &options, progress, &stop)?;
    let report = reports.first().ok_or_else(|| LabError::input("the policy was not evaluated"))?;
    let successes = report.results.iter().filter(|result| result.success).count();
    Ok(Rate::new(successes, report.results.len(), &StatisticsSettings::default()))
}

/// Median time of the demonstrations of a run, s.
fn median_duration_s(run: &Path) -> Result<f64, LabError> {
    let (folder, _) = RunFolder::open(run)?;
    let survey = folder.survey(&folder.store()?)?;
    let mut durations: Vec<f64> =
        survey.sound.iter().map(|attempt| &attempt.outcome).filter(|it| it.success).map(|it| it.duration_s).collect();
    durations.sort_by(f64::total_cmp);
    durations.get(durations.len() / 2).copied().ok_or_else(|| LabError::input("no demonstration was verified"))
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    format!(
        "demonstrations  {} in {:.0} s of CPU time, replayed {:.1} %\ntraining        {} samples in {:.0} s of CPU time, \
         {} parameters, L1 {:.4}\nsuccess         {:.1} % ({:.1}–{:.1} %)\nresumed         {}\n",
        measured.demos,
        measured.cpu_s_collect,
        100.0 * measured.replay_success,
        measured.samples,
        measured.cpu_s_train,
        measured.parameters,
        measured.final_l1,
        100.0 * measured.success,
        100.0 * measured.low,
        100.0 * measured.high,
        if measured.resumed_identical { "the same tensors" } else { "OTHER TENSORS" },
    )
}
