//! Evaluating policies on the scenarios of a run: the same loop, the same judge.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_core::{EpisodeResult, Policy};
use genmanip_data::EpisodeStore;

use crate::collect::{CollectSettings, Resources, in_parallel};
use crate::expert::Expert;
use crate::policies::{DoNothing, OpenLoopReplay};
use crate::{RolloutError, Stage, run_episode};

/// The policies that come with the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BuiltinPolicy {
    /// Reads simulator truth; its results say `oracle`.
    Expert,
    /// Applies the recorded commands without looking.
    Replay,
    /// Stands still: the control.
    DoNothing,
}

impl BuiltinPolicy {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Expert, Self::Replay, Self::DoNothing];

    /// The name on the command line and in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Expert => "expert",
            Self::Replay => "replay",
            Self::DoNothing => "do_nothing",
        }
    }
}

/// Runs a policy on every scenario of a store, recorded success or not; results in the order of the ids.
///
/// Attempts without a scenario (their layout failed) cannot be evaluated and are left out.
///
/// # Errors
/// The first defect of any episode.
pub fn evaluate(
    store: &EpisodeStore,
    policy: BuiltinPolicy,
    resources: Resources,
    settings: &CollectSettings,
    workers: usize,
    stop: &AtomicBool,
    finished: &(dyn Fn(&EpisodeResult) + Sync),
) -> Result<Vec<EpisodeResult>, RolloutError> {
    let ids: Vec<String> = store
        .ids()?
        .into_iter()
        .filter_map(|id| match store.is_recorded(&id) {
            Ok(true) => Some(Ok(id)),
            Ok(false) => None,
            Err(error) => Some(Err(error)),
        })
        .collect::<Result<_, _>>()?;
    in_parallel(&ids, workers, stop, &|id| {
        let recorded = store.read(id)?;
        let stage = Stage::open(
            Arc::new(recorded.scenario.clone()),
            resources.catalogue,
            resources.planner.robot(),
            &settings.sim,
        )?;
        let mut policy: Box<dyn Policy> = match policy {
            BuiltinPolicy::Expert => Box::new(Expert::new(&stage, resources.planner, settings.expert.clone())),
            BuiltinPolicy::Replay => Box::new(OpenLoopReplay::of(&recorded)),
            BuiltinPolicy::DoNothing => Box::new(DoNothing { duration_s: 5.0 }),
        };
        let episode = run_episode(&stage, policy.as_mut(), id, recorded.result.seed, &settings.rollout)?;
        finished(&episode.result);
        Ok(episode.result)
    })
}
