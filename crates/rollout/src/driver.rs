//! Execution of actions in the environment, shared by the episode loop and by programs that step the environment
//! themselves.

use genmanip_core::{GoalVerdict, Observation, PolicySpec};

use crate::adapter::{Adapter, AdapterError, ArmReference, NativeAction, Pending};
use crate::environment::Event;
use crate::robot_interface::RobotInterface;
use crate::{RolloutError, RolloutSettings, Stage};

/// Executes actions of one specification as control steps of a robot, simulated or real.
#[derive(Clone, Debug)]
pub struct Driver {
    adapter: Adapter,
    /// Arm joint positions when the chunk was requested, rad.
    chunk_start: Vec<f64>,
    /// Rest of the path that earlier actions have not executed.
    pending: Pending,
    /// True if an unreachable pose is an error; false if the command in force is held instead.
    stop_on_unreachable: bool,
}

/// Outcome of executing one action.
#[derive(Clone, Debug, Default)]
pub struct ActionOutcome {
    /// Number of control steps executed.
    pub steps: usize,
    /// Last goal verdict during the action, if any.
    pub verdict: Option<GoalVerdict>,
    /// Events in the simulation during the action.
    pub events: Vec<Event>,
    /// The goal has held for the settling time and the settings say to stop then.
    pub terminated: bool,
    /// The time limit is reached.
    pub truncated: bool,
    /// The episode ended before the action was completed.
    pub cut_off: bool,
    /// Reason why the action was not executed and the command in force was held: the pose is unreachable. `None` if it
    /// was executed.
    pub refused: Option<String>,
}

impl Driver {
    /// Driver for the actions of a policy on a stage.
    ///
    /// # Errors
    /// If the environment does not support the specification, rate, cameras or state keys.
    pub fn new(spec: &PolicySpec, stage: &Stage, settings: &RolloutSettings) -> Result<Self, RolloutError> {
        let repeat = check_spec(spec, stage)?;
        let adapter = Adapter::new(spec.action, &stage.robot, &settings.ik, 1.0 / stage.control_rate_hz(), repeat)
            .map_err(|error| RolloutError::Spec { policy: spec.name.clone(), source: error.into() })?;
        let chunk_start = stage.scenario.world.robot.home.clone();
        let stop_on_unreachable = settings.stop_on_unreachable;
        Ok(Self { adapter, chunk_start, pending: Pending::default(), stop_on_unreachable })
    }

    /// Stores the current joint positions as reference of a new chunk of actions.
    ///
    /// # Errors
    /// If the robot has no episode.
    pub fn begin_chunk(&mut self, robot: &impl RobotInterface) -> Result<(), RolloutError> {
        self.chunk_start = robot.joint_positions()?;
        Ok(())
    }

    /// Executes an action, within the time limit. An action whose pose is unreachable is counted, and the command in
    /// force is held for its duration, unless the settings say to stop.
    ///
    /// # Errors
    /// [`RolloutError::Action`] for an invalid action, or an unreachable one if the settings say to stop, with the
    /// robot unchanged; errors of [`RobotInterface::step`].
    pub fn act(&mut self, robot: &mut impl RobotInterface, action: &[f32]) -> Result<ActionOutcome, RolloutError> {
        if robot.steps_left() == 0 {
            return Ok(ActionOutcome { truncated: true, cut_off: true, ..ActionOutcome::default() });
        }
        let (command, measured) = (robot.command()?, robot.joint_positions()?);
        let width_m = command.last().copied().unwrap_or_default();
        let arm: Vec<f64> = command[..measured.len()].iter().copied().map(f64::from).collect();
        let (chunk_start, pending) = (&self.chunk_start, &self.pending);
        let from = ArmReference { command: &arm, width_m, measured: &measured, chunk_start, pending };
        match self.adapter.to_native(action, from) {
            Ok(NativeAction { commands, pending }) => {
                self.pending = pending;
                execute(robot, &commands)
            }
            Err(error @ AdapterError::OutOfReach { .. }) if !self.stop_on_unreachable => {
                let reason = error.to_string();
                robot.count_unreachable(&reason)?;
                let held = execute(robot, &vec![command; self.adapter.repeat()])?;
                Ok(ActionOutcome { refused: Some(reason), ..held })
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Adds the tool pose that the last action requested to an observation.
    ///
    /// # Errors
    /// If the robot has no episode.
    pub fn add_target(&self, robot: &impl RobotInterface, observation: &mut Observation) -> Result<(), RolloutError> {
        let command: Vec<f64> = robot.command()?.iter().copied().map(f64::from).collect();
        let arm = &command[..self.chunk_start.len()];
        let pose = self.adapter.requested_pose(arm, &self.pending);
        observation.state.insert(Observation::TOOL_TARGET.into(), pose.to_row().to_vec());
        Ok(())
    }
}

/// Executes one control step per command, until the time limit or the goal's settling time is reached.
fn execute(robot: &mut impl RobotInterface, commands: &[Vec<f32>]) -> Result<ActionOutcome, RolloutError> {
    let left = robot.steps_left();
    let mut turn = ActionOutcome { truncated: left == 0, ..ActionOutcome::default() };
    for command in commands.iter().take(left) {
        let step = robot.step(command)?;
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

/// Control steps per action; fails if the environment does not support the specification.
fn check_spec(spec: &PolicySpec, stage: &Stage) -> Result<usize, RolloutError> {
    let refuse = |why: String| Err(RolloutError::Spec { policy: spec.name.clone(), source: why.into() });
    let repeat = match spec.control_steps(stage.control_rate_hz()) {
        Ok(repeat) => repeat,
        Err(why) => return refuse(why),
    };
    if let Some(key) = spec.state_keys.iter().find(|key| *key != Observation::STATE) {
        return refuse(format!("unknown state key `{key}`, expected `{}`", Observation::STATE));
    }
    for (index, request) in spec.cameras.iter().enumerate() {
        if let Err(error) = stage.camera(request) {
            return refuse(error.to_string());
        }
        if spec.cameras[..index].iter().any(|other| other.name == request.name) {
            return refuse(format!("camera `{}` is requested twice", request.name));
        }
        if request.channels.ids && !spec.privileged {
            return refuse(format!(
                "camera `{}` requests instance ids, which are simulator ground truth: expected a privileged policy",
                request.name
            ));
        }
    }
    Ok(repeat)
}
