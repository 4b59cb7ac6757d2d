//! The agent on fresh tasks and layouts, with a model and masks that may be oracles.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, PoisonError};

use genmanip_agent::ask::{Moment, Stage};
use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_bench::statistics::{StatisticsSettings, wilson_interval};
use genmanip_bench::text_table;
use genmanip_core::{EpisodeResult, Seed, Task, TaskKind, World};
use genmanip_rollout::collect::{Attempt, CollectSettings, Resources};
use genmanip_rollout::{RolloutError, Stage as Scene, run_episode};
use genmanip_run::agents::{AgentChoice, FailureClass, Injection, classify, keep};
use genmanip_run::{Progress, inputs};
use genmanip_scene::designer::{DesignSettings, design_many};
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;

/// Layouts tried per task; a task that cannot be laid out is no episode.
const LAYOUTS: u64 = 5;
/// Failed episodes of each class of which the evidence is kept.
const SAMPLES: usize = 12;

/// What the agent came to.
#[derive(Serialize)]
pub struct Measured {
    /// Seed of tasks, layouts and episodes.
    pub seed: u64,
    /// Who answered.
    pub vlm: String,
    /// Where the masks came from.
    pub masks: String,
    /// `p2p` or `grid`.
    pub path: String,
    /// `full` or `paper`.
    pub preset: String,
    /// Whether any of it knew the simulator's truth.
    pub oracle: bool,
    /// Of the tasks of each kind.
    pub kinds: BTreeMap<&'static str, Counted>,
    /// Of all kinds but `long_horizon` together.
    pub single_step: Counted,
    /// Of all.
    pub total: Counted,
    /// Tasks that could not be laid out, which are no episodes.
    pub not_laid_out: usize,
    /// Episodes in which the model could not be reached, which have no result.
    pub not_run: usize,
    /// Failed episodes with an injected error, by its stage.
    pub injected: BTreeMap<&'static str, Injected>,
}

/// Episodes of some kind.
#[derive(Default, Serialize)]
pub struct Counted {
    /// Episodes.
    pub episodes: usize,
    /// Share that succeeded.
    pub success: f64,
    /// 95 % interval of that (Wilson).
    pub success_interval: [f64; 2],
    /// Mean score.
    pub score: f64,
    /// Questions asked per episode.
    pub asks_per_episode: f64,
    /// Processor time per episode, s; layout apart.
    pub cpu_s_per_episode: f64,
    /// Failed episodes by class.
    pub failures: BTreeMap<String, usize>,
    /// What was seen in the first failed episodes of each class.
    pub evidence: BTreeMap<String, Vec<String>>,
    #[serde(skip)]
    successes: usize,
    #[serde(skip)]
    scores: f64,
    #[serde(skip)]
    asks: usize,
    #[serde(skip)]
    cpu_s: f64,
}

/// What is to be measured.
pub struct AgentArguments {
    /// The agent.
    pub choice: AgentChoice,
    /// Names of its services, for the record.
    pub names: [&'static str; 2],
    /// Kinds of tasks.
    pub kinds: Vec<TaskKind>,
    /// Tasks, the kinds in turn.
    pub count: usize,
    /// Folder for transcripts and pictures of every episode.
    pub transcripts: Option<PathBuf>,
}

struct Played {
    result: EpisodeResult,
    asks: usize,
    cpu_s: f64,
    blame: Option<Blame>,
    /// The first wrong answer that was given on purpose.
    injected: Option<Injection>,
}

/// Why an episode failed.
struct Blame {
    class: FailureClass,
    evidence: String,
}

/// Failed episodes with a wrong answer that was given on purpose.
#[derive(Default, Serialize)]
pub struct Injected {
    /// Failed episodes.
    pub failed: usize,
    /// Of these, how many the analysis labelled with what was injected; it never sees the injection.
    pub labelled: usize,
    /// What else it said, by class.
    pub labels: BTreeMap<&'static str, usize>,
    /// Of those that failed, how many succeed when only the injected answer is replaced by the right one.
    pub flips: usize,
}

/// Lets the agent do each task once; one thread.
///
/// # Errors
/// When an episode broke; one that fails is a result.
pub fn measure(
    arguments: &AgentArguments,
    world: &World,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let cards = Catalogue::builtin().cards();
    let batch = design_many(&arguments.kinds, arguments.count, cards, seed, &DesignSettings::default());
    let tasks = batch.map_err(|error| LabError::broken("the designer gave up", error))?.tasks;
    let settings = CollectSettings::in_world(world.clone());
    let planner = inputs::planner(world, &settings.planner)?;
    let resources = Resources { catalogue: Catalogue::builtin(), planner: &planner, grasps: GraspLibrary::builtin() };
    let [vlm, masks] = arguments.names.map(String::from);
    let name = |value: serde_json::Value| value.as_str().unwrap_or_default().to_owned();
    let mut measured = Measured {
        seed: seed.value(),
        oracle: vlm == "oracle" || masks == "oracle",
        vlm,
        masks,
        path: name(serde_json::to_value(arguments.choice.settings.path).unwrap_or_default()),
        preset: arguments.choice.settings.preset.name().into(),
        kinds: BTreeMap::new(),
        single_step: Counted::default(),
        total: Counted::default(),
        not_laid_out: 0,
        not_run: 0,
        injected: BTreeMap::new(),
    };
    progress.begin("episodes", tasks.len());
    for task in &tasks {
        match play(arguments, &arguments.choice, task, resources, &settings, seed)? {
            Err(Left::NotLaidOut) => measured.not_laid_out += 1,
            Err(Left::NotRun(reason)) => {
                measured.not_run += 1;
                progress.note(&format!("{} was not run: {reason}", task.id));
            }
            Ok(played) => {
                if task.kind != TaskKind::LongHorizon {
                    measured.single_step.add(&played);
                }
                measured.kinds.entry(task.kind.name()).or_default().add(&played);
                measured.total.add(&played);
                if let Some(Blame { class, evidence }) = &played.blame {
                    progress.note(&format!("{} {}: {evidence}", played.result.id, class.name()));
                    if let Some(injection) = played.injected {
                        let flipped = AgentChoice { forgiven: Some(injection.ask), ..arguments.choice.clone() };
                        let again = play(arguments, &flipped, task, resources, &settings, seed)?;
                        let counted = measured.injected.entry(injection.stage.name()).or_default();
                        counted.failed += 1;
                        counted.labelled += usize::from(is_label_of(*class, injection.stage));
                        *counted.labels.entry(class.name()).or_default() += 1;
                        counted.flips += usize::from(again.is_ok_and(|again| again.result.success));
                    }
                }
            }
        }
        progress.advance();
    }
    progress.end();
    Ok(measured)
}

/// Why there is no episode.
enum Left {
    NotLaidOut,
    NotRun(String),
}

/// One episode, or why there is none.
fn play(
    arguments: &AgentArguments,
    choice: &AgentChoice,
    task: &Task,
    resources: Resources,
    settings: &CollectSettings,
    seed: Seed,
) -> Result<Result<Played, Left>, LabError> {
    let stream = seed.fork("agent").fork(&task.id);
    let broke = |what: &str, error| LabError::broken(format!("episode {} {what}", task.id), error);
    for number in 0..LAYOUTS {
        let attempt = Attempt { task, number, seed: stream.fork_index(number) };
        let scenario = match attempt.scenario(resources, &settings.world, &settings.layout) {
            Ok(scenario) => scenario,
            Err(error) if error.is_defect() => return Err(LabError::broken("the layout broke", error)),
            Err(_) => continue,
        };
        let stage = Scene::open(Arc::new(scenario), resources.catalogue, resources.planner.robot());
        let stage = stage.map_err(|error| broke("cannot be opened", error))?;
        let mut clock = cpu_clock();
        let mut made = choice.make(&stage, resources.planner, resources.grasps, None)?;
        let episode = run_episode(&stage, made.policy.as_mut(), &attempt.id(), attempt.seed, &settings.rollout);
        let result = match episode {
            Err(RolloutError::NotRun { reason, .. }) => return Ok(Err(Left::NotRun(reason))),
            episode => episode.map_err(|error| broke("broke", error))?.result,
        };
        let cpu_s = clock();
        let transcript = made.transcribed.transcript();
        if let Some(folder) = &arguments.transcripts {
            keep(&made.transcribed, 0, &folder.join(&result.id))?;
        }
        let asks = transcript.moments.iter().filter(|moment| matches!(moment, Moment::Asked(_))).count();
        let heard = made.heard.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let injected = made.truth.as_ref().and_then(|truth| truth.injected().first().copied());
        let blame = (!result.success).then(|| {
            let (class, blamed) = classify(&heard, transcript.failure.as_ref());
            let said = transcript.failure.as_ref().map(ToString::to_string);
            let judged = result.failure().map(|failure| failure.to_string()).unwrap_or_default();
            Blame { class, evidence: format!("{blamed}; {}", said.unwrap_or(judged)) }
        });
        return Ok(Ok(Played { result, asks, cpu_s, blame, injected }));
    }
    Ok(Err(Left::NotLaidOut))
}

/// Whether a label says what was injected in a stage.
fn is_label_of(class: FailureClass, stage: Stage) -> bool {
    match stage {
        Stage::Decompose => class == FailureClass::Decomposition,
        Stage::Object => class == FailureClass::GraspGrounding,
        Stage::Part | Stage::GrabPoint => class == FailureClass::GraspProposal,
        // A random cell may hold another reference, or none.
        Stage::GridPath | Stage::PointToPoint => {
            matches!(class, FailureClass::PlanGrounding | FailureClass::PlanLocation)
        }
        Stage::Check => class == FailureClass::Checker,
    }
}

impl Counted {
    fn add(&mut self, played: &Played) {
        self.episodes += 1;
        self.successes += usize::from(played.result.success);
        self.scores += played.result.verdict.score;
        self.asks += played.asks;
        self.cpu_s += played.cpu_s;
        let count = self.episodes as f64;
        self.success = self.successes as f64 / count;
        self.success_interval = wilson_interval(self.successes, self.episodes, StatisticsSettings::default().z);
        self.score = self.scores / count;
        self.asks_per_episode = self.asks as f64 / count;
        self.cpu_s_per_episode = self.cpu_s / count;
        if let Some(Blame { class, evidence }) = &played.blame {
            *self.failures.entry(class.name().into()).or_default() += 1;
            let samples = self.evidence.entry(class.name().into()).or_default();
            if samples.len() < SAMPLES {
                samples.push(format!("{}: {evidence}", played.result.id));
            }
        }
    }
}

/// The same in words.
pub fn in_words(measured: &Measured) -> String {
    let Measured { vlm, masks, path, preset, oracle, .. } = measured;
    let head = ["kind", "episodes", "success", "95 %", "score", "asks", "CPU s", "failures"];
    let mut rows = vec![head.map(String::from).to_vec()];
    let all = [(&"single step", &measured.single_step), (&"all", &measured.total)];
    for (kind, counted) in measured.kinds.iter().chain(all) {
        let failures: Vec<String> = counted.failures.iter().map(|(class, count)| format!("{class} {count}")).collect();
        let [low, high] = counted.success_interval;
        rows.push(vec![
            (*kind).to_owned(),
            counted.episodes.to_string(),
            format!("{:.1} %", 100.0 * counted.success),
            format!("{:.1}–{:.1} %", 100.0 * low, 100.0 * high),
            format!("{:.3}", counted.score),
            format!("{:.1}", counted.asks_per_episode),
            format!("{:.1}", counted.cpu_s_per_episode),
            failures.join(", "),
        ]);
    }
    let oracle = if *oracle { " (oracle)" } else { "" };
    let mut text = format!("model {vlm}, masks {masks}, path {path}, preset {preset}{oracle}\n{}", text_table(&rows));
    for (stage, injected) in &measured.injected {
        let Injected { failed, labelled, flips, .. } = injected;
        text +=
            &format!("\nerrors in {stage}: {failed} episodes failed, {labelled} labelled so, {flips} succeed without");
    }
    text
}
