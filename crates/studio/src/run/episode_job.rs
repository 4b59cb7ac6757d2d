//! Job that runs one episode of a policy on a scenario like `genmanip evaluate`, in a run folder of its own.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_core::{EpisodeResult, Scenario};
use genmanip_data::EpisodeStore;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::{EvaluateOptions, Suite, evaluate};
use genmanip_workspace::{NoProgress, WorkspaceError};

use super::kept_episodes::{Place, run_folder_name};

/// Policy and scenario of an episode to run.
#[derive(Clone, Debug)]
pub struct EpisodeJob {
    /// Scenario of the episode.
    pub scenario: Arc<Scenario>,
    /// Name of the policy, with its arguments.
    pub policy: String,
    /// Time limit of the scenario's frozen suite, simulated s; `None` for the default one.
    pub horizon_s: Option<f64>,
    /// Folder that the run folders are created in.
    pub runs: PathBuf,
}

/// An episode that was run and stored.
#[derive(Clone, Debug)]
pub struct NewEpisode {
    /// Store and id of the episode.
    pub place: Place,
    /// Result of the episode.
    pub result: EpisodeResult,
}

impl EpisodeJob {
    /// Runs the episode. The first episode of a policy on a scenario has the random stream that `evaluate` uses; each
    /// further one has its own.
    ///
    /// `turn` is called with the simulated time of the episode, s, before each decision of the policy. Returns `None`,
    /// and
    /// stores nothing, if `stop` became true.
    ///
    /// # Errors
    /// When the policy does not exist, cannot be reached or does not fit the scenario, or a file cannot be written.
    pub fn run(
        &self,
        stop: &Arc<AtomicBool>,
        turn: impl Fn(f64) + Send + Sync + 'static,
    ) -> Result<Option<NewEpisode>, WorkspaceError> {
        let folder = self.runs.join(run_folder_name(&self.scenario));
        let label = PolicyFactory::resolve(&self.policy)?.label().to_owned();
        let store = folder.join("evaluation").join(&label).join("episodes");
        let before = EpisodeStore::open(&store).and_then(|store| store.ids()).map_or(0, |ids| ids.len());
        let mut policy = self.policy.clone();
        let transcripts = folder.join("transcripts").join(&label).join(before.to_string());
        let is_agent = policy == "agent" || policy.starts_with("agent:");
        if is_agent && !policy.contains("transcripts=") && !transcripts.to_string_lossy().contains(',') {
            let joint = if policy.contains(':') { ',' } else { ':' };
            policy = format!("{policy}{joint}transcripts={}", transcripts.display());
        }
        let stopped = Arc::clone(stop);
        let policy = PolicyFactory::resolve(&policy)?.watched(move |time_s| {
            turn(time_s);
            !stopped.load(Ordering::Relaxed)
        });
        let mut suite = Suite::of_loaded(self.scenario.id.clone(), vec![Arc::clone(&self.scenario)])?;
        suite.cases.iter_mut().for_each(|case| case.horizon_s = self.horizon_s);
        let suite = suite.with_episodes(before + 1);
        let options = EvaluateOptions {
            out: Some(folder.clone()),
            keep_episodes: true,
            workers: 1,
            ..EvaluateOptions::default()
        };
        let reports = evaluate(&suite, &[policy], &options, &NoProgress, stop)?;
        let Some(report) = reports.into_iter().next() else { return Ok(None) };
        let wanted = suite.cases.last().map(|case| case.id.clone()).unwrap_or_default();
        let missing = || WorkspaceError::input(format!("the episode {wanted} was not kept"));
        let result = report.results.into_iter().find(|result| result.id == wanted).ok_or_else(missing)?;
        Ok(Some(NewEpisode { place: Place { store, id: wanted }, result }))
    }
}
