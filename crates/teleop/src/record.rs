//! Record of a teleoperated episode: raw events, settings, and what happened to the commands; stored beside the
//! episode.

use std::collections::BTreeMap;

use genmanip_core::Document;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::device::{Device, DeviceEvent};
use crate::follow::FollowSettings;
use crate::mapping::{MappingSettings, OperatorFrame};
use crate::source::{Operator, Source};
use crate::target::{Limit, TargetSettings};

/// Name of the file with an [`OperatorRecord`] beside an episode.
pub const RECORD_FILE: &str = "operator.json";
/// Name of the file with one [`RecordedEvent`] per line.
pub const EVENTS_FILE: &str = "operator_events.jsonl";

/// Record of the operator of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OperatorRecord {
    /// The operator.
    pub operator: Operator,
    /// Devices in the order of their connection.
    pub devices: Vec<Device>,
    /// Settings of the mapping.
    pub mapping: MappingSettings,
    /// Name of the camera of [`OperatorFrame::Camera`]; absent if that frame was not offered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<String>,
    /// Limits of the commanded pose.
    pub target: TargetSettings,
    /// Timeouts of the events, and limits of the gripper.
    pub input: InputSettings,
    /// Speeds and tolerances of following leader arms and trackers; absent for the defaults.
    #[serde(default, skip_serializing_if = "FollowSettings::is_default")]
    pub follow: FollowSettings,
    /// Number of recorded events: all received ones except those beyond [`InputSettings::most_events`].
    pub events: u64,
    /// Number of events that the connected device cannot have sent ([`crate::device::DeviceError`]), or that exceeded
    /// [`InputSettings::most_events`]; they moved nothing.
    pub refused: u64,
    /// Frames used, each with the control step from which on it was in use.
    pub frames: Vec<(usize, OperatorFrame)>,
    /// Control steps in which the operator asked for nothing: neither motion nor gripper.
    pub idle: Vec<Interval<()>>,
    /// Control steps in which a deflected device did not move the arm, with the reason.
    pub held: Vec<Interval<Hold>>,
    /// Control steps in which a limit slowed the tool, with the limit.
    pub limited: Vec<Interval<Limit>>,
    /// Stretches of the episode by who was in command, in order and without gaps up to the settling; empty if the
    /// operator was from the first control step to the last.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub in_command: Vec<Stretch>,
    /// Control steps that the operator undid, in the order in which that happened; they are not in the episode.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub undone: Vec<Undone>,
    /// Numbers of idle control steps that were cut from the start and from the end; absent if none were.
    #[serde(default, skip_serializing_if = "is_untrimmed")]
    pub trimmed: [usize; 2],
}

fn is_untrimmed(trimmed: &[usize; 2]) -> bool {
    *trimmed == [0; 2]
}

/// Control steps from `from` to before `to` in which one side was in command.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stretch {
    /// First control step.
    pub from: usize,
    /// Control step after the last one.
    pub to: usize,
    /// Name of the policy that was in command; absent for the operator.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy: Option<String>,
    /// Frame in use when the operator took command; absent for a policy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<OperatorFrame>,
}

/// Control steps that were undone: the environment returned to the state before `from`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Undone {
    /// First undone control step; the episode goes on with another step of this number.
    pub from: usize,
    /// Control step after the last undone one.
    pub to: usize,
    /// Number of raw events that were received in these control steps.
    pub events: u64,
}

impl Document for OperatorRecord {
    const SCHEMA: &'static str = "genmanip.operator/1";
}

/// Timeouts of device events, and limits of the gripper command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InputSettings {
    /// Time without an event after which the arm holds, s.
    pub hold_after_s: f64,
    /// Time without an event after which the device has to be released before it moves the arm again, s.
    pub lost_after_s: f64,
    /// Maximum number of events in a control step; more count as a broken connection.
    pub most_events: usize,
    /// Maximum rate of change of the commanded gripper opening, m/s.
    pub gripper_m_s: f64,
    /// Largest difference between the measured opening and a smaller command, m: bounds the grip force.
    pub squeeze_m: f64,
}

impl Default for InputSettings {
    fn default() -> Self {
        Self {
            // With the control step in which the last event arrived and the one that holds, at most 100 ms at 60 Hz.
            hold_after_s: 0.06,
            lost_after_s: 0.5,
            // A device that reports at 8 kHz sends 133 per control step at 60 Hz.
            most_events: 10_000,
            gripper_m_s: 0.1,
            // Same as the scripted expert's (`squeeze_m` of its settings).
            squeeze_m: 0.015,
        }
    }
}

/// Reason why a deflected device does not move the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hold {
    /// No event came for longer than [`InputSettings::hold_after_s`].
    Silence,
    /// The clutch is held.
    Clutch,
    /// The device has to be released first: after a connection, the clutch or a long silence.
    ReleaseFirst,
    /// The leader arm has another number of joints than the robot.
    OtherJoints,
}

/// Control steps from `from` to before `to`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interval<R> {
    /// First control step.
    pub from: usize,
    /// Control step after the last one.
    pub to: usize,
    /// Reason that held in all of these steps; `()` where there is only one.
    pub reason: R,
}

/// Event with the control step before which it was received, and its number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedEvent {
    /// Number of the event in the episode, from 0.
    pub sequence: u64,
    /// Control step whose command is the first that it can change.
    pub step: usize,
    /// The event as the device sent it.
    pub event: DeviceEvent,
}

/// Invalid line in a file of events ([`EVENTS_FILE`]).
#[derive(Debug, Error)]
#[error("{EVENTS_FILE}, line {line}: expected {{\"sequence\", \"step\", \"event\"}} in ascending order: {why}")]
pub struct EventsError {
    /// Number of the line, from 1.
    pub line: usize,
    /// Description of the fault.
    pub why: String,
}

/// Line of a file of events.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct EventLine {
    pub(crate) sequence: u64,
    pub(crate) step: usize,
    pub(crate) event: DeviceEvent,
    /// Number of the undoing that cut the event's control step, from 1; absent if the step is in the episode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) undone: Option<usize>,
}

/// Content of [`EVENTS_FILE`]: one JSON object per line.
pub(crate) fn lines_of(events: &[EventLine]) -> Vec<u8> {
    let mut lines = Vec::new();
    for event in events {
        // Plain data: serialisation cannot fail.
        lines.extend(serde_json::to_vec(event).unwrap_or_default());
        lines.push(b'\n');
    }
    lines
}

/// Content of [`EVENTS_FILE`] for an episode of which nothing was undone.
pub fn events_to_lines(events: &[RecordedEvent]) -> Vec<u8> {
    let line = |event: &RecordedEvent| {
        let RecordedEvent { sequence, step, event } = event.clone();
        EventLine { sequence, step, event, undone: None }
    };
    lines_of(&events.iter().map(line).collect::<Vec<_>>())
}

/// Events in the content of [`EVENTS_FILE`], without those that were undone.
///
/// # Errors
/// The first line that is not an event, or does not follow the one before.
pub fn events_from_lines(text: &str) -> Result<Vec<RecordedEvent>, EventsError> {
    let mut events: Vec<RecordedEvent> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let fault = |why: String| EventsError { line: index + 1, why };
        let line: EventLine = serde_json::from_str(line).map_err(|error| fault(error.to_string()))?;
        let EventLine { sequence, step, event, undone } = line;
        let is_kept = undone.is_none();
        if sequence != index as u64 || is_kept && events.last().is_some_and(|last| step < last.step) {
            return Err(fault(format!("sequence {sequence} at step {step}")));
        }
        if is_kept {
            events.push(RecordedEvent { sequence, step, event });
        }
    }
    Ok(events)
}

/// Source that replays recorded events in the control steps in which they were received.
#[derive(Clone, Debug)]
pub struct Playback {
    operator: Operator,
    events: Vec<RecordedEvent>,
    next: usize,
}

impl Playback {
    /// Playback of the events of an operator.
    pub fn new(operator: Operator, events: Vec<RecordedEvent>) -> Self {
        Self { operator, events, next: 0 }
    }
}

impl Source for Playback {
    fn operator(&self) -> Operator {
        self.operator.clone()
    }

    fn start(&mut self, _start: &genmanip_core::EpisodeStart) -> Result<(), genmanip_core::PolicyError> {
        self.next = 0;
        Ok(())
    }

    fn receive(&mut self, step: usize, _observation: &genmanip_core::Observation) -> Vec<DeviceEvent> {
        let due = self.events[self.next..].iter().take_while(|event| event.step <= step);
        let events: Vec<DeviceEvent> = due.map(|event| event.event.clone()).collect();
        self.next += events.len();
        events
    }
}

/// Intervals by reason, while an episode is being recorded.
#[derive(Clone, Debug)]
pub(crate) struct Intervals<R> {
    open: BTreeMap<R, usize>,
    closed: Vec<Interval<R>>,
}

impl<R: Copy + Ord> Intervals<R> {
    pub(crate) fn new() -> Self {
        Self { open: BTreeMap::new(), closed: Vec::new() }
    }

    /// Adds the reasons that hold in a control step; steps must be added in order, without gaps.
    pub(crate) fn add(&mut self, step: usize, reasons: &[R]) {
        let ended: Vec<R> = self.open.keys().filter(|reason| !reasons.contains(reason)).copied().collect();
        for reason in ended {
            if let Some(from) = self.open.remove(&reason) {
                self.closed.push(Interval { from, to: step, reason });
            }
        }
        for reason in reasons {
            self.open.entry(*reason).or_insert(step);
        }
    }

    /// All intervals, sorted by their start; those still open end before `step`.
    pub(crate) fn until(&self, step: usize) -> Vec<Interval<R>> {
        let open = self.open.iter().map(|(&reason, &from)| Interval { from, to: step, reason });
        let mut all: Vec<Interval<R>> = self.closed.iter().copied().chain(open).collect();
        all.sort_by_key(|interval| (interval.from, interval.reason));
        all
    }
}
