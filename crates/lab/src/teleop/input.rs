//! Runs of given device events through the episode loop, and the poses that were commanded.

use genmanip_core::{Pose, Seed};
use genmanip_rollout::{RolloutError, RolloutSettings, Stage, run_episode};
use genmanip_teleop::device::{AXES, Control, DeviceEvent};
use genmanip_teleop::record::{Playback, RecordedEvent};
use genmanip_teleop::scripted::{VirtualDevice, VirtualKind};
use genmanip_teleop::{Operator, OperatorKind, TeleopSettings, Teleoperation};

use crate::LabError;

/// Events by control step.
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

    /// An event before a control step.
    pub fn push(&mut self, step: usize, event: DeviceEvent) {
        let sequence = self.list.len() as u64;
        self.list.push(RecordedEvent { sequence, step, event });
    }

    /// Deflections and held controls of a control step.
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
    /// Commanded pose of the tool in each control step: that of the joint targets in force.
    pub commanded: Vec<Pose>,
    /// Measured pose at the start of each control step.
    pub measured: Vec<Pose>,
}

impl Driven {
    /// Largest distance (m) of a commanded position from the first one, and largest angle (rad).
    pub fn largest_motion(&self) -> (f64, f64) {
        let first = self.commanded.first().copied().unwrap_or_default();
        self.commanded.iter().fold((0.0, 0.0), |(way, turn), pose| {
            (f64::max(way, pose.position.distance(first.position)), f64::max(turn, pose.angle_to(&first)))
        })
    }

    /// First pose, and last one.
    pub fn ends(poses: &[Pose]) -> (Pose, Pose) {
        (poses.first().copied().unwrap_or_default(), poses.last().copied().unwrap_or_default())
    }
}

/// Runs events for a number of control steps.
///
/// # Errors
/// If the settings do not fit the stage, or the simulation becomes unstable.
pub fn drive(stage: &Stage, settings: &TeleopSettings, events: Events, steps: usize) -> Result<Driven, LabError> {
    let operator = Operator { kind: OperatorKind::Scripted, name: "fixed events".into() };
    let source = Box::new(Playback::new(operator, events.list));
    let mut policy =
        Teleoperation::new(settings.clone(), source, &stage.robot, &stage.scenario.world).map_err(LabError::input)?;
    let horizon_s = steps as f64 / stage.control_rate_hz();
    // Settled long enough that the tool is at rest at the end.
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
