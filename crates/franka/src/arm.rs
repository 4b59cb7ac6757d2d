//! Arm behind the control interface: one state and one setpoint per millisecond.

use std::collections::BTreeMap;

use franka::{
    ActiveMotionGenerator, ControlException, FrankaError, JointPositions, MoveControllerMode, Robot, RobotMode,
    RobotState,
};
use genmanip_real::bridge::{Driver, DriverError, Orders, Reading};

use crate::hand::Hand;

/// Number of joints of a Franka arm.
pub const JOINTS: usize = 7;
/// Control periods at rest after which the motion ends and the arm holds its position by itself.
const LINGER_TICKS: usize = 200;
/// Error word while the connection to the gripper is lost.
const GRIPPER_LOST: &str = "gripper_lost";

/// Counts of events on the control interface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ArmReport {
    /// Number of motions, from standstill to standstill.
    pub motions: usize,
    /// Number of setpoints sent.
    pub setpoints: usize,
    /// Number of states that were lost or came too late during motions.
    pub missed: usize,
    /// Most of them in a row.
    pub most_missed: usize,
    /// Number of motions that the arm aborted, by error word.
    pub aborts: BTreeMap<String, usize>,
    /// Number of recoveries that succeeded.
    pub recoveries: usize,
}

/// Franka arm, with or without its hand.
pub struct FrankaArm<'a> {
    robot: &'a Robot,
    hand: Option<Hand>,
    motion: Option<ActiveMotionGenerator<'a, JointPositions>>,
    /// Time of the last state of the motion on the arm's clock, ms; `None` before the first.
    last_ms: Option<u64>,
    /// Control periods of the motion at rest.
    resting: usize,
    /// Error words of the motion that was aborted, until recovery.
    aborted: Vec<String>,
    /// True if the arm itself waits for recovery.
    has_reflex: bool,
    report: ArmReport,
}

impl<'a> FrankaArm<'a> {
    /// Arm at rest.
    pub fn new(robot: &'a Robot, hand: Option<Hand>) -> Self {
        Self {
            robot,
            hand,
            motion: None,
            last_ms: None,
            resting: 0,
            aborted: Vec::new(),
            has_reflex: false,
            report: ArmReport::default(),
        }
    }

    /// Position of the end effector in the arm's base frame as the arm reports it, m.
    ///
    /// # Errors
    /// If the connection is lost.
    pub fn end_effector(&self) -> Result<[f64; 3], FrankaError> {
        let pose = self.robot.read_once()?.O_T_EE;
        Ok([pose[12], pose[13], pose[14]])
    }

    /// Counts so far.
    pub fn report(&self) -> &ArmReport {
        &self.report
    }

    /// Next state of the arm; aborted motions are noted.
    fn state(&mut self) -> Result<RobotState, DriverError> {
        if let Some(motion) = &mut self.motion {
            match motion.read_once() {
                Ok((state, _)) => return Ok(state),
                Err(error) => self.end(error)?,
            }
        }
        self.robot.read_once().map_err(lost)
    }

    /// Notes the error that ended the motion, unless the connection is lost.
    fn end(&mut self, error: FrankaError) -> Result<(), DriverError> {
        let FrankaError::Control(exception) = error else { return Err(lost(error)) };
        self.aborted = words(&exception);
        for word in &self.aborted {
            *self.report.aborts.entry(word.clone()).or_default() += 1;
        }
        self.motion = None;
        Ok(())
    }

    /// Error words of a state and of what happened before it.
    fn errors(&self, state: &RobotState) -> Vec<String> {
        let mut errors: Vec<String> = state.current_errors.names().into_iter().map(Into::into).collect();
        let mode = match state.robot_mode {
            RobotMode::Reflex if errors.is_empty() => Some("reflex"),
            RobotMode::UserStopped => Some("user_stopped"),
            RobotMode::Guiding => Some("guiding"),
            RobotMode::AutomaticErrorRecovery => Some("recovering"),
            RobotMode::Other => Some("not_ready"),
            RobotMode::Reflex | RobotMode::Idle | RobotMode::Move => None,
        };
        errors.extend(mode.map(Into::into));
        errors.extend(self.aborted.iter().filter(|word| !errors.contains(word)).cloned().collect::<Vec<_>>());
        errors.extend(self.hand.as_ref().filter(|hand| hand.is_lost()).map(|_| GRIPPER_LOST.into()));
        errors
    }

    /// Control periods between the last state of the motion and this one that had none.
    fn missed(&mut self, state: &RobotState) -> usize {
        let now_ms = state.time.as_millis();
        let before_ms = self.motion.is_some().then(|| self.last_ms.replace(now_ms)).flatten();
        let missed = before_ms.map_or(0, |before_ms| now_ms.saturating_sub(before_ms + 1) as usize);
        self.report.missed += missed;
        self.report.most_missed = self.report.most_missed.max(missed);
        missed
    }

    /// Clears the errors of the arm, and connects to the gripper again if needed; the next reading says whether it helped.
    fn recover(&mut self) -> Result<(), DriverError> {
        self.motion = None;
        if let Some(hand) = self.hand.as_mut().filter(|hand| hand.is_lost()) {
            // The error stays if nothing answers.
            let _ = hand.reconnect();
        }
        if self.has_reflex {
            match self.robot.automatic_error_recovery() {
                Ok(()) => self.report.recoveries += 1,
                // A person is needed, such as to release the user stop: the error stays.
                Err(FrankaError::Command(_)) => return Ok(()),
                Err(error) => return Err(lost(error)),
            }
        }
        self.aborted.clear();
        Ok(())
    }

    /// Sends setpoints; begins a motion if there is none, and ends it once the setpoints have been at rest.
    fn follow(&mut self, positions: [f64; JOINTS], is_active: bool) -> Result<(), FrankaError> {
        self.resting = if is_active { 0 } else { self.resting + 1 };
        if self.motion.is_none() {
            if !is_active {
                return Ok(());
            }
            self.motion = Some(self.robot.start_joint_position_control(MoveControllerMode::JointImpedance)?);
            self.last_ms = None;
            self.report.motions += 1;
        }
        let Some(motion) = &mut self.motion else { return Ok(()) };
        let mut setpoint = JointPositions::new(positions);
        setpoint.motion_finished = self.resting >= LINGER_TICKS;
        motion.write_once(&setpoint, None)?;
        self.report.setpoints += 1;
        if setpoint.motion_finished {
            self.motion = None;
        }
        Ok(())
    }
}

impl Driver for FrankaArm<'_> {
    fn read(&mut self) -> Result<Reading, DriverError> {
        let state = self.state()?;
        self.has_reflex = state.robot_mode == RobotMode::Reflex || state.current_errors.any();
        Ok(Reading {
            positions: state.q.to_vec(),
            velocities: state.dq.to_vec(),
            torques: state.tau_J.to_vec(),
            width_m: self.hand.as_ref().map(Hand::width_m),
            errors: self.errors(&state),
            held: state.q_d.to_vec(),
            missed: self.missed(&state),
        })
    }

    fn write(&mut self, orders: &Orders) -> Result<(), DriverError> {
        if let Some(hand) = &mut self.hand {
            hand.tick(orders.width_m);
        }
        if orders.recover {
            return self.recover();
        }
        let mut positions = [0.0; JOINTS];
        if orders.setpoints.len() != JOINTS {
            return Err(DriverError(format!("a Franka arm has {JOINTS} joints, not {}", orders.setpoints.len())));
        }
        positions.iter_mut().zip(&orders.setpoints).for_each(|(position, joint)| *position = joint.position);
        if self.aborted.is_empty() && !self.has_reflex {
            self.follow(positions, orders.is_active).or_else(|error| self.end(error))?;
        }
        Ok(())
    }
}

impl std::fmt::Debug for FrankaArm<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FrankaArm").field("hand", &self.hand).field("report", &self.report).finish_non_exhaustive()
    }
}

fn lost(error: FrankaError) -> DriverError {
    DriverError(format!("the connection to the arm is lost: {error}"))
}

/// Error words of an aborted motion: the arm's own, or the state of its command such as `preempted`.
fn words(exception: &ControlException) -> Vec<String> {
    let names = exception.last_motion_errors.names();
    if !names.is_empty() {
        return names.into_iter().map(Into::into).collect();
    }
    let status = exception.move_status.map_or("motion_refused".to_owned(), |status| {
        let mut word = String::new();
        for letter in format!("{status:?}").chars() {
            if letter.is_uppercase() && !word.is_empty() {
                word.push('_');
            }
            word.push(letter.to_ascii_lowercase());
        }
        word
    });
    vec![status]
}
