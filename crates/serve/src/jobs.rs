//! Work that takes longer than a connection should stay open: it is begun, asked about, and fetched.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use schemars::JsonSchema;
use serde::Serialize;
use tokio::sync::watch;

use genmanip_agent::Acted;

/// Most jobs that wait or run; further ones are turned away.
pub(crate) const MAX_OPEN: usize = 64;
/// Most ended jobs that are kept, with their pictures; the oldest go first.
pub(crate) const MAX_ENDED: usize = 32;
/// Longest that a question about a job waits for its end, s.
pub(crate) const MAX_WAIT_S: f64 = 60.0;

/// How far a job is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum State {
    /// Others are before it.
    Waiting,
    /// It is being computed.
    Running,
    /// It has a result; that the agent found no way is one.
    Done,
    /// It has none: a service did not answer, or the question cannot be worked with.
    Failed,
}

/// What is said of a job.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct JobView {
    /// Its name.
    pub job: String,
    /// How far it is.
    pub state: State,
    /// The motions, or why there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acted: Option<Acted>,
    /// Every question and answer: a document `genmanip.agent_transcript`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transcript: Option<serde_json::Value>,
    /// Pictures that were shown to the model, at `…/pictures/NAME` of the job.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pictures: Vec<String>,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// What a job leaves.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ended {
    /// The motions, or why there are none.
    pub acted: Option<Acted>,
    /// Why it failed, if it did.
    pub error: Option<String>,
    /// The transcript as a document.
    pub transcript: serde_json::Value,
    /// PNGs by name.
    pub pictures: Vec<(String, Arc<Vec<u8>>)>,
}

/// All jobs of a server.
#[derive(Debug, Default)]
pub(crate) struct Jobs(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    begun: u64,
    jobs: BTreeMap<u64, Job>,
}

#[derive(Debug)]
struct Job {
    state: watch::Sender<State>,
    ended: Option<Arc<Ended>>,
}

impl Jobs {
    /// A new job, unless too many are open.
    pub(crate) fn begin(&self) -> Option<u64> {
        let mut kept = self.lock();
        if kept.jobs.values().filter(|job| job.ended.is_none()).count() >= MAX_OPEN {
            return None;
        }
        kept.begun += 1;
        let number = kept.begun;
        kept.jobs.insert(number, Job { state: watch::Sender::new(State::Waiting), ended: None });
        Some(number)
    }

    pub(crate) fn running(&self, number: u64) {
        if let Some(job) = self.lock().jobs.get(&number) {
            job.state.send_replace(State::Running);
        }
    }

    pub(crate) fn end(&self, number: u64, ended: Ended) {
        let mut kept = self.lock();
        let Some(job) = kept.jobs.get_mut(&number) else { return };
        let state = if ended.error.is_some() { State::Failed } else { State::Done };
        job.ended = Some(Arc::new(ended));
        job.state.send_replace(state);
        let ended: Vec<u64> = kept.jobs.iter().filter(|(_, job)| job.ended.is_some()).map(|(it, _)| *it).collect();
        for oldest in ended.iter().rev().skip(MAX_ENDED) {
            kept.jobs.remove(oldest);
        }
    }

    /// What is known of a job once it has ended or so long has passed; `None` of an unknown one.
    pub(crate) async fn view(&self, number: u64, wait: Duration) -> Option<JobView> {
        let mut state = self.lock().jobs.get(&number)?.state.subscribe();
        let ended = |state: &State| matches!(state, State::Done | State::Failed);
        // Time is up, or the job was forgotten meanwhile: either way, what is known is said below.
        let _ = tokio::time::timeout(wait, state.wait_for(ended)).await;
        let kept = self.lock();
        let job = kept.jobs.get(&number)?;
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

    /// A picture of an ended job.
    pub(crate) fn picture(&self, number: u64, name: &str) -> Option<Arc<Vec<u8>>> {
        let kept = self.lock();
        let ended = kept.jobs.get(&number)?.ended.as_ref()?;
        ended.pictures.iter().find(|(known, _)| known == name).map(|(_, png)| Arc::clone(png))
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_jobs_and_kept_ones_are_bounded() {
        let jobs = Jobs::default();
        let begun: Vec<u64> = (0..MAX_OPEN).map_while(|_| jobs.begin()).collect();
        assert_eq!((begun.len(), jobs.begin()), (MAX_OPEN, None), "no further job while so many are open");
        for &number in &begun {
            jobs.end(number, Ended { pictures: vec![("a.png".into(), Arc::default())], ..Ended::default() });
        }
        let kept: Vec<u64> = begun.iter().copied().filter(|it| jobs.picture(*it, "a.png").is_some()).collect();
        assert_eq!(kept, begun[MAX_OPEN - MAX_ENDED..], "the latest are kept");
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
