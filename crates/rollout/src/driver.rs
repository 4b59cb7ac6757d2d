//! Actions of a contract drive the environment: what the episode loop and programs that step by themselves share.

use genmanip_core::{GoalVerdict, Observation, PolicySpec};

use crate::adapter::{Adapter, ArmReference, NativeAction, Pending};
use crate::environment::{Environment, Event};
use crate::{RolloutError, RolloutSettings, Stage};

/// Turns actions of one contract into control steps of an environment.
#[derive(Clone, Debug)]
pub struct Driver {
    adapter: Adapter,
    /// Arm joint positions when the chunk was asked for, rad.
    chunk_start: Vec<f64>,
    /// What the actions before asked for and was not done yet.
    pending: Pending,
}

/// What one action led to.
#[derive(Clone, Debug, Default)]
pub struct Turn {
    /// Control steps that were made.
    pub steps: usize,
    /// The goal's last verdict on the way, where the environment judged it.
    pub verdict: Option<GoalVerdict>,
    /// What happened.
    pub events: Vec<Event>,
    /// The goal has held for the settling time, and the settings say to stop then.
    pub terminated: bool,
    /// The longest allowed time is over.
    pub truncated: bool,
    /// The episode ended before the action did.
    pub cut_off: bool,
}

impl Driver {
    /// For the actions of a policy on a stage.
    ///
    /// # Errors
    /// A contract, rate, camera or state that the environment does not serve.
    pub fn new(spec: &PolicySpec, stage: &Stage, settings: &RolloutSettings) -> Result<Self, RolloutError> {
        let repeat = check_spec(spec, stage)?;
        let adapter = Adapter::new(spec.action, &stage.robot, &settings.ik, 1.0 / stage.control_rate_hz(), repeat)
            .map_err(|error| RolloutError::Spec { policy: spec.name.clone(), reason: error.to_string() })?;
        Ok(Self { adapter, chunk_start: stage.scenario.world.robot.home.clone(), pending: Pending::default() })
    }

    /// Says that a chunk of actions was asked for now.
    ///
    /// # Errors
    /// Before the environment's first reset.
    pub fn begin_chunk(&mut self, environment: &Environment) -> Result<(), RolloutError> {
        self.chunk_start = environment.joint_positions()?;
        Ok(())
    }

    /// Carries out an action, as far as time is left.
    ///
    /// # Errors
    /// [`RolloutError::Action`] for what is no action, or asks for a pose out of reach: nothing has changed then.
    /// What [`Environment::step`] refuses.
    pub fn act(&mut self, environment: &mut Environment, action: &[f32]) -> Result<Turn, RolloutError> {
        if environment.steps_left() == 0 {
            return Ok(Turn { truncated: true, cut_off: true, ..Turn::default() });
        }
        let (command, measured) = (environment.command()?, environment.joint_positions()?);
        let width_m = command.last().copied().unwrap_or_default();
        let command: Vec<f64> = command[..measured.len()].iter().copied().map(f64::from).collect();
        let (chunk_start, pending) = (&self.chunk_start, &self.pending);
        let from = ArmReference { command: &command, width_m, measured: &measured, chunk_start, pending };
        let NativeAction { commands, pending } = self.adapter.to_native(action, from)?;
        self.pending = pending;
        carry_out(environment, &commands)
    }

    /// Holds the command in force for as long as an action lasts.
    ///
    /// # Errors
    /// What [`Environment::step`] refuses.
    pub fn hold(&mut self, environment: &mut Environment) -> Result<Turn, RolloutError> {
        let commands = vec![environment.command()?; self.adapter.repeat()];
        carry_out(environment, &commands)
    }
}

/// Makes one control step per command, as far as time is left and the goal has not held long enough.
fn carry_out(environment: &mut Environment, commands: &[Vec<f32>]) -> Result<Turn, RolloutError> {
    let left = environment.steps_left();
    let mut turn = Turn { truncated: left == 0, ..Turn::default() };
    for command in commands.iter().take(left) {
        let step = environment.step(command)?;
        turn.steps += 1;
        turn.verdict = step.verdict.or(turn.verdict);
        turn.events.extend(step.events);
        (turn.terminated, turn.truncated) = (step.terminated, step.truncated);
        if step.terminated {
            break;
        }
    }
    turn.cut_off = turn.steps < commands.len();
    Ok(turn)
}

/// How many control steps one action lasts; refuses what the environment cannot serve.
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
