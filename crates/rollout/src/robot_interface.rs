//! Robot as the episode loop sees it.

use genmanip_core::{CameraRequest, Frame, Observation, PrivilegedState};

use crate::RolloutError;
use crate::environment::{Environment, Step};

/// Robot that a policy drives in the episode loop: the simulated [`Environment`], or a real arm.
pub trait RobotInterface {
    /// Control steps left before the time limit.
    fn steps_left(&self) -> usize;

    /// Frames recorded so far, one per control step.
    fn frames(&self) -> &[Frame];

    /// Observation now, with one image per request.
    ///
    /// # Errors
    /// If the robot or a camera gives none.
    fn observe(&mut self, cameras: &[CameraRequest]) -> Result<Observation, RolloutError>;

    /// Simulator ground truth, for privileged policies only.
    ///
    /// # Errors
    /// If the robot has none.
    fn truth(&mut self) -> Result<PrivilegedState, RolloutError>;

    /// Native command in force: arm joint targets (rad), then gripper width (m).
    ///
    /// # Errors
    /// If no episode is in progress.
    fn command(&self) -> Result<Vec<f32>, RolloutError>;

    /// Measured arm joint positions, rad.
    ///
    /// # Errors
    /// If no episode is in progress.
    fn joint_positions(&self) -> Result<Vec<f64>, RolloutError>;

    /// Runs one control interval with a native command.
    ///
    /// # Errors
    /// If the robot cannot execute it.
    fn step(&mut self, command: &[f32]) -> Result<Step, RolloutError>;

    /// Counts an action that was not executed because its pose is unreachable.
    ///
    /// # Errors
    /// If no episode is in progress.
    fn count_unreachable(&mut self, reason: &str) -> Result<(), RolloutError>;

    /// Drops caches that are of no use while a policy computes for long.
    fn drop_render_caches(&mut self) {}
}

impl RobotInterface for Environment {
    fn steps_left(&self) -> usize {
        self.steps_left()
    }

    fn frames(&self) -> &[Frame] {
        self.frames()
    }

    fn observe(&mut self, cameras: &[CameraRequest]) -> Result<Observation, RolloutError> {
        self.observe(cameras)
    }

    fn truth(&mut self) -> Result<PrivilegedState, RolloutError> {
        self.truth()
    }

    fn command(&self) -> Result<Vec<f32>, RolloutError> {
        self.command()
    }

    fn joint_positions(&self) -> Result<Vec<f64>, RolloutError> {
        self.joint_positions()
    }

    fn step(&mut self, command: &[f32]) -> Result<Step, RolloutError> {
        self.step(command)
    }

    fn count_unreachable(&mut self, reason: &str) -> Result<(), RolloutError> {
        self.count_unreachable(reason)
    }

    fn drop_render_caches(&mut self) {
        self.drop_render_caches();
    }
}
