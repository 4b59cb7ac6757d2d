//! Evaluating policies on the scenarios of a run: the same loop, the same judge.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_core::{Episode, EpisodeResult, NotRun, Policy};
use genmanip_data::EpisodeStore;

use crate::collect::{CollectSettings, Resources, in_parallel};
use crate::{RolloutError, Stage, run_episode};

/// Makes the policy for one episode, from the scenario made ready and from what was recorded on it.
pub type MakePolicy<'a> = dyn Fn(&Stage, &Episode) -> Result<Box<dyn Policy>, RolloutError> + Sync + 'a;

/// What an evaluation came to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluated {
    /// Judged episodes, in the order of their ids.
    pub results: Vec<EpisodeResult>,
    /// Episodes whose policy could not be reached, in the order of their ids.
    pub not_run: Vec<NotRun>,
}

/// Runs a policy on every scenario of a store, recorded success or not.
///
/// Attempts without a scenario (their layout failed) cannot be evaluated and are left out.
///
/// # Errors
/// The first defect of any episode.
pub fn evaluate(
    store: &EpisodeStore,
    make_policy: &MakePolicy,
    resources: Resources,
    settings: &CollectSettings,
    workers: usize,
    stop: &AtomicBool,
    finished: &(dyn Fn(&EpisodeResult) + Sync),
) -> Result<Evaluated, RolloutError> {
    let ids: Vec<String> = store
        .ids()?
        .into_iter()
        .filter_map(|id| match store.is_recorded(&id) {
            Ok(true) => Some(Ok(id)),
            Ok(false) => None,
            Err(error) => Some(Err(error)),
        })
        .collect::<Result<_, _>>()?;
    let outcomes = in_parallel(&ids, workers, stop, &|id| {
        let recorded = store.read(id)?;
        let stage = Stage::open(Arc::new(recorded.scenario.clone()), resources.catalogue, resources.planner.robot())?;
        let mut policy = make_policy(&stage, &recorded)?;
        match run_episode(&stage, policy.as_mut(), id, recorded.result.seed, &settings.rollout) {
            Ok(episode) => {
                finished(&episode.result);
                Ok(Ok(episode.result))
            }
            Err(RolloutError::NotRun { reason, .. }) => {
                Ok(Err(NotRun { id: id.clone(), scenario_id: recorded.scenario.id, reason }))
            }
            Err(error) => Err(error),
        }
    })?;
    let mut evaluated = Evaluated::default();
    for outcome in outcomes {
        match outcome {
            Ok(result) => evaluated.results.push(result),
            Err(not_run) => evaluated.not_run.push(not_run),
        }
    }
    Ok(evaluated)
}
