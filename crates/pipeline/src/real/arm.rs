//! Arm behind a bridge as the robot of the episode loop.

use std::sync::Arc;

use genmanip_core::{Camera, CameraRequest, Frame, ImageChannels, Observation, PrivilegedState, RgbdImage};
use genmanip_real::bridge::beyond_m;
use genmanip_real::bridge::client::{ArmClient, BridgeError, Connection};
use genmanip_rollout::environment::Step;
use genmanip_rollout::{RobotInterface, RolloutError, Stage};

use super::cameras::Rig;

/// Simulator truth behind a connection, for tests and measurements: a real bridge has none.
pub trait SideChannel {
    /// Poses of the objects, and the grasped one.
    fn truth(&self) -> PrivilegedState;

    /// Instance ids of the pixels of an image that is taken now.
    ///
    /// # Errors
    /// If the camera is not known or cannot be rendered.
    fn ids(&self, request: &CameraRequest) -> Result<Vec<u16>, String>;
}

/// Function that is called with the number of each frame.
type OnFrame = Box<dyn FnMut(usize) + Send>;

/// Settings of a run on an arm.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmSettings {
    /// Time limit, s.
    pub horizon_s: f64,
    /// True to check every command and send none: the arm stays still.
    pub dry_run: bool,
}

/// Findings of a dry run about the commands of a policy.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct DryReport {
    /// Number of commands.
    pub commands: usize,
    /// Number of commands outside of the joint limits.
    pub beyond_limits: usize,
    /// Number of commands whose tool lies outside of the workspace box.
    pub outside_workspace: usize,
    /// Largest change of a joint between two commands, rad.
    pub largest_step_rad: f64,
    /// Largest distance of a first command of a joint from its measured position, rad.
    pub first_step_rad: f64,
}

/// Arm behind a bridge, in an episode.
pub struct RealArm<C> {
    client: ArmClient<C>,
    stage: Stage,
    settings: ArmSettings,
    rig: Rig,
    side_channel: Option<fn(&C) -> &dyn SideChannel>,
    command: Vec<f32>,
    frames: Vec<Frame>,
    /// Time of each frame's measurement on the bridge's clock, s.
    stamps_s: Vec<f64>,
    /// Time at which the next control step begins, on the client's clock, s; `None` before the first.
    next_s: Option<f64>,
    period_s: f64,
    unreachable: usize,
    dry: DryReport,
    on_frame: Option<OnFrame>,
}

impl<C: Connection> RealArm<C> {
    /// Arm at the start of an episode.
    ///
    /// # Errors
    /// If the arm behind the bridge has other joints than the robot of the stage.
    pub fn new(client: ArmClient<C>, stage: &Stage, settings: ArmSettings, rig: Rig) -> Result<Self, RolloutError> {
        let (expected, got) = (stage.robot.arm_dof(), client.welcome().joints.len());
        if expected != got {
            let robot = &stage.robot.name;
            let what =
                format!("the bridge's arm `{}` has {got} joints, {robot} has {expected}", client.welcome().robot);
            return Err(RolloutError::Robot(what.into()));
        }
        let state = client.state();
        let width_m = state.gripper.map_or(stage.robot.gripper.max_width, |gripper| gripper.width_m);
        let command = state.positions.iter().chain([&width_m]).map(|&value| value as f32).collect();
        Ok(Self {
            period_s: 1.0 / stage.control_rate_hz(),
            client,
            stage: stage.clone(),
            settings,
            rig,
            side_channel: None,
            command,
            frames: Vec::new(),
            stamps_s: Vec::new(),
            next_s: None,
            unreachable: 0,
            dry: DryReport::default(),
            on_frame: None,
        })
    }

    /// The same arm with simulator truth for privileged policies.
    #[must_use]
    pub fn with_truth(self) -> Self
    where
        C: SideChannel,
    {
        Self { side_channel: Some(|connection| connection), ..self }
    }

    /// Calls a function with the number of each frame, at its start.
    #[must_use]
    pub fn watched(self, on_frame: impl FnMut(usize) + Send + 'static) -> Self {
        Self { on_frame: Some(Box::new(on_frame)), ..self }
    }

    /// Client of the bridge.
    pub fn client(&self) -> &ArmClient<C> {
        &self.client
    }

    /// Number of actions that were held because their pose is unreachable.
    pub fn unreachable(&self) -> usize {
        self.unreachable
    }

    /// Time of each frame's measurement on the bridge's clock, s.
    pub fn stamps_s(&self) -> &[f64] {
        &self.stamps_s
    }

    /// Findings of a dry run.
    pub fn dry_report(&self) -> &DryReport {
        &self.dry
    }

    /// Holds the last command for a time.
    ///
    /// # Errors
    /// As [`RobotInterface::step`].
    pub fn hold(&mut self, time_s: f64) -> Result<(), RolloutError> {
        let command = self.command.clone();
        for _ in 0..(time_s / self.period_s).round() as usize {
            self.step(&command)?;
        }
        Ok(())
    }

    /// Stops the arm and returns the lease.
    ///
    /// # Errors
    /// If the bridge does not answer.
    pub fn release(&mut self) -> Result<(), BridgeError> {
        self.client.release()
    }

    /// Frames of the episode, which is over.
    pub fn into_frames(self) -> Vec<Frame> {
        self.frames
    }

    /// Image of the rig; instance ids, which no camera measures, come over the side channel.
    fn image(&mut self, camera: &Camera, request: &CameraRequest) -> Result<RgbdImage, RolloutError> {
        let Some(side_channel) = self.side_channel.filter(|_| request.channels.ids) else {
            return self.rig.image(&mut self.client, &self.stage.robot, camera, request);
        };
        let channels = ImageChannels { ids: false, ..request.channels };
        let measured = CameraRequest { channels, ..request.clone() };
        let mut image = self.rig.image(&mut self.client, &self.stage.robot, camera, &measured)?;
        let ids = side_channel(self.client.connection()).ids(request);
        image.ids =
            ids.map_err(|why| RolloutError::Robot(format!("instance ids of `{}`: {why}", request.name).into()))?;
        Ok(image)
    }

    fn state(&self) -> Observation {
        let state = self.client.state();
        let width_m = state.gripper.map_or(0.0, |gripper| gripper.width_m);
        let tool = self.stage.robot.tcp_pose(&state.positions).to_row().to_vec();
        let measured = state.positions.iter().copied().chain([width_m]).collect();
        let command = self.command.iter().copied().map(f64::from).collect();
        let named = [(Observation::STATE, measured), (Observation::COMMAND, command), (Observation::TOOL, tool)];
        Observation {
            time_s: self.frames.len() as f64 * self.period_s,
            state: named.map(|(key, values)| (key.to_owned(), values)).into(),
            ..Observation::default()
        }
    }

    /// State of the arm at the start of a control step, with its command.
    fn frame(&self, command: &[f32]) -> Frame {
        let state = self.client.state();
        Frame {
            time_s: self.frames.len() as f64 * self.period_s,
            command: command.to_vec(),
            joint_position: state.positions.clone(),
            joint_velocity: state.velocities.clone(),
            joint_torque: match state.torques.len() == state.positions.len() {
                true => state.torques.iter().map(|torque| torque.abs()).collect(),
                false => vec![0.0; state.positions.len()],
            },
            gripper_width: state.gripper.map_or(0.0, |gripper| gripper.width_m),
            grip_force: 0.0,
            tcp: self.stage.robot.tcp_pose(&state.positions),
            objects: Vec::new(),
            grasped: None,
            stray_contact_n: 0.0,
        }
    }

    /// Counts what is wrong with a command that is not sent.
    fn check(&mut self, arm: &[f64]) {
        let before: Vec<f64> = match self.dry.commands {
            0 => self.client.state().positions.clone(),
            _ => self.command[..arm.len()].iter().copied().map(f64::from).collect(),
        };
        let step_rad = arm.iter().zip(&before).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if self.dry.commands == 0 {
            self.dry.first_step_rad = step_rad;
        }
        let limits = &self.client.welcome().joints;
        let is_beyond = arm.iter().zip(limits).any(|(q, limits)| *q < limits.lower - 1e-4 || *q > limits.upper + 1e-4);
        let tool = self.stage.robot.tcp_pose(arm).position.to_array();
        let is_outside = self.client.settings().workspace_m.is_some_and(|workspace| beyond_m(&workspace, &tool) > 0.0);
        self.dry.commands += 1;
        self.dry.beyond_limits += usize::from(is_beyond);
        self.dry.outside_workspace += usize::from(is_outside);
        self.dry.largest_step_rad = self.dry.largest_step_rad.max(step_rad);
    }
}

impl<C: Connection> RobotInterface for RealArm<C> {
    fn steps_left(&self) -> usize {
        ((self.settings.horizon_s / self.period_s).round() as usize).saturating_sub(self.frames.len())
    }

    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn observe(&mut self, cameras: &[CameraRequest]) -> Result<Observation, RolloutError> {
        self.client.wait(self.client.now_s()).map_err(failed)?;
        let mut observation = self.state();
        for request in cameras {
            let camera = self.stage.camera(request)?;
            let image = self.image(&camera, request)?;
            observation.images.insert(request.name.clone(), Arc::new(image));
        }
        Ok(observation)
    }

    fn truth(&mut self) -> Result<PrivilegedState, RolloutError> {
        let none = || RolloutError::Robot("a real arm has no simulator truth: this policy cannot act on it".into());
        self.side_channel.map(|side| side(self.client.connection()).truth()).ok_or_else(none)
    }

    fn command(&self) -> Result<Vec<f32>, RolloutError> {
        Ok(self.command.clone())
    }

    fn joint_positions(&self) -> Result<Vec<f64>, RolloutError> {
        Ok(self.client.state().positions.clone())
    }

    fn step(&mut self, command: &[f32]) -> Result<Step, RolloutError> {
        let dof = self.stage.robot.arm_dof();
        if command.len() != dof + 1 || !command.iter().all(|value| value.is_finite()) {
            let what = format!("expected {} finite numbers as a command, got {command:?}", dof + 1);
            return Err(RolloutError::Robot(what.into()));
        }
        let arm: Vec<f64> = command[..dof].iter().copied().map(f64::from).collect();
        if self.settings.dry_run {
            self.check(&arm);
        } else {
            self.client.command(&arm, f64::from(command[dof])).map_err(failed)?;
        }
        if let Some(on_frame) = &mut self.on_frame {
            on_frame(self.frames.len());
        }
        self.frames.push(self.frame(command));
        self.stamps_s.push(self.client.state().measured_s);
        self.command = command.to_vec();
        // After a pause in which the policy was thinking, the steps go on from now.
        let now_s = self.client.now_s();
        let next_s = self.next_s.map_or(now_s, |next_s| next_s.max(now_s - self.period_s)) + self.period_s;
        self.next_s = Some(next_s);
        self.client.wait(next_s).map_err(failed)?;
        Ok(Step {
            observation: self.state(),
            verdict: None,
            terminated: false,
            truncated: self.steps_left() == 0,
            events: Vec::new(),
        })
    }

    fn count_unreachable(&mut self, _reason: &str) -> Result<(), RolloutError> {
        self.unreachable += 1;
        Ok(())
    }
}

impl<C> std::fmt::Debug for RealArm<C> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RealArm").field("frames", &self.frames.len()).finish_non_exhaustive()
    }
}

fn failed(error: BridgeError) -> RolloutError {
    RolloutError::Robot(error.into())
}
