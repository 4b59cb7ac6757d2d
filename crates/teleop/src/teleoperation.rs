//! Teleoperation as a policy: the operator is one more policy in the ordinary episode loop.

use std::collections::BTreeSet;
use std::sync::Arc;

use genmanip_core::{
    ActionChunk, ActionSpace, ActionSpec, CameraMount, EpisodeStart, GripperEncoding, Observation, Policy, PolicyError,
    PolicySpec, Pose, RobotModel, World,
};
use genmanip_motion::{Chain, IkSettings, InverseKinematics};

use crate::device::{Decoder, DeviceEvent, Goal};
use crate::follow::{Follow, FollowSettings};
use crate::mapping::{Axes, Mapping, MappingSettings, OperatorFrame, Twist};
use crate::record::{Hold, InputSettings, Intervals, OperatorRecord, RecordedEvent};
use crate::source::Source;
use crate::target::{Limit, Target, TargetSettings};

/// Deviation of the pose in force from the commanded one that rounding to single precision explains, m and rad.
const ROUNDING: f64 = 1e-5;
/// Distance from a joint limit below which the limit is reported as the reason why the tool does not follow, rad.
const JOINT_MARGIN_RAD: f64 = 0.03;
/// Difference between measured and commanded opening above which the fingers press on something, m.
const PRESSED_M: f64 = 0.003;
/// Manipulability below which a singularity is reported as the reason; at the arm's home it is several times larger.
const SINGULAR: f64 = 0.02;

/// Settings of teleoperation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TeleopSettings {
    /// Mapping from device axes to a twist.
    pub mapping: MappingSettings,
    /// Limits of the commanded pose.
    pub target: TargetSettings,
    /// Timeouts of the events, and limits of the gripper.
    pub input: InputSettings,
    /// Speeds and tolerances of following leader arms and trackers.
    pub follow: FollowSettings,
    /// Name of the camera of [`OperatorFrame::Camera`]; without it that frame is skipped.
    pub camera: Option<String>,
}

/// State of the teleoperation after a control step, for display.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Status {
    /// Frame in use.
    pub frame: OperatorFrame,
    /// Reason why the deflected device does not move the arm; `None` if it does or is not deflected.
    pub held: Option<Hold>,
    /// Limits that slow the tool.
    pub limits: Vec<Limit>,
    /// True if the gripper is commanded to close.
    pub closed: bool,
}

/// Policy that is driven by an operator at a device.
///
/// Each control step takes all events since the last one and returns one commanded pose; its conversion to joint
/// commands is the same as for any policy with the action space `ee_pose`, null-space posture included.
pub struct Teleoperation {
    settings: TeleopSettings,
    source: Box<dyn Source>,
    robot: Arc<RobotModel>,
    chain: Chain,
    kinematics: InverseKinematics,
    /// Largest motion of each joint in a control step, rad.
    reach: Vec<f64>,
    rate_hz: f64,
    camera: Option<Axes>,
    report: Option<Report>,
    first_step: usize,
    episode: EpisodeState,
}

/// Callback with the status after each control step.
type Report = Box<dyn FnMut(&Status) + Send>;

/// State of one episode.
struct EpisodeState {
    decoder: Decoder,
    mapping: Mapping,
    target: Option<Target>,
    follow: Follow,
    /// State of a stream's gripper in the control step before; `None` without one.
    was_closed: Option<bool>,
    /// Commanded gripper opening, m; `None` before the first control step.
    width_m: Option<f64>,
    /// Opening (m) that is kept until the operator uses the gripper, with the state of the gripper that it counts as;
    /// `None` if the gripper was fully open when the operator took command.
    kept_width_m: Option<(f64, bool)>,
    step: usize,
    /// Control step in which the last event was received.
    last_event: usize,
    /// True from [`DeviceEvent::Silent`] to the next event of the device.
    is_silent: bool,
    status: Status,
    events: Vec<RecordedEvent>,
    refused: u64,
    frames: Vec<(usize, OperatorFrame)>,
    idle: Intervals<()>,
    held: Intervals<Hold>,
    limited: Intervals<Limit>,
}

impl EpisodeState {
    fn new(mapping: Mapping, first_step: usize) -> Self {
        Self {
            decoder: Decoder::default(),
            mapping,
            target: None,
            follow: Follow::default(),
            was_closed: None,
            width_m: None,
            kept_width_m: None,
            step: first_step,
            last_event: first_step,
            is_silent: false,
            status: Status::default(),
            events: Vec::new(),
            refused: 0,
            frames: Vec::new(),
            idle: Intervals::new(),
            held: Intervals::new(),
            limited: Intervals::new(),
        }
    }

    /// Receives events. More than `most` count as a broken connection: the surplus is dropped, keys are released, and
    /// the device has to be released before it moves the arm again.
    fn receive(&mut self, events: Vec<DeviceEvent>, most: usize) {
        let mut events = events.into_iter();
        for event in events.by_ref().take(most) {
            self.apply(event);
        }
        let surplus = events.len();
        if let Some(event) = events.next() {
            // Recorded without effect, so that a replay has too many as well.
            self.add(event);
            self.refused += surplus as u64;
            self.decoder.release_keys();
            self.mapping.require_release();
        }
    }

    fn apply(&mut self, event: DeviceEvent) {
        if matches!(event, DeviceEvent::Connected { .. } | DeviceEvent::Disconnected) {
            self.mapping.require_release();
        }
        match self.decoder.apply(&event) {
            Ok(()) if self.decoder.is_alive_after(&event) => {
                self.last_event = self.step;
                self.is_silent = false;
            }
            Ok(()) => self.is_silent |= event == DeviceEvent::Silent,
            Err(_) => self.refused += 1,
        }
        self.add(event);
    }

    /// Records an event.
    fn add(&mut self, event: DeviceEvent) {
        self.events.push(RecordedEvent { sequence: self.events.len() as u64, step: self.step, event });
    }
}

impl Teleoperation {
    /// Teleoperation of `robot` in `world`, driven by the events of `source`.
    ///
    /// # Errors
    /// If the robot has no kinematics, or the world has no camera of the name in the settings; the message lists those
    /// it has.
    pub fn new(
        settings: TeleopSettings,
        source: Box<dyn Source>,
        robot: &Arc<RobotModel>,
        world: &World,
    ) -> Result<Self, String> {
        let camera = settings.camera.as_ref().map(|name| camera_axes(name, robot, world)).transpose()?;
        let chain = Chain::new(robot).map_err(|error| error.to_string())?;
        let rate_hz = f64::from(world.physics.control_rate_hz);
        Ok(Self {
            episode: EpisodeState::new(Mapping::new(settings.mapping.clone(), camera), 0),
            first_step: 0,
            settings,
            source,
            robot: Arc::clone(robot),
            kinematics: InverseKinematics::new(chain.clone(), IkSettings::default()),
            chain,
            reach: robot.arm_joints().map(|joint| joint.max_velocity / rate_hz).collect(),
            rate_hz,
            camera,
            report: None,
        })
    }

    /// Calls `report` with the status after each control step.
    #[must_use]
    pub fn reporting_to(mut self, report: impl FnMut(&Status) + Send + 'static) -> Self {
        self.report = Some(Box::new(report));
        self
    }

    /// Counts control steps from `step` on instead of 0: the operator takes command in mid-episode. The gripper keeps its
    /// opening until the operator uses it, and the device has to be released first.
    #[must_use]
    pub fn starting_at(mut self, step: usize) -> Self {
        self.first_step = step;
        self.episode = EpisodeState::new(Mapping::new(self.settings.mapping.clone(), self.camera), step);
        self
    }

    /// Frame in use.
    pub fn frame(&self) -> OperatorFrame {
        self.episode.mapping.frame()
    }

    /// State after the last control step.
    pub fn status(&self) -> &Status {
        &self.episode.status
    }

    /// Events received in the episode so far.
    pub fn events(&self) -> &[RecordedEvent] {
        &self.episode.events
    }

    /// Record of the episode so far.
    pub fn record(&self) -> OperatorRecord {
        let EpisodeState { events, refused, frames, idle, held, limited, step, .. } = &self.episode;
        let devices = events.iter().filter_map(|event| match &event.event {
            DeviceEvent::Connected { device } => Some(device.clone()),
            _ => None,
        });
        OperatorRecord {
            operator: self.source.operator(),
            devices: devices.collect(),
            mapping: self.settings.mapping.clone(),
            camera: self.settings.camera.clone(),
            target: self.settings.target.clone(),
            input: self.settings.input.clone(),
            follow: self.settings.follow.clone(),
            events: events.len() as u64,
            refused: *refused,
            frames: frames.clone(),
            idle: idle.until(*step),
            held: held.until(*step),
            limited: limited.until(*step),
            in_command: Vec::new(),
            undone: Vec::new(),
            trimmed: [0; 2],
        }
    }

    /// Likely reasons why the arm cannot follow from the joint positions `arm` (rad): a joint limit, a singularity,
    /// both or none.
    fn reasons(&self, arm: &[f64]) -> impl Iterator<Item = Limit> + use<> {
        let is_at_limit = self.chain.limit_margin(arm) < JOINT_MARGIN_RAD;
        let is_singular = self.chain.manipulability(arm) < SINGULAR;
        [is_at_limit.then_some(Limit::Joint), is_singular.then_some(Limit::Singularity)].into_iter().flatten()
    }
}

impl Policy for Teleoperation {
    fn spec(&self) -> PolicySpec {
        PolicySpec {
            action: ActionSpec::new(ActionSpace::EePose, GripperEncoding::WidthM),
            privileged: self.source.is_privileged(),
            ..PolicySpec::native("teleop", self.rate_hz)
        }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        let mapping = Mapping::new(self.settings.mapping.clone(), self.camera);
        self.episode = EpisodeState::new(mapping, self.first_step);
        self.source.start(start)
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let measured = pose(observation, Observation::TOOL)?;
        let requested = pose(observation, Observation::TOOL_TARGET)?;
        let opening_m = entry(observation, Observation::STATE)?.last().copied().unwrap_or_default();
        let in_force = entry(observation, Observation::COMMAND)?;
        let arm = &in_force[..self.robot.arm_dof().min(in_force.len())];
        let period_s = 1.0 / self.rate_hz;
        let events = self.source.receive(self.episode.step, observation);

        let input = &self.settings.input;
        let widest_m = self.robot.gripper.max_width;
        let episode = &mut self.episode;
        if episode.width_m.is_none() {
            let width_m = in_force.last().copied().unwrap_or(widest_m);
            if width_m < widest_m - ROUNDING {
                let is_closed = opening_m - width_m > PRESSED_M || width_m < widest_m / 2.0;
                episode.mapping.set_closed(is_closed);
                episode.status.closed = is_closed;
                episode.kept_width_m = Some((width_m, is_closed));
            }
        }
        episode.receive(events, input.most_events);
        let silence_s = (episode.step - episode.last_event) as f64 * period_s;
        if silence_s >= input.lost_after_s {
            episode.mapping.require_release();
        }
        let reading = episode.decoder.reading();
        // A stream's gripper acts when it changes, not by what it is when the device is engaged.
        if let (Some(closed), Some(before)) = (reading.is_closed, episode.was_closed)
            && closed != before
        {
            episode.mapping.set_closed(closed);
        }
        episode.was_closed = reading.is_closed;
        let command = episode.mapping.command(&reading);
        let is_deflected = episode.mapping.is_deflected(&reading) || reading.goal.is_some();
        let dof = self.robot.arm_dof();
        let held = match (is_deflected, reading.clutch) {
            (false, _) => None,
            (true, true) => Some(Hold::Clutch),
            (true, false) if episode.is_silent || silence_s > input.hold_after_s => Some(Hold::Silence),
            (true, false) if matches!(&reading.goal, Some(Goal::Joints(joints)) if joints.len() != dof) => {
                Some(Hold::OtherJoints)
            }
            // Streams are engaged slowly instead.
            (true, false) if reading.goal.is_some() => None,
            (true, false) => episode.mapping.needs_release().then_some(Hold::ReleaseFirst),
        };
        if held.is_some() || reading.goal.is_none() {
            episode.follow.disengage();
        }

        let mut limits = BTreeSet::new();
        let target = episode.target.get_or_insert_with(|| Target::new(self.settings.target.clone(), requested));
        let refused = target.pose();
        if refused.position.distance(requested.position) > ROUNDING || refused.angle_to(&requested) > ROUNDING {
            target.place(requested);
            limits.insert(Limit::Reach);
        }
        let is_stream = held.is_none() && reading.goal.is_some();
        let (tool, follow) = (target.pose(), &mut episode.follow);
        let asked = reading.goal.filter(|_| is_stream).map(|goal| match goal {
            Goal::Joints(joints) => self.robot.tcp_pose(&joints),
            Goal::Absolute(pose) => pose,
            Goal::Relative(pose) => follow.moved(tool, pose),
        });
        let twist = match asked {
            Some(asked) => follow.twist(&tool, &asked, period_s, &self.settings.follow),
            None if held.is_some() => Twist::ZERO,
            None => command.twist,
        };
        if is_stream && !follow.is_near() {
            limits.insert(Limit::Ramp);
        }
        // The adapter's own test of reachability within a control step: a pose that passes it leaves no path pending,
        // and the arm keeps its configuration branch.
        let can_follow = |pose: &Pose| self.kinematics.follow(pose, arm, &self.reach).is_some();
        limits.extend(target.advance(&twist, period_s, &measured, can_follow));
        let pose = target.pose();

        episode.kept_width_m = episode.kept_width_m.filter(|(_, closed)| *closed == command.closed);
        let kept_m = episode.kept_width_m.map(|(width_m, _)| width_m);
        let goal_m = kept_m.unwrap_or(if command.closed { 0.0 } else { widest_m });
        let before_m = episode.width_m.or(kept_m).unwrap_or(widest_m);
        let most_m = input.gripper_m_s * period_s;
        let width_m =
            (before_m + (goal_m - before_m).clamp(-most_m, most_m)).max(opening_m - input.squeeze_m).min(widest_m);
        episode.width_m = Some(width_m);

        if limits.contains(&Limit::Lead) || limits.contains(&Limit::Reach) {
            limits.extend(self.reasons(arm));
        }
        let episode = &mut self.episode;
        let limits: Vec<Limit> = limits.into_iter().collect();
        let frame = episode.mapping.frame();
        if episode.frames.last().is_none_or(|(_, last)| *last != frame) {
            episode.frames.push((episode.step, frame));
        }
        let is_idle = twist.is_zero() && command.closed == episode.status.closed;
        episode.idle.add(episode.step, if is_idle { &[()] } else { &[] });
        episode.held.add(episode.step, held.as_slice());
        episode.limited.add(episode.step, &limits);
        episode.status = Status { frame, held, limits, closed: command.closed };
        episode.step += 1;
        if let Some(report) = &mut self.report {
            report(&episode.status);
        }

        let action = pose.to_row().into_iter().chain([width_m]).map(|number| number as f32).collect();
        Ok(ActionChunk { actions: vec![action], finished: command.finish })
    }
}

/// Axes of the camera with this name. The message of an error lists the world's cameras.
fn camera_axes(name: &str, robot: &RobotModel, world: &World) -> Result<Axes, String> {
    let Some(camera) = world.cameras.iter().find(|camera| camera.name == name) else {
        let known: Vec<&str> = world.cameras.iter().map(|camera| camera.name.as_str()).collect();
        return Err(format!("expected a camera of the world, one of {}; got `{name}`", known.join(", ")));
    };
    Ok(match camera.mount {
        CameraMount::World => Axes::world_camera(&camera.mount_from_camera),
        CameraMount::Hand => Axes::hand_camera(&(robot.hand_from_tcp.inverse() * camera.mount_from_camera)),
    })
}

fn entry<'a>(observation: &'a Observation, key: &str) -> Result<&'a [f64], PolicyError> {
    let missing = || PolicyError::Unsuited(format!("`{key}` is missing"));
    observation.state.get(key).map(Vec::as_slice).ok_or_else(missing)
}

fn pose(observation: &Observation, key: &str) -> Result<Pose, PolicyError> {
    match *entry(observation, key)? {
        [x, y, z, qw, qx, qy, qz] => Ok(Pose::from_wxyz_array([x, y, z], [qw, qx, qy, qz])),
        _ => Err(PolicyError::Unsuited(format!("`{key}` is not a pose"))),
    }
}
