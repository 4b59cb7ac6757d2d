//! Evaluation of a policy on scenarios, with the same episode loop and judge as collection.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_core::{EpisodeResult, NotRun, Policy, Scenario, Seed};
use genmanip_data::EpisodeStore;

use crate::cloud_verdict::cloud_verdict;
use crate::collect::{PipelineSettings, Resources, in_parallel};
use crate::{Cores, RolloutError, Stage, run_episode};

/// One episode of an evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Id of the episode, unique among the cases.
    pub id: String,
    /// Initial scenario of the episode.
    pub scenario: Arc<Scenario>,
    /// Random stream of the episode.
    pub seed: Seed,
    /// Time limit, s; `None` for that of the settings.
    pub horizon_s: Option<f64>,
}

/// Creates the policy for one case and its stage.
///
/// [`RolloutError::NotRun`] means that the policy is unreachable or made a mistake.
pub type MakePolicy<'a> = dyn Fn(&Stage, &Case) -> Result<Box<dyn Policy>, RolloutError> + Sync + 'a;

/// Results of an evaluation, by case.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluated {
    /// Results of the judged episodes, in the order of the cases.
    pub results: Vec<EpisodeResult>,
    /// Episodes whose policy was unreachable or made a mistake, in the order of the cases.
    pub not_run: Vec<NotRun>,
}

/// Outcome of a case: its result, or the reason why it was not run.
pub type Outcome = Result<EpisodeResult, NotRun>;

/// Runs a policy on every case; stores the episodes if a store is given.
///
/// `at_once` episodes run in parallel; each holds one of the `cores` except while its policy lends it. The results
/// depend on neither. `finished` is called for each case as it ends, in the thread that ran it.
///
/// # Errors
/// The first internal error of any episode, and errors of `finished`.
pub fn evaluate<E: From<RolloutError> + Send>(
    cases: &[Case],
    make_policy: &MakePolicy,
    (resources, settings): (Resources, &PipelineSettings),
    keep: Option<&EpisodeStore>,
    (at_once, cores): (usize, &Cores),
    stop: &AtomicBool,
    finished: &(dyn Fn(&Outcome) -> Result<(), E> + Sync),
) -> Result<Evaluated, E> {
    let outcomes = in_parallel(cases, at_once, stop, &|case| {
        let _core = cores.hold(steps(&case.scenario));
        // Stopped while waiting for a core.
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let outcome = run(case, make_policy, resources, settings, keep)
            .map_err(|source| RolloutError::Episode { id: case.id.clone(), source: Box::new(source) })?;
        finished(&outcome)?;
        Ok::<_, E>(Some(outcome))
    })?;
    let mut evaluated = Evaluated::default();
    for outcome in outcomes.into_iter().flatten() {
        match outcome {
            Ok(result) => evaluated.results.push(result),
            Err(not_run) => evaluated.not_run.push(not_run),
        }
    }
    Ok(evaluated)
}

/// Number of conditions of the shortest alternative: a proxy for the number of picks, hence of policy queries.
fn steps(scenario: &Scenario) -> usize {
    scenario.task.goal.alternatives.iter().map(Vec::len).min().unwrap_or(0)
}

fn run(
    case: &Case,
    make_policy: &MakePolicy,
    resources: Resources,
    settings: &PipelineSettings,
    keep: Option<&EpisodeStore>,
) -> Result<Result<EpisodeResult, NotRun>, RolloutError> {
    // A run that was interrupted had stored this episode before reporting it.
    if let Some(store) = keep.filter(|store| store.contains(&case.id)) {
        return Ok(Ok(store.read_result(&case.id)?));
    }
    let robot = resources.planner.robot();
    let stage = Stage::open(Arc::clone(&case.scenario), resources.catalogue, robot)?;
    let mut rollout = settings.rollout.clone();
    rollout.horizon_s = case.horizon_s.unwrap_or(rollout.horizon_s);
    let episode = make_policy(&stage, case)
        .and_then(|mut policy| run_episode(&stage, policy.as_mut(), &case.id, case.seed, &rollout));
    match episode {
        Ok(mut episode) => {
            episode.result.cloud = cloud_verdict(&stage, &episode)?;
            if let Some(store) = keep {
                store.write(&episode, &[])?;
            }
            Ok(Ok(episode.result))
        }
        Err(RolloutError::NotRun { reason, mistake, .. }) => {
            Ok(Err(NotRun { id: case.id.clone(), scenario_id: case.scenario.id.clone(), reason, mistake }))
        }
        Err(error) => Err(error),
    }
}
