//! Many agents at once against one model server that is slow and not always well: what that takes, and whether an
//! answer is lost.
//!
//! The server is real HTTP on this machine. It answers with what the oracle says to the question, after a while, and now
//! and then misbehaves: results say oracle.

use genmanip_workspace::worlds;
use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use genmanip_agent::ask::{Answered, ChatService, Question, ServiceError, VisionModel};
use genmanip_agent_sim::{AgentChoice, ModelFile, Oracle, SharedModel, Truth};
use genmanip_core::{NotRun, Seed, TaskKind, World};
use genmanip_llm::fake::{Behaviour, FakeServer, SeenRequest};
use genmanip_llm::{ServerSettings, Structure};
use genmanip_rollout::collect::{CollectSettings, Resources};
use genmanip_rollout::evaluate::{Case, Outcome, evaluate};
use genmanip_rollout::{Cores, RolloutError, Stage as Scene};
use genmanip_workspace::Progress;
use rand::RngExt;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::clock::{cpu_clock, forget_peak_memory, peak_memory_mb, process_clock};
use crate::{LabError, episodes};

/// A request without an answer is given up after this time, s.
const TIMEOUT_S: f64 = 5.0;

/// What is to be measured.
#[derive(Clone, Debug)]
pub struct BatchArguments {
    /// Tasks, the kinds that can be picked and placed in turn.
    pub count: usize,
    /// Episodes under way at once.
    pub at_once: usize,
    /// Cores that they share.
    pub workers: usize,
    /// How long the server takes to answer, s.
    pub latency_s: f64,
    /// Share of the requests with which something goes wrong.
    pub faults: f64,
}

/// What came of it.
#[derive(Serialize)]
pub struct Measured {
    /// Seed of tasks, layouts, episodes and faults.
    pub seed: u64,
    /// Episodes.
    pub episodes: usize,
    /// Share of them that succeeded; the model is the oracle.
    pub success: f64,
    /// Episodes without a result, since an answer did not come.
    pub lost: usize,
    /// From the first to the last, s.
    pub wall_s: f64,
    /// Processor time of everything, the server included, s.
    pub cpu_s: f64,
    /// What it must take at least, s: all computing on the cores, or the longest episode alone.
    pub least_s: f64,
    /// `wall_s / least_s`.
    pub ratio: f64,
    /// Of the episode that must take longest: its processor time, s, and its requests.
    pub longest: (f64, usize),
    /// Requests, those that went wrong included.
    pub requests: usize,
    /// Requests that went wrong, by how.
    pub faults: BTreeMap<&'static str, usize>,
    /// Most memory held, MiB.
    pub memory_mb: Option<f64>,
}

thread_local! {
    /// Processor time of the episode that this thread is at.
    static CLOCK: RefCell<Option<Box<dyn FnMut() -> f64>>> = const { RefCell::new(None) };
}

/// What one episode took.
#[derive(Clone, Default)]
struct Taken {
    cpu_s: f64,
    requests: usize,
    /// Requests of each stage.
    of_stages: HashMap<String, u64>,
}

/// What agents and server know of each other, by the id of the episode.
#[derive(Default)]
struct Table {
    /// Who answers what is being asked, by the stage too: an episode may ask two stages at once.
    asked: HashMap<(String, String), (Question, Arc<Oracle>)>,
    taken: HashMap<String, Taken>,
    faults: BTreeMap<&'static str, usize>,
}

/// Runs the episodes.
///
/// # Errors
/// When an episode broke; one that fails is a result.
pub fn measure(
    arguments: &BatchArguments,
    world: &World,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let settings = CollectSettings::in_world(world.clone());
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
    let make = |stage: &Scene, case: &Case| {
        let id = case.id.clone();
        CLOCK.set(Some(Box::new(cpu_clock())));
        let broke = |error: LabError| RolloutError::Spec { policy: "agent".into(), reason: error.to_string() };
        let truth = Truth::new(stage);
        let oracle = Arc::new(choice.oracle_of(&truth, &planner, resources.grasps).map_err(broke)?);
        let service = shared.service(Some(&cores));
        let parameters = Map::from_iter([("user".to_owned(), Value::from(id.clone()))]);
        let model = OverHttp { id, oracle, table: Arc::clone(&table), service: ChatService { parameters, ..service } };
        Ok(choice.make_asking(Arc::new(model), truth, &planner).map_err(broke)?.policy)
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

/// Fresh tasks, laid out.
fn lay_out(
    count: usize,
    resources: Resources,
    settings: &CollectSettings,
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

/// Asks over HTTP, and lets the server know who can answer.
struct OverHttp {
    id: String,
    oracle: Arc<Oracle>,
    table: Arc<Mutex<Table>>,
    service: ChatService,
}

impl VisionModel for OverHttp {
    fn answer(&self, question: &Question) -> Result<Answered, ServiceError> {
        self.answer_each(&[question]).remove(0)
    }

    fn answer_each(&self, questions: &[&Question]) -> Vec<Result<Answered, ServiceError>> {
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

/// What the server does with a request: mostly, what the oracle says, after a while.
fn answer(request: &SeenRequest, table: &Mutex<Table>, arguments: &BatchArguments, seed: Seed) -> Behaviour {
    let started = Instant::now();
    let id = request.body.get("user").and_then(Value::as_str).unwrap_or_default().to_owned();
    // The schema of the answer is named after the stage.
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
        return Behaviour::Status(400, Vec::new(), "nobody asks under this name".into());
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

/// The same in words.
pub fn in_words(measured: &Measured) -> String {
    let Measured { episodes, success, lost, wall_s, cpu_s, least_s, ratio, requests, .. } = measured;
    let faults: usize = measured.faults.values().sum();
    let memory = measured.memory_mb.map_or_else(String::new, |mb| format!(", {mb:.0} MiB"));
    format!(
        "{episodes} episodes (oracle), {:.1} % succeeded, {lost} lost\n{requests} requests, {faults} went wrong\n\
         {wall_s:.1} s by the clock, {cpu_s:.1} s of processor time, {least_s:.1} s at least: {ratio:.2} times{memory}",
        100.0 * success
    )
}
