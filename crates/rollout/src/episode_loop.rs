//! The one loop: a policy drives the environment, episode after episode.

use std::sync::Arc;

use crate::adapter::AdapterError;
use crate::driver::Driver;
use crate::environment::{Conclusion, Environment, steps_in, timeout};
use crate::{RolloutError, RolloutSettings, Stage};
use genmanip_core::{
    Correction, Ending, Episode, EpisodeStart, Failure, FailureCause, Policy, PolicyError, PolicySpec, Seed,
};

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
    let mut environment = Environment::new(settings.clone());
    environment.reset(stage, seed);
    let spec = policy.spec();
    let (ending, word) = act(&mut environment, stage, policy, &spec, seed.fork("policy"), usize::MAX, watch)?;
    environment.finish(Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, word })
}

/// Share of the longest allowed time after which whoever acts first is taken over from; chosen: the expert needs less
/// than the other half.
const FIRST_SHARE: f64 = 0.5;

/// Runs an episode in which `first` acts and, where it fails, `expert` takes over from what it left.
///
/// `first` acts until it says it is finished, gives up or half of the longest allowed time is over. Its last command is
/// held for `settle_s` and the goal is judged, as at the end of any episode. Where the goal does not hold, the expert
/// goes on from there: arm, hand and things are left as they are. The result is the expert's then and says in
/// [`EpisodeResult::correction`](genmanip_core::EpisodeResult::correction) where the correction begins and what was
/// wrong.
///
/// # Errors
/// As [`run_episode`].
pub fn run_corrected(
    stage: &Stage,
    first: &mut dyn Policy,
    expert: &mut dyn Policy,
    id: &str,
    seed: Seed,
    settings: &RolloutSettings,
) -> Result<Episode, RolloutError> {
    let mut environment = Environment::new(settings.clone());
    environment.reset(stage, seed);
    let spec = first.spec();
    let until = (FIRST_SHARE * environment.steps_left() as f64) as usize;
    let (ending, word) = act(&mut environment, stage, first, &spec, seed.fork("policy"), until, &mut |_| Ok(()))?;
    let word = word.or_else(|| timeout(ending, FIRST_SHARE * settings.horizon_s));
    let mut is_over = ending == Ending::Success;
    for _ in 0..steps_in(settings.settle_s, stage) {
        if is_over || environment.steps_left() == 0 {
            break;
        }
        let command = environment.command()?;
        is_over = environment.step(&command)?.terminated;
    }
    let failures = environment.failures(word.clone())?;
    if is_over || failures.is_empty() {
        return environment.finish(Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, word });
    }
    let correction = Correction { policy: spec.name, from_step: environment.frames().len(), failures };
    let spec = expert.spec();
    let seed = seed.fork("correction");
    let (ending, word) = act(&mut environment, stage, expert, &spec, seed, usize::MAX, &mut |_| Ok(()))?;
    let mut episode =
        environment.finish(Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, word })?;
    episode.result.correction = Some(correction);
    Ok(episode)
}

/// Tells a policy that an episode begins for it, whatever has become of the environment, and lets it act until so many
/// control steps are made in all.
fn act(
    environment: &mut Environment,
    stage: &Stage,
    policy: &mut dyn Policy,
    spec: &PolicySpec,
    seed: Seed,
    until: usize,
    watch: &mut Watch,
) -> Result<(Ending, Option<Failure>), RolloutError> {
    let mut driver = Driver::new(spec, stage, environment.settings())?;
    let start = EpisodeStart {
        instruction: stage.scenario.task.instruction.clone(),
        seed,
        cameras: spec.cameras.iter().map(|request| stage.camera(request)).collect::<Result<_, _>>()?,
        scenario: spec.privileged.then(|| Arc::clone(&stage.scenario)),
    };
    match policy.reset(&start) {
        Ok(()) => drive(environment, policy, spec, &mut driver, until, watch),
        Err(error) => gave_up(error, spec),
    }
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
    let (ending, word) = drive(environment, policy, &spec, &mut driver, usize::MAX, &mut |_| Ok(()))?;
    environment.finish(Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, word })
}

/// Looks farther apart than this have little in common, s: the arm crosses a tenth of the picture.
const SELDOM_S: f64 = 0.25;

/// Observes, asks and steps until the episode ends or `until` control steps are made; how it ended, and the policy's word
/// if it gave up.
fn drive(
    environment: &mut Environment,
    policy: &mut dyn Policy,
    spec: &PolicySpec,
    driver: &mut Driver,
    until: usize,
    watch: &mut Watch,
) -> Result<(Ending, Option<Failure>), RolloutError> {
    let mut looked_at = None;
    loop {
        if environment.steps_left() == 0 || environment.frames().len() >= until {
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
            if environment.frames().len() >= until {
                return Ok((Ending::Horizon, None));
            }
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
