//! The one loop: a policy drives the environment, episode after episode.

use std::sync::Arc;

use crate::adapter::{Adapter, AdapterError, ArmReference, NativeAction};
use crate::environment::{Conclusion, Environment};
use crate::{RolloutError, RolloutSettings, Stage};
use genmanip_core::{
    Ending, Episode, EpisodeStart, Failure, FailureCause, Observation, Policy, PolicyError, PolicySpec, Seed,
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
    let spec = policy.spec();
    let adapter = adapter(&spec, stage, settings)?;
    let mut environment = Environment::new(settings.clone());
    environment.reset(stage, seed);
    let start = EpisodeStart {
        instruction: stage.scenario.task.instruction.clone(),
        seed: seed.fork("policy"),
        cameras: spec.cameras.iter().map(|request| stage.camera(request)).collect::<Result<_, _>>()?,
        scenario: spec.privileged.then(|| Arc::clone(&stage.scenario)),
    };
    let (ending, word) = match policy.reset(&start) {
        Ok(()) => drive(&mut environment, policy, &spec, &adapter, watch)?,
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
    let adapter = adapter(&spec, stage, environment.settings())?;
    let (ending, word) = drive(environment, policy, &spec, &adapter, &mut |_| Ok(()))?;
    environment.finish(Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, word })
}

fn adapter(spec: &PolicySpec, stage: &Stage, settings: &RolloutSettings) -> Result<Adapter, RolloutError> {
    let repeat = check_spec(spec, stage)?;
    Adapter::new(spec.action, &stage.robot, &settings.ik, 1.0 / stage.control_rate_hz(), repeat)
        .map_err(|error| RolloutError::Spec { policy: spec.name.clone(), reason: error.to_string() })
}

/// Looks farther apart than this have little in common, s: the arm crosses a tenth of the picture.
const SELDOM_S: f64 = 0.25;

/// Observes, asks and steps until the episode ends; how it ended, and the policy's word if it gave up.
fn drive(
    environment: &mut Environment,
    policy: &mut dyn Policy,
    spec: &PolicySpec,
    adapter: &Adapter,
    watch: &mut Watch,
) -> Result<(Ending, Option<Failure>), RolloutError> {
    let (mut looked_at, mut asked) = (None, None);
    loop {
        let left = environment.steps_left();
        if left == 0 {
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
        let chunk_start = environment.joint_positions()?;
        let mut cut_off = chunk.actions.len() > count;
        for action in chunk.actions.iter().take(count) {
            let left = environment.steps_left();
            if left == 0 {
                cut_off = true;
                break;
            }
            let (command, measured) = (environment.command()?, environment.joint_positions()?);
            let width_m = command.last().copied().unwrap_or_default();
            let command: Vec<f64> = command[..measured.len()].iter().copied().map(f64::from).collect();
            let from =
                ArmReference { command: &command, width_m, measured: &measured, chunk_start: &chunk_start, asked };
            let NativeAction { commands, world_from_tcp } = match adapter.to_native(action, from) {
                Ok(native) => native,
                Err(error) => return Ok(no_action(error, environment)),
            };
            asked = world_from_tcp;
            cut_off |= commands.len() > left;
            for command in commands.iter().take(left) {
                match environment.step(command) {
                    Ok(step) if step.terminated => return Ok((Ending::Success, None)),
                    Ok(_) => {}
                    Err(error) => return Err(error),
                }
            }
        }
        // What was cut off, by the horizon or by `execute_steps`, was not finished.
        if chunk.finished && !cut_off {
            return Ok((Ending::Finished, None));
        }
    }
}

/// How many control steps one action lasts; refuses what this loop cannot serve.
fn check_spec(spec: &PolicySpec, stage: &Stage) -> Result<usize, RolloutError> {
    let refuse = |reason: String| Err(RolloutError::Spec { policy: spec.name.clone(), reason });
    let control_rate_hz = stage.control_rate_hz();
    let repeat = control_rate_hz / spec.rate_hz;
    if !(repeat >= 1.0 && repeat.fract() == 0.0) {
        return refuse(format!("rate {} Hz does not divide the control rate of {control_rate_hz} Hz", spec.rate_hz));
    }
    if let Some(key) = spec.state_keys.iter().find(|key| *key != Observation::STATE) {
        return refuse(format!("unknown state key `{key}`, there is `{}`", Observation::STATE));
    }
    for (index, request) in spec.cameras.iter().enumerate() {
        if let Err(error) = stage.camera(request) {
            return refuse(error.to_string());
        }
        if spec.cameras[..index].iter().any(|other| other.name == request.name) {
            return refuse(format!("camera `{}` is asked for twice", request.name));
        }
        if request.channels.ids && !spec.privileged {
            return refuse(format!(
                "camera `{}` is asked for instance ids, which are simulator truth: expected a privileged policy",
                request.name
            ));
        }
    }
    Ok(repeat as usize)
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
