//! Jobs that run policies, at most one at a time per scenario; the scenario's tabs are informed of the progress.

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

/// Maximum number of waiting and running jobs.
const MAX_JOBS: usize = 64;
/// Minimum interval between two progress messages of a job.
const REPORT: Duration = Duration::from_millis(100);

/// Jobs of all scenarios, and their limits.
pub struct Runs {
    /// Folder that the run folders are created in.
    pub folder: PathBuf,
    /// Policies that may be run.
    pub offered: OfferedPolicies,
    /// Limits the number of episodes that are simulated at the same time.
    pub turns: Semaphore,
    /// Episode that was played back last.
    pub played: Mutex<Option<Played>>,
    /// Newest job of each scenario, by key.
    jobs: Mutex<BTreeMap<String, Arc<Job>>>,
}

/// An episode that is played back.
pub struct Played {
    /// Key of its scenario.
    pub scenario: String,
    /// Key of the episode.
    pub name: String,
    /// The episode.
    pub episode: Arc<Episode>,
}

/// Job that runs one episode on a scenario.
pub struct Job {
    /// True once the job is to be cancelled.
    pub stop: Arc<AtomicBool>,
    run: Mutex<Run>,
    told: Mutex<Option<Instant>>,
}

/// State of a job, as the page sees it.
#[derive(Clone, Debug, Serialize)]
pub struct Run {
    /// Number of the job, unique while the studio runs.
    pub number: u64,
    /// Name of the policy, with its arguments.
    pub policy: String,
    /// Revision of the scenario that is run.
    pub revision: u64,
    /// Stage of the job.
    pub state: Stage,
    /// Simulated time of the episode so far, s.
    pub time_s: f64,
    /// Error as `{"message", "hint"}`; `None` unless the job failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<Value>,
    /// Row of the new episode; `None` until it is stored.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub episode: Option<EpisodeRow>,
}

/// Stage of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Waiting for episodes of other jobs.
    Waiting,
    /// The episode is being simulated.
    Running,
    /// The episode was stored.
    Done,
    /// The job was cancelled; nothing was stored.
    Cancelled,
    /// The episode could not be run.
    Failed,
}

impl Runs {
    /// No jobs yet; run folders are created in `folder`.
    pub fn new(folder: PathBuf, offered: OfferedPolicies) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self { folder, offered, turns: Semaphore::new(cores), played: Mutex::default(), jobs: Mutex::default() }
    }

    /// Message about the newest job of a scenario; `None` without one.
    pub fn message(&self, key: &str) -> Option<Value> {
        let job = self.newest(key)?;
        Some(json!({ "type": "run", "run": job.now() }))
    }

    /// Newest job of a scenario; `None` without one.
    pub fn newest(&self, key: &str) -> Option<Arc<Job>> {
        self.lock().get(key).cloned()
    }

    /// Adds a job, unless the scenario has one that has not ended.
    ///
    /// # Errors
    /// [`Refusal::Unsuited`] if the scenario has such a job, or too many jobs wait or run.
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

    // A panic of another thread leaves the values consistent, so a poisoned lock is used.
    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Job>>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Job {
    /// Present state of the job.
    pub fn now(&self) -> Run {
        self.run.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// True if the job neither waits nor runs.
    pub fn is_over(&self) -> bool {
        !matches!(self.now().state, Stage::Waiting | Stage::Running)
    }

    /// Changes the state of the job, and sends it to the scenario's tabs.
    pub fn change(&self, room: &Room, change: impl FnOnce(&mut Run)) {
        let mut run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut run);
        let _ = room.events.send(Event::Run(Arc::new(json!({ "type": "run", "run": &*run }))));
    }

    /// Sends the simulated time of the episode to the tabs, at most every 100 ms.
    pub fn advance(&self, room: &Room, time_s: f64) {
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        if told.is_some_and(|before| before.elapsed() < REPORT) {
            return;
        }
        *told = Some(Instant::now());
        self.change(room, |run| run.time_s = time_s);
    }
}
