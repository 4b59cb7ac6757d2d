//! The episode loop: a policy drives the environment, or a real arm.

use std::sync::Arc;

use crate::adapter::AdapterError;
use crate::driver::Driver;
use crate::environment::{Conclusion, Environment, steps_in, timeout};
use crate::robot_interface::RobotInterface;
use crate::{RolloutError, RolloutSettings, Stage};
use genmanip_core::{
    Correction, Ending, Episode, EpisodeStart, Failure, FailureCause, Policy, PolicyError, PolicySpec, Seed,
};

/// Runs one episode and judges it.
///
/// The policy acts until it finishes, gives up or reaches the time limit; then the last command is held for `settle_s`
/// and the goal is judged on posed geometry, with nothing gripped and nothing moving.
///
/// # Errors
/// On internal errors: an unsupported policy specification, or an unstable simulation. [`RolloutError::NotRun`] if the
/// policy is unreachable or makes a mistake, such as an action of the wrong length: the episode may be retried. A policy
/// that fails gives a failed result, not an error.
pub fn run_episode(
    stage: &Stage,
    policy: &mut dyn Policy,
    id: &str,
    seed: Seed,
    settings: &RolloutSettings,
) -> Result<Episode, RolloutError> {
    run_episode_with(stage, policy, id, seed, settings, &mut |_| Ok(()))
}

/// Callback before each turn of a policy.
pub type BeforeTurn<'a> = dyn FnMut(&Environment) -> Result<(), RolloutError> + 'a;

/// As [`run_episode`], calling `before_turn` before each turn of the policy, for example to save the environment.
///
/// # Errors
/// As [`run_episode`], and those of `before_turn`.
pub fn run_episode_with(
    stage: &Stage,
    policy: &mut dyn Policy,
    id: &str,
    seed: Seed,
    settings: &RolloutSettings,
    before_turn: &mut BeforeTurn,
) -> Result<Episode, RolloutError> {
    let mut environment = Environment::new(settings.clone());
    environment.reset(stage, seed);
    let spec = policy.spec();
    let (ending, gave_up) =
        act(&mut environment, settings, stage, policy, &spec, seed.fork("policy"), usize::MAX, before_turn)?;
    conclude(&mut environment, policy, Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, gave_up })
}

/// Judges the episode and, if it failed, adds the policy's own analysis.
fn conclude(
    environment: &mut Environment,
    policy: &dyn Policy,
    conclusion: Conclusion,
) -> Result<Episode, RolloutError> {
    let mut episode = environment.finish(conclusion)?;
    if !episode.result.success {
        episode.result.agent_failure = policy.analyse(&episode.frames);
    }
    Ok(episode)
}

/// Share of the time limit after which the expert takes over. Chosen by hand: the expert needs less than the other
/// half.
const FIRST_SHARE: f64 = 0.5;

/// Runs an episode in which `first` acts and `expert` takes over if it fails.
///
/// `first` acts until it finishes, gives up or half of the time limit has passed. Its last command is held for
/// `settle_s` and the goal is judged, as at the end of any episode. If the goal does not hold, the expert continues
/// from there, with arm, gripper and objects as they are. The result is then the expert's, with the start of the
/// correction and the failures of `first` in [`EpisodeResult::correction`](genmanip_core::EpisodeResult::correction).
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
    let (ending, gave_up) =
        act(&mut environment, settings, stage, first, &spec, seed.fork("policy"), until, &mut |_| Ok(()))?;
    let gave_up = gave_up.or_else(|| timeout(ending, FIRST_SHARE * settings.horizon_s));
    let mut is_over = ending == Ending::Success;
    for _ in 0..steps_in(settings.settle_s, stage) {
        if is_over || environment.steps_left() == 0 {
            break;
        }
        let command = environment.command()?;
        is_over = environment.step(&command)?.terminated;
    }
    let failures = environment.failures(gave_up.clone())?;
    if is_over || failures.is_empty() {
        return environment.finish(Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, gave_up });
    }
    let correction = Correction { policy: spec.name, from_step: environment.frames().len(), failures };
    let spec = expert.spec();
    let seed = seed.fork("correction");
    let (ending, gave_up) = act(&mut environment, settings, stage, expert, &spec, seed, usize::MAX, &mut |_| Ok(()))?;
    let mut episode =
        environment.finish(Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, gave_up })?;
    episode.result.correction = Some(correction);
    Ok(episode)
}

/// Lets a policy act on a robot until it finishes, gives up or reaches the time limit, without judging the outcome;
/// returns the ending, and the policy's reason if it gave up. For robots that are no [`Environment`].
///
/// # Errors
/// As [`run_episode`], and those of the robot.
pub fn run_policy(
    robot: &mut impl RobotInterface,
    stage: &Stage,
    policy: &mut dyn Policy,
    seed: Seed,
    settings: &RolloutSettings,
) -> Result<(Ending, Option<Failure>), RolloutError> {
    let spec = policy.spec();
    act(robot, settings, stage, policy, &spec, seed.fork("policy"), usize::MAX, &mut |_| Ok(()))
}

/// Resets a policy and lets it act until `until` control steps have been executed in total.
#[expect(clippy::too_many_arguments, reason = "all are inputs of one loop")]
fn act<R: RobotInterface>(
    robot: &mut R,
    settings: &RolloutSettings,
    stage: &Stage,
    policy: &mut dyn Policy,
    spec: &PolicySpec,
    seed: Seed,
    until: usize,
    before_turn: &mut dyn FnMut(&R) -> Result<(), RolloutError>,
) -> Result<(Ending, Option<Failure>), RolloutError> {
    let mut driver = Driver::new(spec, stage, settings)?;
    match policy.reset(&episode_start(stage, spec, seed)?) {
        Ok(()) => drive(robot, policy, spec, &mut driver, until, before_turn),
        Err(error) => gave_up(error, spec),
    }
}

/// Information for a policy before an episode.
pub(crate) fn episode_start(stage: &Stage, spec: &PolicySpec, seed: Seed) -> Result<EpisodeStart, RolloutError> {
    Ok(EpisodeStart {
        instruction: stage.scenario.task.instruction.clone(),
        seed,
        cameras: spec.cameras.iter().map(|request| stage.camera(request)).collect::<Result<_, _>>()?,
        scenario: spec.privileged.then(|| Arc::clone(&stage.scenario)),
    })
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
    let (ending, gave_up) = drive(environment, policy, &spec, &mut driver, usize::MAX, &mut |_| Ok(()))?;
    conclude(environment, policy, Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, gave_up })
}

/// Minimum interval between observations from which render caches are dropped, s: in that time the arm crosses a tenth
/// of the image, so the caches would hardly help.
const UNCACHED_INTERVAL_S: f64 = 0.25;

/// Observes, queries the policy and steps until the episode ends or `until` control steps have been executed; returns
/// the ending, and the policy's reason if it gave up.
fn drive<R: RobotInterface>(
    robot: &mut R,
    policy: &mut dyn Policy,
    spec: &PolicySpec,
    driver: &mut Driver,
    until: usize,
    before_turn: &mut dyn FnMut(&R) -> Result<(), RolloutError>,
) -> Result<(Ending, Option<Failure>), RolloutError> {
    let mut last_observed_s = None;
    loop {
        if robot.steps_left() == 0 || robot.frames().len() >= until {
            return Ok((Ending::Horizon, None));
        }
        before_turn(robot)?;
        let mut observation = robot.observe(&spec.cameras)?;
        // Rare observations mean a policy that computes for long, usually with many episodes in parallel: save memory.
        let since = last_observed_s.replace(observation.time_s).map(|before| observation.time_s - before);
        if since.is_none_or(|since_s| since_s > UNCACHED_INTERVAL_S) {
            robot.drop_render_caches();
        }
        if spec.privileged {
            observation.privileged = Some(robot.truth()?);
        }
        driver.add_target(robot, &mut observation)?;
        let chunk = match policy.act(&observation) {
            Ok(chunk) => chunk,
            Err(error) => return gave_up(error, spec),
        };
        if chunk.actions.is_empty() && !chunk.finished {
            return Err(mistake(spec, format!("it returned no action\n{NO_ACTION}")));
        }
        let count = if spec.execute_steps == 0 { usize::MAX } else { spec.execute_steps };
        driver.begin_chunk(robot)?;
        let mut cut_off = chunk.actions.len() > count;
        for action in chunk.actions.iter().take(count) {
            if robot.frames().len() >= until {
                return Ok((Ending::Horizon, None));
            }
            match act_once(robot, spec, driver, action)? {
                Acted::On { is_cut_off } => cut_off |= is_cut_off,
                Acted::Over(ending, failure) => return Ok((ending, failure)),
            }
        }
        // A chunk cut off by the time limit or by `execute_steps` is not finished.
        if chunk.finished && !cut_off {
            return Ok((Ending::Finished, None));
        }
    }
}

/// Outcome of an action of a policy.
pub(crate) enum Acted {
    /// The episode goes on.
    On {
        /// True if the action was not completed.
        is_cut_off: bool,
    },
    /// The episode is over, for this reason.
    Over(Ending, Option<Failure>),
}

/// Executes an action of a policy.
pub(crate) fn act_once<R: RobotInterface>(
    robot: &mut R,
    spec: &PolicySpec,
    driver: &mut Driver,
    action: &[f32],
) -> Result<Acted, RolloutError> {
    match driver.act(robot, action) {
        Ok(turn) if turn.terminated => Ok(Acted::Over(Ending::Success, None)),
        Ok(turn) => Ok(Acted::On { is_cut_off: turn.cut_off }),
        Err(RolloutError::Action(error @ AdapterError::OutOfReach { .. })) => {
            let (ending, failure) = unreachable_action(&error, robot);
            Ok(Acted::Over(ending, failure))
        }
        Err(RolloutError::Action(error)) => {
            Err(mistake(spec, format!("action for control step {}: {error}", robot.frames().len())))
        }
        Err(error) => Err(error),
    }
}

pub(crate) fn gave_up(error: PolicyError, spec: &PolicySpec) -> Result<(Ending, Option<Failure>), RolloutError> {
    match error {
        PolicyError::GaveUp(failure) => Ok((Ending::GaveUp, Some(failure))),
        PolicyError::Unsuited(reason) => Ok(failed_policy(reason)),
        PolicyError::Mistake(reason) => Err(mistake(spec, reason)),
        PolicyError::Unreachable(reason) => {
            Err(RolloutError::NotRun { policy: spec.name.clone(), reason, mistake: false })
        }
        PolicyError::Broken(error) => Err(RolloutError::Policy { policy: spec.name.clone(), source: error.into() }),
    }
}

/// Remedy of an empty action chunk.
pub(crate) const NO_ACTION: &str = "hint: a chunk has at least one action, or says that the task is finished";

pub(crate) fn mistake(spec: &PolicySpec, reason: String) -> RolloutError {
    RolloutError::NotRun { policy: spec.name.clone(), reason, mistake: true }
}

/// End of an episode whose settings do not tolerate an unreachable action.
fn unreachable_action(error: &AdapterError, robot: &impl RobotInterface) -> (Ending, Option<Failure>) {
    let evidence = format!("action for control step {}: {error}", robot.frames().len());
    (Ending::GaveUp, Some(Failure { cause: FailureCause::NoIk, evidence }))
}

fn failed_policy(evidence: String) -> (Ending, Option<Failure>) {
    (Ending::GaveUp, Some(Failure { cause: FailureCause::Policy, evidence }))
}
