//! Jobs that run policies: one at a time for each scenario, its tabs told how far it is.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use genmanip_core::Episode;
use serde::Serialize;
use serde_json::{Value, json};
use tokio::sync::Semaphore;

use super::answer::Refusal;
use super::room::{Event, Room};
use crate::run::{EpisodeRow, OfferedPolicies};

/// Most jobs that wait or run at once.
const MAX_JOBS: usize = 64;
/// Shortest time between two reports of a job.
const REPORT: Duration = Duration::from_millis(100);

/// Jobs of all scenarios.
pub struct Runs {
    /// Folder of the run folders.
    pub folder: PathBuf,
    /// Policies that may be run.
    pub offered: OfferedPolicies,
    /// Episodes that are simulated at once.
    pub turns: Semaphore,
    /// Episode that was played back last, by the key of its scenario and its own.
    pub played: Mutex<Option<((String, String), Arc<Episode>)>>,
    /// Newest job by the key of its scenario.
    jobs: Mutex<BTreeMap<String, Arc<Job>>>,
}

/// A job of a scenario.
pub struct Job {
    /// True once it is to end.
    pub stop: Arc<AtomicBool>,
    run: Mutex<Run>,
    told: Mutex<Option<Instant>>,
}

/// State of a job, as the page sees it.
#[derive(Clone, Debug, Serialize)]
pub struct Run {
    /// Number, unique while the studio runs.
    pub number: u64,
    /// Name of the policy, with arguments.
    pub policy: String,
    /// Revision that is run.
    pub revision: u64,
    /// Stage of the job.
    pub state: Stage,
    /// Time of the episode so far, s.
    pub time_s: f64,
    /// Reason why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<Value>,
    /// Row of the new episode.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub episode: Option<EpisodeRow>,
}

/// Stage of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Other episodes run.
    Waiting,
    /// Its episode is simulated.
    Running,
    /// Its episode was kept.
    Done,
    /// It was ended; nothing was kept.
    Cancelled,
    /// It could not be run.
    Failed,
}

impl Runs {
    /// No job yet; episodes go to `folder`.
    pub fn new(folder: PathBuf, offered: OfferedPolicies) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self { folder, offered, turns: Semaphore::new(cores), played: Mutex::default(), jobs: Mutex::default() }
    }

    /// Message about the newest job of a scenario, if there is one.
    pub fn message(&self, key: &str) -> Option<Value> {
        let job = self.newest(key)?;
        Some(json!({ "type": "run", "run": job.now() }))
    }

    /// Newest job of a scenario.
    pub fn newest(&self, key: &str) -> Option<Arc<Job>> {
        self.lock().get(key).cloned()
    }

    /// Adds a job, unless the scenario has one that is not over.
    ///
    /// # Errors
    /// [`Refusal::Unsuited`].
    pub fn add(&self, key: &str, policy: &str, revision: u64) -> Result<Arc<Job>, Refusal> {
        static NUMBER: AtomicU64 = AtomicU64::new(0);
        let mut jobs = self.lock();
        if jobs.get(key).is_some_and(|job| !job.is_over()) {
            return Err(Refusal::unsuited(
                "an episode of this scenario is under way",
                "wait for its end, or cancel it",
            ));
        }
        if jobs.values().filter(|job| !job.is_over()).count() >= MAX_JOBS {
            return Err(Refusal::unsuited(format!("{MAX_JOBS} episodes wait or run already"), "wait for some of them"));
        }
        let number = NUMBER.fetch_add(1, Ordering::Relaxed) + 1;
        let (policy, state) = (policy.to_owned(), Stage::Waiting);
        let run = Run { number, policy, revision, state, time_s: 0.0, error: None, episode: None };
        let job = Arc::new(Job { stop: Arc::default(), run: Mutex::new(run), told: Mutex::default() });
        jobs.insert(key.to_owned(), Arc::clone(&job));
        Ok(job)
    }

    // Poisoned locks still guard whole values.
    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Job>>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Job {
    /// Its state.
    pub fn now(&self) -> Run {
        self.run.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// True if it neither waits nor runs.
    pub fn is_over(&self) -> bool {
        !matches!(self.now().state, Stage::Waiting | Stage::Running)
    }

    /// Changes the state of the job and tells the tabs of its scenario.
    pub fn change(&self, room: &Room, change: impl FnOnce(&mut Run)) {
        let mut run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut run);
        let _ = room.events.send(Event::Run(Arc::new(json!({ "type": "run", "run": &*run }))));
    }

    /// Tells the time of the episode, but not too often.
    pub fn advance(&self, room: &Room, time_s: f64) {
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        if told.is_some_and(|before| before.elapsed() < REPORT) {
            return;
        }
        *told = Some(Instant::now());
        self.change(room, |run| run.time_s = time_s);
    }
}
