//! Bridge without connection and clock: requests and measurements in, setpoints and states out.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::gripper::{GripperMonitor, GripperSettings};
use super::guard::{Command, Guard, GuardSettings, Mode, Refused, StopReason};
use super::interpolator::{JointLimits, JointState};
use super::message::{Motion, PROTOCOL, Recovery, Reply, Request, State, Welcome};

/// Function from joint positions to the position of the tool in the robot's base frame, m.
pub type ToolPosition = Arc<dyn Fn(&[f64]) -> [f64; 3] + Send + Sync>;

/// Facts about the robot behind a bridge.
#[derive(Clone)]
pub struct BridgeRobot {
    /// Name of the robot.
    pub name: String,
    /// Limits of the joints.
    pub joints: Vec<JointLimits>,
    /// Largest opening width of the gripper, m; 0 without one.
    pub max_width_m: f64,
    /// Position of the tool, for the workspace box.
    pub tool: ToolPosition,
}

/// Settings of a bridge.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BridgeSettings {
    /// Control period and time limits.
    pub guard: GuardSettings,
    /// Time limits and tolerances of gripper commands.
    pub gripper: GripperSettings,
    /// Largest share of the maximum speed that a client may ask for.
    pub top_speed: f64,
    /// Box that no client's workspace extends: two opposite corners, m, in the robot's base frame; `None` for none.
    pub workspace_m: Option<[[f64; 3]; 2]>,
    /// Time from an error of the arm to the attempt to clear it, s.
    pub recovery_after_s: f64,
    /// Number of attempts within a minute after which a person is needed.
    pub most_recoveries: usize,
}

impl Default for BridgeSettings {
    fn default() -> Self {
        Self {
            guard: GuardSettings::default(),
            gripper: GripperSettings::default(),
            top_speed: 1.0,
            workspace_m: None,
            // Chosen by hand: time for the arm to come to rest after a reflex.
            recovery_after_s: 0.5,
            most_recoveries: 3,
        }
    }
}

/// Time in which attempts at recovery are counted, s.
const RECOVERY_WINDOW_S: f64 = 60.0;
/// Largest number of lost control periods that the setpoints make up for; arms give up after fewer.
const MOST_MISSED: usize = 100;

/// Measurements of a control period.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Joint positions, rad or m.
    pub positions: Vec<f64>,
    /// Joint velocities, rad/s or m/s.
    pub velocities: Vec<f64>,
    /// Joint torques, N·m, or forces, N; empty if unknown.
    pub torques: Vec<f64>,
    /// Opening width of the gripper, m; `None` without one.
    pub width_m: Option<f64>,
    /// Error words while the arm refuses to move; empty otherwise.
    pub errors: Vec<String>,
    /// Positions that the arm's own controller holds, from which a motion has to start, rad or m; empty for the measured
    /// ones.
    pub held: Vec<f64>,
    /// Number of control periods since the last reading whose measurements were lost.
    pub missed: usize,
}

impl Reading {
    /// Positions from which a motion has to start, rad or m.
    fn start(&self) -> &[f64] {
        if self.held.is_empty() { &self.positions } else { &self.held }
    }
}

/// Orders to the arm for a control period.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Orders {
    /// Setpoints of the joints.
    pub setpoints: Vec<JointState>,
    /// True while the arm has to follow the setpoints; false while it stands, and may hold its position by itself.
    pub is_active: bool,
    /// New target width of the gripper, m; `None` for no new command.
    pub width_m: Option<f64>,
    /// True to clear the arm's errors.
    pub recover: bool,
}

/// Bridge between a policy and an arm.
pub struct Bridge {
    robot: BridgeRobot,
    settings: BridgeSettings,
    guard: Guard,
    gripper: GripperMonitor,
    /// Boxes that the tool must not leave: the bridge's and the client's.
    workspaces_m: Vec<[[f64; 3]; 2]>,
    reading: Reading,
    measured_s: f64,
    /// Time of the first of the present errors, s; `None` without errors.
    error_since_s: Option<f64>,
    /// Times of attempts at recovery within the window, s.
    recoveries_s: Vec<f64>,
}

impl Bridge {
    /// Bridge of an arm at rest; `None` if limits, measurements or settings are invalid.
    pub fn new(robot: BridgeRobot, settings: BridgeSettings, reading: Reading) -> Option<Self> {
        let guard = Guard::new(&robot.joints, reading.start(), settings.guard.clone())?;
        let gripper = GripperMonitor::new(robot.max_width_m, settings.gripper.clone());
        let is_sound = settings.top_speed > 0.0 && settings.top_speed <= 1.0;
        let workspaces_m = settings.workspace_m.into_iter().collect();
        is_sound.then(|| Self {
            robot,
            settings,
            guard,
            gripper,
            workspaces_m,
            reading,
            measured_s: 0.0,
            error_since_s: None,
            recoveries_s: Vec::new(),
        })
    }

    /// Facts for a client.
    pub fn welcome(&self, cameras: Vec<String>) -> Welcome {
        Welcome {
            protocol: PROTOCOL.into(),
            robot: self.robot.name.clone(),
            joints: self.robot.joints.clone(),
            max_width_m: self.robot.max_width_m,
            tick_s: self.settings.guard.tick_s,
            longest_validity_s: self.settings.guard.longest_validity_s,
            lease_s: self.settings.guard.lease_s,
            top_speed: self.settings.top_speed,
            cameras,
        }
    }

    /// Processes a request about the arm at `now_s`; returns the reply, if it has one.
    pub fn handle(&mut self, now_s: f64, request: &Request) -> Option<Reply> {
        let answer = match request {
            Request::Acquire {} => self.guard.acquire(now_s).map(|lease| Some(Reply::Lease { lease })),
            Request::Start { lease, dead_man, speed, workspace_m } => self
                .start(now_s, *lease, *dead_man, *speed, *workspace_m)
                .map(|()| Some(Reply::Started { time_s: now_s })),
            Request::Command(command) => self.command(now_s, command).map(|()| None),
            Request::Release { lease, keep } => {
                self.guard.release(now_s, *lease, *keep).map(|()| Some(Reply::Released))
            }
            Request::Hello { .. } | Request::Image { .. } => Ok(None),
        };
        answer.unwrap_or_else(|why| Some(Reply::refusal(request, &why)))
    }

    fn start(
        &mut self,
        now_s: f64,
        lease: u64,
        dead_man: bool,
        speed: f64,
        workspace_m: Option<[[f64; 3]; 2]>,
    ) -> Result<(), Refused> {
        let most = self.settings.top_speed;
        if !(speed > 0.0 && speed <= most) {
            return Err(Refused::Speed { got: speed, most });
        }
        if !self.reading.errors.is_empty() {
            return Err(Refused::ArmErrors(self.reading.errors.clone()));
        }
        self.guard.start(now_s, lease, dead_man, self.reading.start())?;
        self.guard.limit_speed(speed);
        self.workspaces_m = self.settings.workspace_m.into_iter().chain(workspace_m).collect();
        Ok(())
    }

    fn command(&mut self, now_s: f64, command: &Command) -> Result<(), Refused> {
        let is_sound = command.positions.len() == self.robot.joints.len()
            && command.positions.iter().all(|position| position.is_finite());
        let tool = is_sound.then(|| (self.robot.tool)(&command.positions));
        let refused = match tool.filter(|at| self.excess_m(at) > 0.0) {
            Some(at) => Some(Refused::Workspace(at)),
            None if command.width_m.is_some_and(|width_m| !width_m.is_finite()) => Some(Refused::Width),
            None => None,
        };
        let Some(why) = refused else {
            self.guard.command(now_s, command)?;
            command.width_m.into_iter().for_each(|width_m| self.gripper.want(width_m));
            return Ok(());
        };
        // Without positions the guard counts the command and renews the lease, but keeps the target.
        match self.guard.command(now_s, &Command { positions: Vec::new(), ..command.clone() }) {
            Err(Refused::Positions { .. }) | Ok(()) => Err(why),
            Err(other) => Err(other),
        }
    }

    /// Time between setpoints, s.
    pub fn tick_s(&self) -> f64 {
        self.settings.guard.tick_s
    }

    /// True if all setpoints are at rest.
    pub fn is_at_rest(&self) -> bool {
        self.guard.is_at_rest()
    }

    /// Brakes because the bridge ends; nobody holds a lease afterwards.
    pub fn close(&mut self, now_s: f64) {
        if let Some((lease, _)) = self.guard.lease() {
            self.disconnected(now_s, lease);
        }
    }

    /// Brakes because the connection of the holder of the lease is lost, and returns the lease.
    pub fn disconnected(&mut self, now_s: f64, lease: u64) {
        // A lease that has ended already needs no return.
        let _ = self.guard.release(now_s, lease, false);
    }

    /// Advances by one control period with its measurements; returns the orders to the arm.
    pub fn tick(&mut self, now_s: f64, reading: Reading) -> Orders {
        self.reading = reading;
        self.measured_s = now_s;
        let recover = self.recover(now_s);
        if self.guard.mode() == Mode::Following && !self.workspaces_m.is_empty() {
            let now_m = self.excess_m(&(self.robot.tool)(&self.setpoints()));
            let stop_m = self.excess_m(&(self.robot.tool)(&self.guard.stop_positions()));
            if stop_m > 0.0 && stop_m > now_m + 1e-6 {
                self.guard.leave_workspace();
            }
        }
        // The arm's clock went on while measurements were lost, and so must the setpoints.
        for _ in 0..self.reading.missed.min(MOST_MISSED) {
            self.guard.tick(now_s);
        }
        let setpoints = self.guard.tick(now_s).to_vec();
        let is_active = self.guard.mode() == Mode::Following || !self.guard.is_at_rest();
        let width_m = self.reading.width_m.and_then(|measured_m| self.gripper.tick(now_s, measured_m));
        Orders { setpoints, is_active, width_m, recover }
    }

    /// Stops at errors of the arm; true if they are to be cleared now.
    fn recover(&mut self, now_s: f64) -> bool {
        if self.reading.errors.is_empty() {
            self.error_since_s = None;
            return false;
        }
        if self.guard.mode() != Mode::Stopping(StopReason::Arm) {
            self.guard.arm_stopped(self.reading.start());
        }
        let since_s = *self.error_since_s.get_or_insert(now_s);
        self.recoveries_s.retain(|at_s| now_s - at_s < RECOVERY_WINDOW_S);
        let is_due = now_s - since_s >= self.settings.recovery_after_s;
        if !is_due || self.recoveries_s.len() >= self.settings.most_recoveries {
            return false;
        }
        self.recoveries_s.push(now_s);
        self.error_since_s = Some(now_s);
        true
    }

    /// State to be sent at `now_s`.
    pub fn state(&self, now_s: f64) -> State {
        let (motion, reason) = match self.guard.mode() {
            Mode::Following => (Motion::Following, None),
            Mode::Stopping(reason) if self.guard.is_at_rest() => (Motion::Standing, Some(reason)),
            Mode::Stopping(reason) => (Motion::Braking, Some(reason)),
        };
        let recovery = match self.error_since_s {
            None => Recovery::None,
            Some(_) if self.recoveries_s.len() >= self.settings.most_recoveries => Recovery::GivenUp,
            Some(_) => Recovery::Recovering,
        };
        let lease = self.guard.lease();
        State {
            time_s: now_s,
            measured_s: self.measured_s,
            motion,
            reason,
            errors: self.reading.errors.clone(),
            recovery,
            lease: lease.map(|(id, _)| id),
            sequence: lease.and_then(|(_, sequence)| sequence),
            positions: self.reading.positions.clone(),
            velocities: self.reading.velocities.clone(),
            torques: self.reading.torques.clone(),
            setpoints: self.setpoints(),
            gripper: self.reading.width_m.map(|width_m| self.gripper.state(width_m)),
        }
    }

    /// Setpoints of the joints, rad or m.
    fn setpoints(&self) -> Vec<f64> {
        self.guard.joints().iter().map(|joint| joint.position).collect()
    }

    /// Distance by which a point is outside of a workspace box, m; 0 inside of all.
    fn excess_m(&self, point: &[f64; 3]) -> f64 {
        self.workspaces_m.iter().map(|workspace| beyond_m(workspace, point)).fold(0.0, f64::max)
    }
}

/// Largest distance along an axis by which a point is outside of a box with two opposite corners, m; 0 inside.
pub fn beyond_m([a, b]: &[[f64; 3]; 2], point: &[f64; 3]) -> f64 {
    let beyond = (0..3).map(|axis| {
        let (lower, upper) = (a[axis].min(b[axis]), a[axis].max(b[axis]));
        (lower - point[axis]).max(point[axis] - upper)
    });
    beyond.fold(0.0, f64::max)
}

impl std::fmt::Debug for Bridge {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bridge").field("robot", &self.robot.name).field("guard", &self.guard).finish_non_exhaustive()
    }
}
