//! Execution of actions in the environment, shared by the episode loop and by programs that step the environment
//! themselves.

use std::sync::Arc;

use genmanip_core::{ActionSpace, DeltaFrom, GoalVerdict, Interpolation, Observation, PolicySpec, RobotModel};

use crate::adapter::{Adapter, AdapterError, ArmReference, NativeAction, Pending};
use crate::environment::Event;
use crate::robot_interface::RobotInterface;
use crate::{RolloutError, RolloutSettings, Stage};

/// Executes actions of one specification as control steps of a robot, simulated or real.
#[derive(Clone, Debug)]
pub struct Driver {
    adapter: Adapter,
    robot: Arc<RobotModel>,
    control_period_s: f64,
    /// True if every action begins at the command in force, so that no chunk begins with a jump.
    is_continuous: bool,
    /// True if commands are interpolated from the command in force.
    is_interpolated: bool,
    /// Arm joint positions when the chunk was requested, rad.
    chunk_start: Vec<f64>,
    /// Rest of the path that earlier actions have not executed.
    pending: Pending,
    /// Transition from an earlier chunk that is still under way.
    seam: Option<Seam>,
    /// True if an unreachable pose is an error; false if the command in force is held instead.
    stop_on_unreachable: bool,
}

/// Smooth transition between the commands of two chunks that disagree.
#[derive(Clone, Debug)]
struct Seam {
    /// Commanded joint positions of the earlier chunk minus those of the later one where they join, rad.
    offset: Vec<f64>,
    /// Control steps executed, and control steps in total.
    steps: [usize; 2],
}

/// Shortest duration of a transition, s. Chosen by hand: longer than an action of most policies.
const SEAM_S: f64 = 0.2;
/// Largest acceleration of the tool that a transition adds, m/s²: at 60 Hz, half a millimetre per control step squared.
const SEAM_M_S2: f64 = 1.5;

impl Seam {
    /// Share of the offset after a number of control steps: 1 at the start, 0 at the end, at rest at both.
    fn share(&self, step: usize) -> f64 {
        let part = (step as f64 / self.steps[1].max(1) as f64).min(1.0);
        1.0 - part * part * (3.0 - 2.0 * part)
    }
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
        let is_absolute = spec.action.space.is_absolute();
        Ok(Self {
            adapter,
            robot: Arc::clone(&stage.robot),
            control_period_s: 1.0 / stage.control_rate_hz(),
            is_continuous: !is_absolute && spec.action.delta_from == DeltaFrom::Command,
            is_interpolated: spec.action.between == Interpolation::Linear
                && spec.action.space != ActionSpace::JointVelocity,
            chunk_start,
            pending: Pending::default(),
            seam: None,
            stop_on_unreachable,
        })
    }

    /// Duration of an action, s.
    pub fn action_s(&self) -> f64 {
        self.control_period_s * self.adapter.repeat() as f64
    }

    /// Stores the current joint positions as reference of a new chunk of actions.
    ///
    /// # Errors
    /// If the robot has no episode.
    pub fn begin_chunk(&mut self, robot: &impl RobotInterface) -> Result<(), RolloutError> {
        self.chunk_start = robot.joint_positions()?;
        Ok(())
    }

    /// Goes over to a chunk that was requested while an earlier one was executed: `chunk_start` are the arm joint
    /// positions measured then (rad), `new` is the action of the chunk to execute next, and `old` the one of the earlier
    /// chunk in its place, if it has one. The commands of the two are joined without a jump; returns the distance of the
    /// tool between them, m.
    ///
    /// # Errors
    /// As [`Driver::act`].
    pub fn join_chunk(
        &mut self,
        robot: &impl RobotInterface,
        chunk_start: Vec<f64>,
        old: Option<&[f32]>,
        new: &[f32],
    ) -> Result<f64, RolloutError> {
        let in_force: Vec<f64> = robot.command()?[..chunk_start.len()].iter().copied().map(f64::from).collect();
        let (mut from, mut rest) = (in_force.clone(), None);
        if let Some(old) = old.filter(|_| !self.is_continuous) {
            from = self.requested(robot, old)?.unwrap_or(in_force);
            rest = self.seam.take();
        }
        self.chunk_start = chunk_start;
        let to = self.requested(robot, new)?.filter(|_| !self.is_continuous);
        self.seam = None;
        let Some(to) = to else { return Ok(0.0) };
        let left = rest.map_or(vec![0.0; from.len()], |seam| {
            let share = seam.share(seam.steps[0] + self.adapter.repeat());
            seam.offset.iter().map(|offset| share * offset).collect()
        });
        let from: Vec<f64> = from.iter().zip(left).map(|(at, left)| at + left).collect();
        let apart_m = self.robot.tcp_pose(&from).position.distance(self.robot.tcp_pose(&to).position);
        // The second derivative of the smooth step is 6 offset / duration² at its ends.
        let duration_s = SEAM_S.max((6.0 * apart_m / SEAM_M_S2).sqrt());
        let steps = [0, (duration_s / self.control_period_s).ceil() as usize];
        self.seam = Some(Seam { offset: from.iter().zip(&to).map(|(from, to)| from - to).collect(), steps });
        Ok(apart_m)
    }

    /// Arm joint positions that an action requests at its end, rad; `None` if its pose is unreachable.
    fn requested(&self, robot: &impl RobotInterface, action: &[f32]) -> Result<Option<Vec<f64>>, RolloutError> {
        match self.converted(robot, action) {
            Ok(NativeAction { commands, .. }) => Ok(commands
                .last()
                .map(|command| command[..self.chunk_start.len()].iter().copied().map(f64::from).collect())),
            Err(RolloutError::Action(AdapterError::OutOfReach { .. })) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Native commands of an action.
    fn converted(&self, robot: &impl RobotInterface, action: &[f32]) -> Result<NativeAction, RolloutError> {
        let (command, measured) = (robot.command()?, robot.joint_positions()?);
        let width_m = command.last().copied().unwrap_or_default();
        let arm: Vec<f64> = command[..measured.len()].iter().copied().map(f64::from).collect();
        let (chunk_start, pending) = (&self.chunk_start, &self.pending);
        let from = ArmReference { command: &arm, width_m, measured: &measured, chunk_start, pending };
        Ok(self.adapter.to_native(action, from)?)
    }

    /// Adds the rest of a transition to the commands of an action. Interpolated commands begin at the command in force,
    /// which already holds that rest, and lose it until the end of the action.
    fn blend(&mut self, commands: &mut [Vec<f32>]) {
        let Some(seam) = &mut self.seam else { return };
        let held = if self.is_interpolated { seam.share(seam.steps[0]) } else { 0.0 };
        let count = commands.len() as f64;
        for (index, command) in commands.iter_mut().enumerate() {
            seam.steps[0] += 1;
            let share = seam.share(seam.steps[0]) - held * (1.0 - (index + 1) as f64 / count);
            command
                .iter_mut()
                .zip(&seam.offset)
                .for_each(|(at, offset)| *at = (f64::from(*at) + share * offset) as f32);
        }
        if seam.steps[0] >= seam.steps[1] {
            self.seam = None;
        }
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
        match self.converted(robot, action) {
            Ok(NativeAction { mut commands, pending }) => {
                self.pending = pending;
                self.blend(&mut commands);
                execute(robot, &commands)
            }
            Err(RolloutError::Action(error @ AdapterError::OutOfReach { .. })) if !self.stop_on_unreachable => {
                let reason = error.to_string();
                robot.count_unreachable(&reason)?;
                let held = execute(robot, &vec![robot.command()?; self.adapter.repeat()])?;
                Ok(ActionOutcome { refused: Some(reason), ..held })
            }
            Err(error) => Err(error),
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
