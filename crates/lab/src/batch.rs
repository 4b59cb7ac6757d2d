//! Many concurrent agents with one slow, faulty model server: wall time, and lost answers.
//!
//! The server listens on a local HTTP port. It returns the oracle's answer after a delay, and injects faults; results
//! are marked `oracle`.

use genmanip_workspace::worlds;
use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use genmanip_agent::ask::{ChatService, ModelReply, Question, ServiceError, VisionModel};
use genmanip_agent_sim::{AgentChoice, GroundTruth, ModelFile, Oracle, SharedModel};
use genmanip_core::{NotRun, Policy, Seed, TaskKind, World};
use genmanip_llm::fake::{Behaviour, FakeServer, SeenRequest};
use genmanip_llm::{ServerSettings, Structure};
use genmanip_rollout::collect::{PipelineSettings, Resources};
use genmanip_rollout::evaluate::{Case, Outcome, evaluate};
use genmanip_rollout::{Cores, RolloutError, Stage};
use genmanip_workspace::Progress;
use rand::RngExt;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::clock::{cpu_clock, forget_peak_memory, peak_memory_mb, process_clock};
use crate::{LabError, episodes};

/// Timeout of a request to the model, s.
const TIMEOUT_S: f64 = 5.0;

/// Load and faults of the measurement.
#[derive(Clone, Debug)]
pub struct BatchArguments {
    /// Number of tasks; the kinds in turn, without articulated tasks.
    pub count: usize,
    /// Maximum number of concurrent episodes.
    pub at_once: usize,
    /// Number of cores that the episodes share.
    pub workers: usize,
    /// Delay of the server's answer, s.
    pub latency_s: f64,
    /// Share of requests with an injected fault, 0 to 1.
    pub faults: f64,
}

/// Throughput and losses of the batch.
#[derive(Serialize)]
pub struct Measured {
    /// Seed of tasks, layouts, episodes and faults.
    pub seed: u64,
    /// Number of episodes that were run.
    pub episodes: usize,
    /// Success rate, 0 to 1; the answers are the oracle's.
    pub success: f64,
    /// Number of episodes without a result because an answer was lost.
    pub lost: usize,
    /// Wall time from the first to the last episode, s.
    pub wall_s: f64,
    /// CPU time of all threads, those of the server included, s.
    pub cpu_s: f64,
    /// Lower bound of the wall time, s: all CPU time over the cores, or the longest episode alone.
    pub least_s: f64,
    /// Wall time over its lower bound, `wall_s / least_s`.
    pub ratio: f64,
    /// CPU time, s, and number of requests of the episode with the largest lower bound.
    pub longest: (f64, usize),
    /// Number of requests, failed ones included.
    pub requests: usize,
    /// Number of failed requests by kind of fault.
    pub faults: BTreeMap<&'static str, usize>,
    /// Peak resident memory of the process, MiB; `None` if unknown.
    pub memory_mb: Option<f64>,
}

thread_local! {
    /// CPU clock of the episode that runs on this thread.
    static CLOCK: RefCell<Option<Box<dyn FnMut() -> f64>>> = const { RefCell::new(None) };
}

/// CPU time and requests of one episode.
#[derive(Clone, Default)]
struct Taken {
    cpu_s: f64,
    requests: usize,
    /// Number of requests by kind of question.
    of_stages: HashMap<String, u64>,
}

/// State shared by agents and server.
#[derive(Default)]
struct Table {
    /// Open questions with the oracle that answers them, by episode and kind of question: an episode may ask two at the
    /// same time.
    asked: HashMap<(String, String), (Question, Arc<Oracle>)>,
    taken: HashMap<String, Taken>,
    faults: BTreeMap<&'static str, usize>,
}

/// Runs the episodes concurrently.
///
/// # Errors
/// If an episode raises an error; a failed episode is a result.
pub fn measure(
    arguments: &BatchArguments,
    world: &World,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let settings = PipelineSettings::in_world(world.clone());
    let planner = worlds::planner(world, &settings.planner)?;
    let resources = Resources::builtin(&planner);
    let cases = lay_out(arguments.count, resources, &settings, seed, progress)?;
    let table: Arc<Mutex<Table>> = Arc::default();
    let server = {
        let (table, arguments) = (Arc::clone(&table), arguments.clone());
        FakeServer::forgetful(move |request| answer(request, &table, &arguments, seed.fork("faults")))
            .map_err(|error| LabError::broken("the server cannot be started", error))?
    };
    let file = ModelFile {
        server: ServerSettings {
            base_url: server.base_url(),
            total_timeout_s: TIMEOUT_S,
            first_backoff_s: 0.5,
            structure: Structure::JsonSchema,
            ..ServerSettings::default()
        },
        ..ModelFile::default()
    };
    let shared = Arc::new(SharedModel::open(&file)?);
    let choice = AgentChoice::named("oracle", "rgbd", "p2p", "full")?;
    let cores = Arc::new(Cores::new(arguments.workers));
    let make = |stage: &Stage, case: &Case| -> Result<Box<dyn Policy>, RolloutError> {
        let id = case.id.clone();
        CLOCK.set(Some(Box::new(cpu_clock())));
        let broke = |error: LabError| RolloutError::Spec { policy: "agent".into(), source: error.into() };
        let truth = GroundTruth::new(stage);
        let oracle = Arc::new(choice.oracle_of(&truth, &planner, resources.grasps).map_err(broke)?);
        let service = shared.service(Some(&cores));
        let parameters = Map::from_iter([("user".to_owned(), Value::from(id.clone()))]);
        let model = OverHttp { id, oracle, table: Arc::clone(&table), service: ChatService { parameters, ..service } };
        Ok(Box::new(choice.make_asking(Arc::new(model), truth, &planner).map_err(broke)?))
    };
    let finished = |outcome: &Outcome| -> Result<(), RolloutError> {
        let id = match outcome {
            Ok(result) => &result.id,
            Err(NotRun { id, reason, .. }) => {
                progress.note(&format!("{id} was not run: {reason}"));
                id
            }
        };
        let cpu_s = CLOCK.take().map_or(0.0, |mut clock| clock());
        lock(&table).taken.entry(id.clone()).or_default().cpu_s = cpu_s;
        progress.advance();
        Ok(())
    };
    forget_peak_memory();
    let (started, mut cpu) = (Instant::now(), process_clock());
    progress.begin("episodes", cases.len());
    let never = AtomicBool::new(false);
    let crew = (arguments.at_once, &*cores);
    let evaluated = evaluate(&cases, &make, (resources, &settings), None, crew, &never, &finished)
        .map_err(|error| LabError::broken("an episode broke", error))?;
    progress.end();
    let (wall_s, cpu_s) = (started.elapsed().as_secs_f64(), cpu());
    let table = lock(&table);
    let alone = |taken: &Taken| taken.cpu_s + taken.requests as f64 * arguments.latency_s;
    let longest = table.taken.values().max_by(|a, b| alone(a).total_cmp(&alone(b))).cloned().unwrap_or_default();
    let least_s = alone(&longest).max(cpu_s / arguments.workers as f64);
    let successes = evaluated.results.iter().filter(|result| result.success).count();
    Ok(Measured {
        seed: seed.value(),
        episodes: cases.len(),
        success: successes as f64 / cases.len().max(1) as f64,
        lost: evaluated.not_run.len(),
        wall_s,
        cpu_s,
        least_s,
        ratio: wall_s / least_s,
        longest: (longest.cpu_s, longest.requests),
        requests: table.taken.values().map(|taken| taken.requests).sum(),
        faults: table.faults.clone(),
        memory_mb: peak_memory_mb(),
    })
}

/// Designed tasks with layouts.
fn lay_out(
    count: usize,
    resources: Resources,
    settings: &PipelineSettings,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Vec<Case>, LabError> {
    let kinds: Vec<TaskKind> = TaskKind::ALL.into_iter().filter(|kind| *kind != TaskKind::Articulated).collect();
    let tasks = episodes::tasks(&kinds, count, seed)?;
    let mut cases = Vec::new();
    progress.begin("layouts", tasks.len());
    for task in &tasks {
        let stream = seed.fork("batch").fork(&task.id);
        if let Some((attempt, scenario)) = episodes::laid_out(task, resources, settings, stream)? {
            cases.push(Case { id: attempt.id(), scenario: Arc::new(scenario), seed: attempt.seed, horizon_s: None });
        }
        progress.advance();
    }
    progress.end();
    Ok(cases)
}

/// Model client that registers each question and its oracle with the server, and then asks over HTTP.
struct OverHttp {
    id: String,
    oracle: Arc<Oracle>,
    table: Arc<Mutex<Table>>,
    service: ChatService,
}

impl VisionModel for OverHttp {
    fn answer(&self, question: &Question) -> Result<ModelReply, ServiceError> {
        self.answer_each(&[question]).remove(0)
    }

    fn answer_each(&self, questions: &[&Question]) -> Vec<Result<ModelReply, ServiceError>> {
        let key = |question: &&Question| (self.id.clone(), question.stage.name().to_owned());
        for question in questions {
            lock(&self.table).asked.insert(key(question), ((*question).clone(), Arc::clone(&self.oracle)));
        }
        let answered = self.service.answer_each(questions);
        for question in questions {
            lock(&self.table).asked.remove(&key(question));
        }
        answered
    }
}

/// The server's response to a request: usually the oracle's answer after the delay, otherwise a fault.
fn answer(request: &SeenRequest, table: &Mutex<Table>, arguments: &BatchArguments, seed: Seed) -> Behaviour {
    let started = Instant::now();
    let id = request.body.get("user").and_then(Value::as_str).unwrap_or_default().to_owned();
    // The name of the answer's JSON schema identifies the kind of question.
    let stage = request.body.pointer("/response_format/json_schema/name").and_then(Value::as_str).unwrap_or_default();
    let (asked, nth) = {
        let mut table = lock(table);
        let taken = table.taken.entry(id.clone()).or_default();
        taken.requests += 1;
        let nth = taken.of_stages.entry(stage.to_owned()).or_default();
        *nth += 1;
        let nth = *nth;
        (table.asked.get(&(id.clone(), stage.to_owned())).cloned(), nth)
    };
    let Some((question, oracle)) = asked else {
        return Behaviour::Status(400, Vec::new(), "no open question of this episode".into());
    };
    let mut rng = seed.fork(&id).fork(stage).fork_index(nth).rng();
    let fault = (rng.random::<f64>() < arguments.faults).then(|| rng.random_range(0..4));
    let fail = |name: &'static str, behaviour: Behaviour| {
        *lock(table).faults.entry(name).or_default() += 1;
        behaviour
    };
    match fault {
        Some(0) => {
            let headers = vec![("retry-after".to_owned(), "1".to_owned())];
            return fail("too_many_requests", Behaviour::Status(429, headers, "slow down".into()));
        }
        Some(1) => return fail("cut_off", Behaviour::CutOff("{\"id\": ".into())),
        Some(2) => return fail("invalid_json", Behaviour::Answer("The mug, I think.".into())),
        Some(_) => {
            let wait = Duration::from_secs_f64(TIMEOUT_S + 1.0);
            return fail("time_out", Behaviour::Slow(wait, Box::new(Behaviour::HangUp)));
        }
        None => {}
    }
    let text = match oracle.answer(&question) {
        Ok(answered) => answered.text,
        Err(error) => return Behaviour::Status(500, Vec::new(), error.to_string()),
    };
    let left = Duration::from_secs_f64(arguments.latency_s).saturating_sub(started.elapsed());
    Behaviour::Slow(left, Box::new(Behaviour::Answer(text)))
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let Measured { episodes, success, lost, wall_s, cpu_s, least_s, ratio, requests, .. } = measured;
    let faults: usize = measured.faults.values().sum();
    let memory = measured.memory_mb.map_or_else(String::new, |mb| format!(", {mb:.0} MiB"));
    format!(
        "{episodes} episodes (oracle), {:.1} % succeeded, {lost} lost\n{requests} requests, {faults} went wrong\n\
         {wall_s:.1} s wall time, {cpu_s:.1} s of CPU time, lower bound {least_s:.1} s, ratio {ratio:.2}{memory}",
        100.0 * success
    )
}
