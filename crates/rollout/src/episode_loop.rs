//! The one loop: a policy drives the environment, episode after episode.

use std::sync::Arc;

use genmanip_core::{
    ActionSpace, Ending, Episode, EpisodeStart, Failure, FailureCause, Policy, PolicyError, PolicySpec, Seed,
};
use genmanip_sim::SimError;

use crate::environment::{Conclusion, Environment};
use crate::{RolloutError, RolloutSettings, Stage};

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
    let spec = policy.spec();
    let repeat = check_spec(&spec, stage)?;
    let mut environment = Environment::new(settings.clone());
    environment.reset(stage, seed);
    let start = EpisodeStart {
        instruction: stage.scenario.task.instruction.clone(),
        seed: seed.fork("policy"),
        cameras: stage.scenario.world.cameras.iter().filter(|c| spec.cameras.contains(&c.name)).cloned().collect(),
        scenario: spec.privileged.then(|| Arc::clone(&stage.scenario)),
    };
    let (ending, word) = match policy.reset(&start) {
        Ok(()) => drive(&mut environment, policy, &spec, repeat)?,
        Err(error) => gave_up(error, &spec)?,
    };
    environment.finish(Conclusion { id, policy: &spec.name, oracle: spec.privileged, ending, word })
}

/// Observes, asks and steps until the episode ends; how it ended, and the policy's word if it gave up.
fn drive(
    environment: &mut Environment,
    policy: &mut dyn Policy,
    spec: &PolicySpec,
    repeat: usize,
) -> Result<(Ending, Option<Failure>), RolloutError> {
    loop {
        let left = environment.steps_left();
        if left == 0 {
            return Ok((Ending::Horizon, None));
        }
        let mut observation = environment.observe()?;
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
        let commands = chunk.actions.iter().take(count).flat_map(|action| std::iter::repeat_n(action, repeat));
        for command in commands.take(left) {
            match environment.step(command) {
                Ok(step) if step.terminated => return Ok((Ending::Success, None)),
                Ok(_) => {}
                Err(RolloutError::Sim(
                    error @ (SimError::CommandLength { .. } | SimError::CommandNotFinite { .. }),
                )) => return Ok(broke(format!("action for control step {}: {error}", environment.frames().len()))),
                Err(error) => return Err(error),
            }
        }
        // What was cut off, by the horizon or by `execute_steps`, was not finished.
        let executed = chunk.actions.len() <= count && chunk.actions.len().saturating_mul(repeat) <= left;
        if chunk.finished && executed {
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
    if spec.action.space != ActionSpace::JointPosition || spec.action.gripper != "width_m" {
        return refuse("expected native actions: absolute joint positions and the gripper width in metres".into());
    }
    if let Some(key) = spec.state_keys.iter().find(|key| *key != "observation.state") {
        return refuse(format!("unknown state key `{key}`, there is `observation.state`"));
    }
    if let Some(camera) = spec.cameras.first() {
        let known = stage.scenario.world.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
        return refuse(format!(
            "camera `{camera}` would have to be rendered in the loop, which comes with learned policies; the \
             scenario's cameras are {known}"
        ));
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

fn broke(evidence: String) -> (Ending, Option<Failure>) {
    (Ending::GaveUp, Some(Failure { cause: FailureCause::Policy, evidence }))
}
