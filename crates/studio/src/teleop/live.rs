//! Robot of a take: the environment in real time, which a person may interrupt and take back to an earlier moment.

use genmanip_core::{CameraRequest, Frame, Observation, PrivilegedState};
use genmanip_rollout::environment::{Mark, Step};
use genmanip_rollout::{Environment, RobotInterface, RolloutError};

/// Control steps between two moments to which a take can return, 0.2 s at 60 Hz; the session shows them all.
const MARK_EVERY: usize = 12;

/// Callback before each control step, which may wait; its error ends the stretch of the policy in command.
pub type BeforeStep<'a> = dyn FnMut(&Environment) -> Result<(), RolloutError> + 'a;

/// Environment that waits before each control step.
pub struct Live<'a> {
    /// The environment.
    pub environment: Environment,
    before_step: Box<BeforeStep<'a>>,
    /// True if the wait for the next control step is over.
    is_due: bool,
    marks: Vec<Mark>,
}

impl<'a> Live<'a> {
    /// Robot in an environment with an episode in progress.
    pub fn new(environment: Environment, before_step: Box<BeforeStep<'a>>) -> Self {
        Self { environment, before_step, is_due: false, marks: Vec::new() }
    }

    /// Returns to the last marked moment that is at least `steps` control steps ago, or to the start of the episode;
    /// the number of the control step there.
    ///
    /// # Errors
    /// As [`Environment::rewind`].
    pub fn back(&mut self, steps: usize) -> Result<usize, RolloutError> {
        let wanted = self.environment.frames().len().saturating_sub(steps);
        let index = self.marks.iter().rposition(|mark| mark.step() <= wanted).unwrap_or(0);
        let Some(mark) = self.marks.get(index) else { return Ok(self.environment.frames().len()) };
        self.environment.rewind(mark)?;
        self.is_due = false;
        let step = mark.step();
        self.marks.truncate(index + 1);
        Ok(step)
    }

    fn wait(&mut self) -> Result<(), RolloutError> {
        let step = self.environment.frames().len();
        if step.is_multiple_of(MARK_EVERY) && self.marks.last().is_none_or(|mark| mark.step() < step) {
            self.marks.push(self.environment.mark()?);
        }
        (self.before_step)(&self.environment)
    }
}

impl RobotInterface for Live<'_> {
    fn steps_left(&self) -> usize {
        self.environment.steps_left()
    }

    fn frames(&self) -> &[Frame] {
        self.environment.frames()
    }

    fn observe(&mut self, cameras: &[CameraRequest]) -> Result<Observation, RolloutError> {
        // Input that arrives while it waits counts for this control step.
        if !self.is_due {
            self.wait()?;
            self.is_due = true;
        }
        self.environment.observe(cameras)
    }

    fn truth(&mut self) -> Result<PrivilegedState, RolloutError> {
        self.environment.truth()
    }

    fn command(&self) -> Result<Vec<f32>, RolloutError> {
        self.environment.command()
    }

    fn joint_positions(&self) -> Result<Vec<f64>, RolloutError> {
        self.environment.joint_positions()
    }

    fn step(&mut self, command: &[f32]) -> Result<Step, RolloutError> {
        // Later control steps of a chunk of actions.
        if !std::mem::take(&mut self.is_due) {
            self.wait()?;
        }
        self.environment.step(command)
    }

    fn count_unreachable(&mut self, reason: &str) -> Result<(), RolloutError> {
        self.environment.count_unreachable(reason)
    }

    fn drop_render_caches(&mut self) {
        self.environment.drop_render_caches();
    }
}
