//! The one loop: a policy drives the environment, episode after episode.

use std::sync::Arc;

use crate::adapter::AdapterError;
use crate::driver::Driver;
use crate::environment::{Conclusion, Environment};
use crate::{RolloutError, RolloutSettings, Stage};
use genmanip_core::{Ending, Episode, EpisodeStart, Failure, FailureCause, Policy, PolicyError, PolicySpec, Seed};

/// Runs one episode and judges it.
///
/// The policy acts until it says it is finished, gives up or the horizon ends; then the last command is held for
/// `settle_s` and the goal is judged on posed geometry, nothing held and nothing moving.
///
/// # Errors
/// A defect: a spec that cannot be served, or a simulation that becomes unstable.
/// [`RolloutError::NotRun`] when the policy cannot be reached: the episode may be tried again.
/// A policy that fails is a result, not an error.
pub fn run_episode(
    stage: &Stage,
    policy: &mut dyn Policy,
    id: &str,
    seed: Seed,
    settings: &RolloutSettings,
) -> Result<Episode, RolloutError> {
    run_watched(stage, policy, id, seed, settings, &mut |_| Ok(()))
}

/// What is told of the environment before each turn of a policy.
pub type Watch<'a> = dyn FnMut(&Environment) -> Result<(), RolloutError> + 'a;

/// [`run_episode`], where `watch` sees the environment before each turn of the policy, for example to save it.
///
/// # Errors
/// As [`run_episode`], and those of `watch`.
pub fn run_watched(
    stage: &Stage,
    policy: &mut dyn Policy,
    id: &str,
    seed: Seed,
    settings: &RolloutSettings,
    watch: &mut Watch,
) -> Result<Episode, RolloutError> {
    let spec = policy.spec();
    let mut driver = Driver::new(&spec, stage, settings)?;
    let mut environment = Environment::new(settings.clone());
    environment.reset(stage, seed);
    let start = EpisodeStart {
        instruction: stage.scenario.task.instruction.clone(),
        seed: seed.fork("policy"),
        cameras: spec.cameras.iter().map(|request| stage.camera(request)).collect::<Result<_, _>>()?,
        scenario: spec.privileged.then(|| Arc::clone(&stage.scenario)),
    };
    let (ending, word) = match policy.reset(&start) {
        Ok(()) => drive(&mut environment, policy, &spec, &mut driver, watch)?,
        Err(error) => gave_up(error, &spec)?,
    };
    environment.finish(Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, word })
}

/// Runs the rest of an episode that was restored to the moment before a turn of its policy, and judges it.
///
/// # Errors
/// As [`run_episode`].
pub fn resume_episode(
    environment: &mut Environment,
    stage: &Stage,
    policy: &mut dyn Policy,
    id: &str,
) -> Result<Episode, RolloutError> {
    let spec = policy.spec();
    let mut driver = Driver::new(&spec, stage, environment.settings())?;
    let (ending, word) = drive(environment, policy, &spec, &mut driver, &mut |_| Ok(()))?;
    environment.finish(Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, word })
}

/// Looks farther apart than this have little in common, s: the arm crosses a tenth of the picture.
const SELDOM_S: f64 = 0.25;

/// Observes, asks and steps until the episode ends; how it ended, and the policy's word if it gave up.
fn drive(
    environment: &mut Environment,
    policy: &mut dyn Policy,
    spec: &PolicySpec,
    driver: &mut Driver,
    watch: &mut Watch,
) -> Result<(Ending, Option<Failure>), RolloutError> {
    let mut looked_at = None;
    loop {
        if environment.steps_left() == 0 {
            return Ok((Ending::Horizon, None));
        }
        watch(environment)?;
        let mut observation = environment.observe(&spec.cameras)?;
        // A policy that looks seldom often thinks long, beside many others.
        let since = looked_at.replace(observation.time_s).map(|before| observation.time_s - before);
        if since.is_none_or(|since_s| since_s > SELDOM_S) {
            environment.forget_pictures();
        }
        if spec.privileged {
            observation.privileged = Some(environment.truth()?);
        }
        let chunk = match policy.act(&observation) {
            Ok(chunk) => chunk,
            Err(error) => return gave_up(error, spec),
        };
        if chunk.actions.is_empty() && !chunk.finished {
            return Ok(broke("returned no action".into()));
        }
        let count = if spec.execute_steps == 0 { usize::MAX } else { spec.execute_steps };
        driver.begin_chunk(environment)?;
        let mut cut_off = chunk.actions.len() > count;
        for action in chunk.actions.iter().take(count) {
            match driver.act(environment, action) {
                Ok(turn) if turn.terminated => return Ok((Ending::Success, None)),
                Ok(turn) => cut_off |= turn.cut_off,
                Err(RolloutError::Action(error)) => return Ok(no_action(error, environment)),
                Err(error) => return Err(error),
            }
        }
        // What was cut off, by the horizon or by `execute_steps`, was not finished.
        if chunk.finished && !cut_off {
            return Ok((Ending::Finished, None));
        }
    }
}

fn gave_up(error: PolicyError, spec: &PolicySpec) -> Result<(Ending, Option<Failure>), RolloutError> {
    match error {
        PolicyError::GaveUp(failure) => Ok((Ending::GaveUp, Some(failure))),
        PolicyError::Unsuited(reason) => Ok(broke(reason)),
        PolicyError::Unreachable(reason) => Err(RolloutError::NotRun { policy: spec.name.clone(), reason }),
    }
}

/// What the policy returned is no action: its failure, and no configuration is one of its causes.
fn no_action(error: AdapterError, environment: &Environment) -> (Ending, Option<Failure>) {
    let cause = match error {
        AdapterError::OutOfReach { .. } => FailureCause::NoIk,
        _ => FailureCause::Policy,
    };
    let evidence = format!("action for control step {}: {error}", environment.frames().len());
    (Ending::GaveUp, Some(Failure { cause, evidence }))
}

fn broke(evidence: String) -> (Ending, Option<Failure>) {
    (Ending::GaveUp, Some(Failure { cause: FailureCause::Policy, evidence }))
}
