//! Given device events run through the episode loop, and the resulting commanded and measured poses.

use genmanip_core::{Pose, Seed};
use genmanip_rollout::{RolloutError, RolloutSettings, Stage, run_episode};
use genmanip_teleop::device::{AXES, Control, DeviceEvent};
use genmanip_teleop::record::{Playback, RecordedEvent};
use genmanip_teleop::scripted::{VirtualDevice, VirtualKind};
use genmanip_teleop::{Operator, OperatorKind, TeleopSettings, Teleoperation};

use crate::LabError;

/// Events of a virtual device, each with the control step before which it arrives.
pub struct Events {
    device: VirtualDevice,
    list: Vec<RecordedEvent>,
}

impl Events {
    /// A device that is connected and at rest before the first control step.
    pub fn new(kind: VirtualKind) -> Self {
        let device = VirtualDevice::new(kind);
        let mut events = Self { list: Vec::new(), device };
        events.push(0, events.device.connected());
        events.act(0, &[0.0; AXES], &[]);
        events
    }

    /// Adds an event that arrives before a control step.
    pub fn push(&mut self, step: usize, event: DeviceEvent) {
        let sequence = self.list.len() as u64;
        self.list.push(RecordedEvent { sequence, step, event });
    }

    /// Adds the device's events for these axis deflections (-1 to 1) and held controls, before a control step.
    pub fn act(&mut self, step: usize, axes: &[f64; AXES], held: &[Control]) {
        for event in self.device.events(axes, held) {
            self.push(step, event);
        }
    }

    /// Number of events.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Control step of the last event.
    pub fn last_step(&self) -> usize {
        self.list.last().map_or(0, |event| event.step)
    }
}

/// Poses of the tool in a run of events.
pub struct Driven {
    /// Commanded pose of the tool in each control step (forward kinematics of the joint targets), world frame.
    pub commanded: Vec<Pose>,
    /// Simulated pose of the tool at the start of each control step, world frame.
    pub measured: Vec<Pose>,
}

impl Driven {
    /// Largest distance (m) and largest angle (rad) of a commanded pose from the first one.
    pub fn largest_motion(&self) -> (f64, f64) {
        let first = self.commanded.first().copied().unwrap_or_default();
        self.commanded.iter().fold((0.0, 0.0), |(way, turn), pose| {
            (f64::max(way, pose.position.distance(first.position)), f64::max(turn, pose.angle_to(&first)))
        })
    }

    /// First and last pose; the identity if there are none.
    pub fn ends(poses: &[Pose]) -> (Pose, Pose) {
        (poses.first().copied().unwrap_or_default(), poses.last().copied().unwrap_or_default())
    }
}

/// Runs an episode of `steps` control steps with these events.
///
/// # Errors
/// If the settings do not fit the stage, or the simulation becomes unstable.
pub fn drive(stage: &Stage, settings: &TeleopSettings, events: Events, steps: usize) -> Result<Driven, LabError> {
    let operator = Operator { kind: OperatorKind::Scripted, name: "fixed events".into() };
    let source = Box::new(Playback::new(operator, events.list));
    let mut policy =
        Teleoperation::new(settings.clone(), source, &stage.robot, &stage.scenario.world).map_err(LabError::input)?;
    let horizon_s = steps as f64 / stage.control_rate_hz();
    // No further settling: `steps` includes the time in which the tool comes to rest.
    let rollout = RolloutSettings { horizon_s, settle_s: 0.0, judge_every: usize::MAX, ..RolloutSettings::default() };
    let broke = |error: RolloutError| LabError::broken("an episode of fixed events broke", error);
    let episode = run_episode(stage, &mut policy, "fixed_events", Seed::new(0), &rollout).map_err(broke)?;
    let dof = stage.robot.arm_dof();
    let commanded = episode.frames.iter().map(|frame| {
        let arm: Vec<f64> = frame.command[..dof].iter().copied().map(f64::from).collect();
        stage.robot.tcp_pose(&arm)
    });
    Ok(Driven { commanded: commanded.collect(), measured: episode.frames.iter().map(|frame| frame.tcp).collect() })
}
