//! Agent on fresh tasks and layouts, with a model and masks that may be oracles.

use genmanip_workspace::documents;
use genmanip_workspace::worlds;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, PoisonError};

use genmanip_agent::ask::TranscriptEvent;
use genmanip_agent_sim::{AgentChoice, keep};
use genmanip_benchmark::failure_page;
use genmanip_benchmark::statistics::{StatisticsSettings, wilson_interval};
use genmanip_core::{AgentFailure, EpisodeResult, Relation, Seed, Task, TaskKind, World};
use genmanip_rollout::collect::{PipelineSettings, Resources};
use genmanip_rollout::{RolloutError, Stage, run_episode};
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;
use serde::Serialize;

use crate::agent_page::Gathered;
use crate::clock::cpu_clock;
use crate::{LabError, episodes};

/// Maximum number of failed episodes per class whose evidence is kept. Chosen by hand.
const SAMPLES: usize = 12;

/// Success rates, cost and failures of the agent over all episodes.
#[derive(Serialize)]
pub struct Measured {
    /// Seed of tasks, layouts and episodes.
    pub seed: u64,
    /// Service that answers the agent's questions (vision-language model); `oracle` reads simulator truth.
    pub vlm: String,
    /// Service that segments the images; `oracle` reads simulator truth.
    pub masks: String,
    /// Form of the model's answer for a placement: one grid cell (`p2p`), or a path over the grid (`grid`).
    pub path: String,
    /// Preset of the agent's settings: `full` or `paper`.
    pub preset: String,
    /// True if any part read simulator truth.
    pub oracle: bool,
    /// Totals by kind of task.
    pub kinds: BTreeMap<&'static str, Counted>,
    /// Totals by relation; an episode counts for every relation among the conditions of its goal.
    pub relations: BTreeMap<&'static str, Counted>,
    /// Totals of all kinds but `long_horizon`.
    pub single_step: Counted,
    /// Totals of all kinds.
    pub total: Counted,
    /// Number of tasks for which no layout was found; they count as no episode.
    pub not_laid_out: usize,
    /// Number of episodes without a result because the model could not be reached.
    pub not_run: usize,
}

/// Totals of a group of episodes.
#[derive(Default, Serialize)]
pub struct Counted {
    /// Number of episodes that were run.
    pub episodes: usize,
    /// Success rate, 0 to 1.
    pub success: f64,
    /// 95 % Wilson interval of the success rate.
    pub success_interval: [f64; 2],
    /// Mean score, 0 to 1: fraction of the goal reached.
    pub score: f64,
    /// Mean number of questions to the model per episode.
    pub asks_per_episode: f64,
    /// Number of questions to the model over number of picks that the arm carried out; 0 without a pick.
    pub asks_per_pick: f64,
    /// CPU time per episode without layout, s.
    pub cpu_s_per_episode: f64,
    /// Number of failed episodes by failure class of the analysis.
    pub failures: BTreeMap<String, usize>,
    /// Evidence of the first failed episodes of each class, as `EPISODE: EVIDENCE`.
    pub evidence: BTreeMap<String, Vec<String>>,
    #[serde(skip)]
    successes: usize,
    #[serde(skip)]
    scores: f64,
    #[serde(skip)]
    asks: usize,
    #[serde(skip)]
    picks: usize,
    #[serde(skip)]
    cpu_s: f64,
}

/// Agent, tasks and outputs of the measurement.
pub struct AgentArguments {
    /// The agent, with its services and settings.
    pub choice: AgentChoice,
    /// Names of the services for questions and for masks, in this order.
    pub names: [&'static str; 2],
    /// Kinds of tasks to run, in turn.
    pub kinds: Vec<TaskKind>,
    /// Relation that the goal of each task must contain; any if `None`.
    pub relation: Option<Relation>,
    /// Number of tasks, the kinds in turn.
    pub count: usize,
    /// Folder for transcripts and images of every episode.
    pub transcripts: Option<PathBuf>,
    /// File for the failure page.
    pub page: Option<PathBuf>,
}

struct Played {
    result: EpisodeResult,
    asks: usize,
    picks: usize,
    cpu_s: f64,
}

/// Runs the agent once on each task; one thread.
///
/// # Errors
/// If an episode raises an error; a failed episode is a result.
pub fn measure(
    arguments: &AgentArguments,
    world: &World,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let tasks = match arguments.relation {
        Some(relation) => episodes::tasks_about(relation, &arguments.kinds, arguments.count, seed)?,
        None => episodes::tasks(&arguments.kinds, arguments.count, seed)?,
    };
    let settings = PipelineSettings::in_world(world.clone());
    let planner = worlds::planner(world, &settings.planner)?;
    let resources = Resources::builtin(&planner);
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
        relations: BTreeMap::new(),
        single_step: Counted::default(),
        total: Counted::default(),
        not_laid_out: 0,
        not_run: 0,
    };
    let mut gathered = Gathered::default();
    progress.begin("episodes", tasks.len());
    for task in &tasks {
        match play(arguments, task, resources, (&settings, seed), &mut gathered)? {
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
                for relation in episodes::goal_relations(task) {
                    measured.relations.entry(relation.name()).or_default().add(&played);
                }
                measured.total.add(&played);
                if let Some(AgentFailure { class: Some(class), evidence, .. }) = &played.result.agent_failure {
                    progress.note(&format!("{} {}: {evidence}", played.result.id, class.name()));
                }
            }
        }
        progress.advance();
    }
    progress.end();
    if let Some(page) = &arguments.page {
        let page_of = gathered.page(&arguments.choice.name(), measured.oracle);
        documents::write_file(page, failure_page(&page_of).as_bytes())?;
    }
    Ok(measured)
}

/// Reasons why a task has no episode: no layout, or the model could not be reached.
enum Left {
    NotLaidOut,
    NotRun(String),
}

/// Plays one episode, or returns the reason why there is none; adds it to the failure page.
fn play(
    arguments: &AgentArguments,
    task: &Task,
    resources: Resources,
    (settings, seed): (&PipelineSettings, Seed),
    gathered: &mut Gathered,
) -> Result<Result<Played, Left>, LabError> {
    let stream = seed.fork("agent").fork(&task.id);
    let broke = |what: &str, error| LabError::broken(format!("episode {} {what}", task.id), error);
    let Some((attempt, scenario)) = episodes::laid_out(task, resources, settings, stream)? else {
        return Ok(Err(Left::NotLaidOut));
    };
    let stage = Stage::open(Arc::new(scenario), resources.catalogue, resources.planner.robot());
    let stage = stage.map_err(|error| broke("cannot be opened", error))?;
    let mut clock = cpu_clock();
    let choice = AgentChoice { is_analysed: true, ..arguments.choice.clone() };
    let mut made = choice.make(&stage, resources.planner, resources.grasps, None)?;
    let episode = run_episode(&stage, &mut made, &attempt.id(), attempt.seed, &settings.rollout);
    let mut result = match episode {
        Err(RolloutError::NotRun { reason, .. }) => return Ok(Err(Left::NotRun(reason))),
        episode => episode.map_err(|error| broke("broke", error))?.result,
    };
    let cpu_s = clock();
    let transcript = made.transcribed.transcript();
    if let Some(folder) = &arguments.transcripts {
        keep(&made.transcribed, 0, &folder.join(&result.id))?;
    }
    let asks = transcript.moments.iter().filter(|moment| matches!(moment, TranscriptEvent::Asked(_))).count();
    let judgements = made.judgements.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let judged = result.failure().map(|failure| failure.to_string()).unwrap_or_default();
    if let Some(failure) = &mut result.agent_failure {
        let said = transcript.failure.as_ref().map_or(judged, ToString::to_string);
        failure.evidence = format!("{}; {said}", failure.evidence);
    }
    gathered.add(task.kind, &result, &judgements, &made.transcribed);
    Ok(Ok(Played { result, asks, picks: transcript.picks(), cpu_s }))
}

impl Counted {
    fn add(&mut self, played: &Played) {
        self.episodes += 1;
        self.successes += usize::from(played.result.success);
        self.scores += played.result.verdict.score;
        self.asks += played.asks;
        self.picks += played.picks;
        self.cpu_s += played.cpu_s;
        let count = self.episodes as f64;
        self.success = self.successes as f64 / count;
        self.success_interval = wilson_interval(self.successes, self.episodes, StatisticsSettings::default().z);
        self.score = self.scores / count;
        self.asks_per_episode = self.asks as f64 / count;
        self.asks_per_pick = if self.picks == 0 { 0.0 } else { self.asks as f64 / self.picks as f64 };
        self.cpu_s_per_episode = self.cpu_s / count;
        if let Some(AgentFailure { class: Some(class), evidence, .. }) = &played.result.agent_failure {
            *self.failures.entry(class.name().into()).or_default() += 1;
            let samples = self.evidence.entry(class.name().into()).or_default();
            if samples.len() < SAMPLES {
                samples.push(format!("{}: {evidence}", played.result.id));
            }
        }
    }
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let Measured { vlm, masks, path, preset, oracle, .. } = measured;
    let head = ["kind", "episodes", "success", "95 %", "score", "asks", "per pick", "CPU s", "failures"];
    let mut rows = vec![head.map(String::from).to_vec()];
    let all = [(&"single step", &measured.single_step), (&"all", &measured.total)];
    for (kind, counted) in measured.kinds.iter().chain(all).chain(&measured.relations) {
        let failures: Vec<String> = counted.failures.iter().map(|(class, count)| format!("{class} {count}")).collect();
        let [low, high] = counted.success_interval;
        rows.push(vec![
            (*kind).to_owned(),
            counted.episodes.to_string(),
            format!("{:.1} %", 100.0 * counted.success),
            format!("{:.1}–{:.1} %", 100.0 * low, 100.0 * high),
            format!("{:.3}", counted.score),
            format!("{:.1}", counted.asks_per_episode),
            format!("{:.1}", counted.asks_per_pick),
            format!("{:.1}", counted.cpu_s_per_episode),
            failures.join(", "),
        ]);
    }
    let oracle = if *oracle { " (oracle)" } else { "" };
    format!("model {vlm}, masks {masks}, path {path}, preset {preset}{oracle}\n{}", text_table(&rows))
}
