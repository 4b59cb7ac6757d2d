//! Asynchronous jobs that clients start, poll, and whose results they fetch.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use schemars::JsonSchema;
use serde::Serialize;
use tokio::sync::watch;

use genmanip_agent::Acted;

/// Maximum number of waiting and running jobs; further ones are rejected.
pub(crate) const MAX_OPEN: usize = 64;
/// Maximum number of finished jobs kept with their images; the oldest are dropped.
pub(crate) const MAX_ENDED: usize = 32;
/// Maximum time that one poll waits for the end of a job, s.
pub(crate) const MAX_WAIT_S: f64 = 60.0;

/// State of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum State {
    /// Waiting until other jobs have ended.
    Waiting,
    /// Planning.
    Running,
    /// Ended with a result, which may be a planning failure.
    Done,
    /// Ended without a result: a service did not answer, or the request cannot be processed.
    Failed,
}

/// Response to a poll.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct JobView {
    /// Job id.
    pub job: String,
    /// State of the job.
    pub state: State,
    /// Planned motions, or the planning failure; absent before the end and for a failed job.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acted: Option<Acted>,
    /// Transcript of all questions and answers, a document `genmanip.agent_transcript`; absent before the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transcript: Option<serde_json::Value>,
    /// Names of the images shown to the model; each is served at `…/pictures/NAME` of the job.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pictures: Vec<String>,
    /// Error message; absent unless the job failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// Result of a finished job.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ended {
    /// Planned motions, or the planning failure; `None` for a failed job.
    pub acted: Option<Acted>,
    /// Error message; `None` unless the job failed.
    pub error: Option<String>,
    /// Transcript of all questions and answers, a document `genmanip.agent_transcript`.
    pub transcript: serde_json::Value,
    /// PNG images by name.
    pub pictures: Vec<(String, Arc<Vec<u8>>)>,
}

/// All jobs of a server.
#[derive(Debug, Default)]
pub(crate) struct Jobs(Mutex<JobTable>);

#[derive(Debug, Default)]
struct JobTable {
    started: u64,
    jobs: BTreeMap<u64, Job>,
}

#[derive(Debug)]
struct Job {
    state: watch::Sender<State>,
    ended: Option<Arc<Ended>>,
}

impl Jobs {
    /// Creates a job and returns its number; `None` if [`MAX_OPEN`] jobs are open.
    pub(crate) fn begin(&self) -> Option<u64> {
        let mut table = self.lock();
        if table.jobs.values().filter(|job| job.ended.is_none()).count() >= MAX_OPEN {
            return None;
        }
        table.started += 1;
        let number = table.started;
        table.jobs.insert(number, Job { state: watch::Sender::new(State::Waiting), ended: None });
        Some(number)
    }

    pub(crate) fn running(&self, number: u64) {
        if let Some(job) = self.lock().jobs.get(&number) {
            job.state.send_replace(State::Running);
        }
    }

    pub(crate) fn end(&self, number: u64, ended: Ended) {
        let mut table = self.lock();
        let Some(job) = table.jobs.get_mut(&number) else { return };
        let state = if ended.error.is_some() { State::Failed } else { State::Done };
        job.ended = Some(Arc::new(ended));
        job.state.send_replace(state);
        let ended: Vec<u64> = table.jobs.iter().filter(|(_, job)| job.ended.is_some()).map(|(it, _)| *it).collect();
        for oldest in ended.iter().rev().skip(MAX_ENDED) {
            table.jobs.remove(oldest);
        }
    }

    /// State of a job, as soon as it has ended or `wait` is over; `None` for an unknown job.
    pub(crate) async fn view(&self, number: u64, wait: Duration) -> Option<JobView> {
        let mut state = self.lock().jobs.get(&number)?.state.subscribe();
        let ended = |state: &State| matches!(state, State::Done | State::Failed);
        // After a timeout, or if the job was dropped meanwhile, the code below decides the answer.
        let _ = tokio::time::timeout(wait, state.wait_for(ended)).await;
        let table = self.lock();
        let job = table.jobs.get(&number)?;
        let ended = job.ended.as_deref();
        Some(JobView {
            job: number.to_string(),
            state: *job.state.borrow(),
            acted: ended.and_then(|ended| ended.acted.clone()),
            transcript: ended.map(|ended| ended.transcript.clone()),
            pictures: ended.map_or_else(Vec::new, |it| it.pictures.iter().map(|(name, _)| name.clone()).collect()),
            error: ended.and_then(|ended| ended.error.clone()),
        })
    }

    /// An image of an ended job, PNG; `None` if there is no such job or image.
    pub(crate) fn picture(&self, number: u64, name: &str) -> Option<Arc<Vec<u8>>> {
        let table = self.lock();
        let ended = table.jobs.get(&number)?.ended.as_ref()?;
        ended.pictures.iter().find(|(known, _)| known == name).map(|(_, png)| Arc::clone(png))
    }

    fn lock(&self) -> MutexGuard<'_, JobTable> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_jobs_and_kept_ones_are_bounded() {
        let jobs = Jobs::default();
        let started: Vec<u64> = (0..MAX_OPEN).map_while(|_| jobs.begin()).collect();
        assert_eq!((started.len(), jobs.begin()), (MAX_OPEN, None), "no further job while so many are open");
        for &number in &started {
            jobs.end(number, Ended { pictures: vec![("a.png".into(), Arc::default())], ..Ended::default() });
        }
        let table: Vec<u64> = started.iter().copied().filter(|it| jobs.picture(*it, "a.png").is_some()).collect();
        assert_eq!(table, started[MAX_OPEN - MAX_ENDED..], "the latest are kept");
        assert_eq!(jobs.begin(), Some(MAX_OPEN as u64 + 1));
    }

    #[test]
    fn a_question_waits_for_the_end_of_a_job() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(async {
            let jobs = Arc::new(Jobs::default());
            let number = jobs.begin().unwrap();
            let state = |view: Option<JobView>| view.unwrap().state;
            assert_eq!(state(jobs.view(number, Duration::ZERO).await), State::Waiting);
            jobs.running(number);
            assert_eq!(state(jobs.view(number, Duration::from_millis(1)).await), State::Running);
            let ending = Arc::clone(&jobs);
            tokio::spawn(async move { ending.end(number, Ended { error: Some("no".into()), ..Ended::default() }) });
            assert_eq!(state(jobs.view(number, Duration::from_secs(60)).await), State::Failed);
            assert!(jobs.view(number + 1, Duration::ZERO).await.is_none());
        });
    }
}
