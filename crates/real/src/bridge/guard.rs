//! Guard that decides whether the arm may move: lease, sequence number, deadline, dead-man's switch. A pure state
//! machine: time is an argument.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::interpolator::{Interpolator, JointLimits, JointState};

/// Control period and time limits of a guard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GuardSettings {
    /// Time between setpoints (control period), s.
    pub tick_s: f64,
    /// Maximum validity of a command, s.
    pub longest_validity_s: f64,
    /// Time after the holder's last acquisition, start or command at which the lease ends, s.
    pub lease_s: f64,
}

impl Default for GuardSettings {
    fn default() -> Self {
        Self {
            // 1 kHz is the rate of Franka's control interface; other arms are slower.
            tick_s: 1e-3,
            // Chosen by hand: three chunks of a policy that answers every 0.3 s; the arm moves on for no longer than this.
            longest_validity_s: 1.0,
            lease_s: 10.0,
        }
    }
}

/// Command of the holder of the lease.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Command {
    /// Number of the lease under which the command is sent.
    pub lease: u64,
    /// Sequence number; strictly increasing within a lease.
    pub sequence: u64,
    /// Time after reception for which the command is valid, s.
    pub valid_for_s: f64,
    /// True while a person holds the dead-man's switch.
    pub dead_man: bool,
    /// Target joint positions, rad or m.
    pub positions: Vec<f64>,
    /// Time in which the reference moves to these positions at constant velocity, s; 0 for at once. A stream of commands
    /// gives smooth motion if this is somewhat longer than the time between them.
    #[serde(default)]
    pub over_s: f64,
    /// Target opening width of the gripper, m; absent to leave it as it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width_m: Option<f64>,
}

/// Reason why a command or a request is refused.
///
/// A refusal never changes the target. A command under the lease in force with a new sequence number uses up that number
/// and renews the lease, even if it is refused for another reason.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Refused {
    /// Another holder has the lease.
    #[error("the lease is held by another; it ends {after_s:.1} s after the holder's last command")]
    Leased {
        /// Time until it ends, s.
        after_s: f64,
    },
    /// Unknown or ended lease, by number.
    #[error("the lease {0} is not in force; acquire one")]
    NoLease(u64),
    /// A command that is older than the last one.
    #[error("command {got} came after {last}: late or sent twice")]
    Sequence {
        /// Sequence number of the command.
        got: u64,
        /// Largest sequence number so far.
        last: u64,
    },
    /// Positions of wrong number, or not finite.
    #[error("expected {expected} finite positions")]
    Positions {
        /// Number of joints of the arm.
        expected: usize,
    },
    /// The command's validity is not positive or exceeds the maximum.
    #[error("valid for {got} s; expected more than 0 and at most {most}")]
    Validity {
        /// Validity of the command, s.
        got: f64,
        /// Maximum validity, s.
        most: f64,
    },
    /// The time to reach the positions is negative or exceeds the maximum.
    #[error("positions over {got} s; expected 0 to {most}")]
    Over {
        /// Time of the command, s.
        got: f64,
        /// Maximum time, s.
        most: f64,
    },
    /// The arm brakes or has stopped; call [`Guard::start`] first.
    #[error("the arm has stopped ({0:?}); start it again once the reason is gone")]
    Stopped(StopReason),
    /// The dead-man's switch is not held.
    #[error("the dead-man's switch is not held")]
    DeadMan,
    /// The arm is still moving.
    #[error("the arm still moves; wait until it stands")]
    Moving,
    /// The tool would leave the workspace box.
    #[error("the tool would leave the workspace box, at {0:.3?} m in the robot's base frame")]
    Workspace([f64; 3]),
    /// The share of the speed is not valid.
    #[error("speed {got}; expected a share above 0 and at most {most}")]
    Speed {
        /// Share of the request.
        got: f64,
        /// Largest share that the bridge allows.
        most: f64,
    },
    /// The arm reports errors.
    #[error("the arm reports {}; it is recovered first", .0.join(", "))]
    ArmErrors(Vec<String>),
    /// The width of the gripper is not a number.
    #[error("expected a finite width of the gripper")]
    Width,
    /// The request cannot be read.
    #[error("{0}")]
    Malformed(String),
}

impl Refused {
    /// Word of the refusal in the protocol.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Leased { .. } => "leased",
            Self::NoLease(_) => "no_lease",
            Self::Sequence { .. } => "sequence",
            Self::Positions { .. } => "positions",
            Self::Validity { .. } => "validity",
            Self::Over { .. } => "over",
            Self::Stopped(_) => "stopped",
            Self::DeadMan => "dead_man",
            Self::Moving => "moving",
            Self::Workspace(_) => "workspace",
            Self::Speed { .. } => "speed",
            Self::ArmErrors(_) => "arm_errors",
            Self::Width => "width",
            Self::Malformed(_) => "malformed",
        }
    }
}

/// Reason why the arm brakes or stands still.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// [`Guard::start`] was not called yet.
    NotStarted,
    /// No command came before the deadline of the last one.
    Deadline,
    /// The dead-man's switch was released.
    DeadMan,
    /// The holder returned the lease, or requested a stop.
    Released,
    /// The arm itself reported an error, such as a reflex triggered by a collision.
    Arm,
    /// The tool was about to leave the workspace box.
    Workspace,
}

/// Operating mode of a guard.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The arm follows commands.
    Following,
    /// The arm brakes, or stands still after braking.
    Stopping(StopReason),
}

/// Guard in front of an interpolator.
#[derive(Clone, Debug, PartialEq)]
pub struct Guard {
    settings: GuardSettings,
    interpolator: Interpolator,
    mode: Mode,
    lease: Option<Lease>,
    next_lease: u64,
}

/// Lease in force, with the state of its commands.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Lease {
    id: u64,
    /// Time of the holder's last message, s.
    seen_s: f64,
    last_sequence: Option<u64>,
    /// Time at which the last command expires, s.
    deadline_s: f64,
}

impl Guard {
    /// Guard of an arm at rest at the measured positions; `None` under the conditions of [`Interpolator::new`].
    pub fn new(limits: &[JointLimits], measured: &[f64], settings: GuardSettings) -> Option<Self> {
        let interpolator = Interpolator::new(limits, measured, settings.tick_s)?;
        let mode = Mode::Stopping(StopReason::NotStarted);
        Some(Self { settings, interpolator, mode, lease: None, next_lease: 1 })
    }

    /// Current operating mode.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Current setpoints of all joints.
    pub fn joints(&self) -> &[JointState] {
        self.interpolator.joints()
    }

    /// True if all setpoints are at rest.
    pub fn is_at_rest(&self) -> bool {
        self.interpolator.is_at_rest()
    }

    /// Acquires the lease if nobody holds it; returns its number.
    ///
    /// # Errors
    /// [`Refused::Leased`].
    pub fn acquire(&mut self, now_s: f64) -> Result<u64, Refused> {
        if let Some(lease) = &self.lease {
            let after_s = lease.seen_s + self.settings.lease_s - now_s;
            if after_s > 0.0 {
                return Err(Refused::Leased { after_s });
            }
        }
        // The previous holder may have left the arm moving: brake.
        if self.mode == Mode::Following {
            self.stop(StopReason::Released);
        }
        let id = self.next_lease;
        self.next_lease += 1;
        self.lease = Some(Lease { id, seen_s: now_s, last_sequence: None, deadline_s: now_s });
        Ok(id)
    }

    /// Starts, or starts again after a stop, from the current position; the first command must follow within
    /// `longest_validity_s`. At the first start and after an error of the arm itself, the setpoints become `measured`.
    ///
    /// # Errors
    /// [`Refused`] if the lease is not in force, the arm is moving, the dead-man's switch is not held, or `measured` is not
    /// one finite position per joint.
    pub fn start(&mut self, now_s: f64, lease: u64, dead_man: bool, measured: &[f64]) -> Result<(), Refused> {
        let is_moving = !self.is_at_rest();
        let most = self.settings.longest_validity_s;
        let expected = self.joints().len();
        let held = self.held(now_s, lease)?;
        if is_moving {
            return Err(Refused::Moving);
        }
        if !dead_man {
            return Err(Refused::DeadMan);
        }
        if measured.len() != expected || !measured.iter().all(|position| position.is_finite()) {
            return Err(Refused::Positions { expected });
        }
        held.deadline_s = now_s + most;
        held.seen_s = now_s;
        let was_off = matches!(self.mode, Mode::Stopping(StopReason::NotStarted | StopReason::Arm));
        if was_off {
            self.interpolator.place(measured);
        }
        self.interpolator.hold();
        self.mode = Mode::Following;
        Ok(())
    }

    /// Checks a command and passes it to the interpolator.
    ///
    /// # Errors
    /// [`Refused`]; a released dead-man's switch also stops the arm.
    pub fn command(&mut self, now_s: f64, command: &Command) -> Result<(), Refused> {
        self.expire(now_s);
        let (most, expected, mode) = (self.settings.longest_validity_s, self.joints().len(), self.mode);
        let held = self.held(now_s, command.lease)?;
        if let Some(last) = held.last_sequence.filter(|last| command.sequence <= *last) {
            return Err(Refused::Sequence { got: command.sequence, last });
        }
        held.last_sequence = Some(command.sequence);
        held.seen_s = now_s;
        if !command.dead_man {
            if mode == Mode::Following {
                self.stop(StopReason::DeadMan);
            }
            return Err(Refused::DeadMan);
        }
        if let Mode::Stopping(reason) = mode {
            return Err(Refused::Stopped(reason));
        }
        if !(command.valid_for_s > 0.0 && command.valid_for_s <= most) {
            return Err(Refused::Validity { got: command.valid_for_s, most });
        }
        if !(0.0..=most).contains(&command.over_s) {
            return Err(Refused::Over { got: command.over_s, most });
        }
        if command.positions.len() != expected || !command.positions.iter().all(|position| position.is_finite()) {
            return Err(Refused::Positions { expected });
        }
        held.deadline_s = now_s + command.valid_for_s;
        self.interpolator.aim(&command.positions, command.over_s);
        Ok(())
    }

    /// Returns the lease, or keeps it if `is_kept`; in both cases the arm brakes.
    ///
    /// # Errors
    /// [`Refused::NoLease`].
    pub fn release(&mut self, now_s: f64, lease: u64, is_kept: bool) -> Result<(), Refused> {
        self.held(now_s, lease)?;
        if !is_kept {
            self.lease = None;
        }
        if self.mode == Mode::Following {
            self.stop(StopReason::Released);
        }
        Ok(())
    }

    /// Reports that the arm has stopped by itself: the setpoints are set to the measured positions.
    pub fn arm_stopped(&mut self, measured: &[f64]) {
        if measured.iter().all(|position| position.is_finite()) {
            self.interpolator.place(measured);
        }
        self.stop(StopReason::Arm);
    }

    /// Brakes because the tool is about to leave the workspace box.
    pub fn leave_workspace(&mut self) {
        self.stop(StopReason::Workspace);
    }

    /// Number of the lease in force and the holder's last sequence number; `None` without a lease.
    pub fn lease(&self) -> Option<(u64, Option<u64>)> {
        self.lease.map(|lease| (lease.id, lease.last_sequence))
    }

    /// Positions at which the joints come to rest if they brake now, rad or m.
    pub fn stop_positions(&self) -> Vec<f64> {
        self.interpolator.stop_positions()
    }

    /// Limits the velocity to a share of the maximum, see [`Interpolator::limit_speed`].
    pub fn limit_speed(&mut self, share: f64) -> bool {
        self.interpolator.limit_speed(share)
    }

    /// Settings of the guard.
    pub fn settings(&self) -> &GuardSettings {
        &self.settings
    }

    /// Advances the setpoints by one tick, braking if the deadline has passed at `now_s`; to be called and sent every
    /// `tick_s`.
    pub fn tick(&mut self, now_s: f64) -> &[JointState] {
        self.expire(now_s);
        self.interpolator.tick()
    }

    /// Stops the arm if it follows commands and the deadline of the last one has passed, or nobody holds the lease.
    fn expire(&mut self, now_s: f64) {
        let is_late = self.lease.is_none_or(|lease| now_s > lease.deadline_s);
        if self.mode == Mode::Following && is_late {
            self.stop(StopReason::Deadline);
        }
    }

    fn stop(&mut self, reason: StopReason) {
        self.mode = Mode::Stopping(reason);
        self.interpolator.brake();
    }

    fn held(&mut self, now_s: f64, id: u64) -> Result<&mut Lease, Refused> {
        let longest_s = self.settings.lease_s;
        let lease = self.lease.as_mut().filter(|lease| lease.id == id && now_s <= lease.seen_s + longest_s);
        lease.ok_or(Refused::NoLease(id))
    }
}
