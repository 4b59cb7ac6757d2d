//! Log of an episode: who was in command when, the operator's record and raw events, and what was undone.

use crate::device::DeviceEvent;
use crate::mapping::OperatorFrame;
use crate::record::{EventLine, Interval, OperatorRecord, RecordedEvent, Stretch, Undone, lines_of};
use crate::teleoperation::Teleoperation;

/// Idle control steps that trimming keeps at both ends: the device counts as released before it moves the arm, and the
/// arm comes to rest.
const KEPT_IDLE: usize = 6;
/// Most events that trimming moves to the first control step.
const MOST_MOVED: usize = 128;

/// Log of an episode in progress, in stretches with the operator or another policy in command.
#[derive(Clone, Debug)]
pub struct EpisodeLog {
    record: OperatorRecord,
    events: Vec<EventLine>,
}

/// An episode without its idle ends: events and stretches to be simulated anew.
#[derive(Clone, Debug)]
pub struct Trim {
    /// Number of control steps cut from the start, and first control step of the end that is cut, before the cut.
    pub cut: [usize; 2],
    /// Stretches, in control steps after the cut.
    pub in_command: Vec<Stretch>,
    /// Events, in control steps after the cut.
    pub events: Vec<RecordedEvent>,
}

impl EpisodeLog {
    /// Log without control steps; `operator` has the settings of the teleoperation.
    pub fn new(operator: &Teleoperation) -> Self {
        Self { record: operator.record(), events: Vec::new() }
    }

    /// Adds control steps from `from` to before `to` in which the operator was in command, with `frame` at their start.
    pub fn add_operator(&mut self, operator: &Teleoperation, frame: OperatorFrame, from: usize, to: usize) {
        let new = operator.record();
        let record = &mut self.record;
        let devices = new.devices.into_iter().filter(|device| !record.devices.contains(device)).collect::<Vec<_>>();
        record.devices.extend(devices);
        record.refused += new.refused;
        for (step, frame) in new.frames {
            if record.frames.last().is_none_or(|(_, last)| *last != frame) {
                record.frames.push((step, frame));
            }
        }
        record.idle.extend(new.idle);
        record.held.extend(new.held);
        record.limited.extend(new.limited);
        for RecordedEvent { step, event, .. } in operator.events().iter().cloned() {
            let sequence = self.events.len() as u64;
            self.events.push(EventLine { sequence, step, event, undone: None });
        }
        self.add(Stretch { from, to, policy: None, frame: Some(frame) });
    }

    /// Adds control steps from `from` to before `to` in which another policy was in command.
    pub fn add_policy(&mut self, name: &str, from: usize, to: usize) {
        self.add(Stretch { from, to, policy: Some(name.into()), frame: None });
    }

    fn add(&mut self, stretch: Stretch) {
        if stretch.from < stretch.to {
            self.record.in_command.push(stretch);
        }
    }

    /// Cuts the control steps from `from` on, which the operator undid; their events stay, marked as undone.
    pub fn undo(&mut self, from: usize) {
        let Some(to) = self.record.in_command.last().map(|last| last.to).filter(|to| *to > from) else { return };
        let number = self.record.undone.len() + 1;
        let mut events = 0;
        for event in self.events.iter_mut().filter(|event| event.step >= from && event.undone.is_none()) {
            event.undone = Some(number);
            events += 1;
        }
        let record = &mut self.record;
        record.undone.push(Undone { from, to, events });
        record.in_command.retain(|stretch| stretch.from < from);
        record.in_command.iter_mut().for_each(|stretch| stretch.to = stretch.to.min(from));
        record.frames.retain(|(step, _)| *step < from);
        cut(&mut record.idle, from);
        cut(&mut record.held, from);
        cut(&mut record.limited, from);
    }

    /// Number of control steps that were undone.
    pub fn undone_steps(&self) -> usize {
        self.record.undone.iter().map(|undone| undone.to - undone.from).sum()
    }

    /// Stretches so far.
    pub fn in_command(&self) -> &[Stretch] {
        &self.record.in_command
    }

    /// Record of the operator; without stretches if the operator was in command throughout.
    pub fn record(&self) -> OperatorRecord {
        let mut record = OperatorRecord { events: self.events.len() as u64, ..self.record.clone() };
        if let [Stretch { policy: None, .. }] = record.in_command[..] {
            record.in_command.clear();
        }
        record
    }

    /// Content of [`EVENTS_FILE`](crate::record::EVENTS_FILE).
    pub fn lines(&self) -> Vec<u8> {
        lines_of(&self.events)
    }

    /// Events that were not undone.
    pub fn events(&self) -> Vec<RecordedEvent> {
        let kept = self.events.iter().filter(|event| event.undone.is_none());
        kept.map(|EventLine { sequence, step, event, .. }| RecordedEvent {
            sequence: *sequence,
            step: *step,
            event: event.clone(),
        })
        .collect()
    }

    /// The episode without its idle ends; `None` if there is next to nothing to cut.
    pub fn trim(&self) -> Option<Trim> {
        let record = &self.record;
        let (first, last) = (record.in_command.first()?, record.in_command.last()?);
        let is_operator = |stretch: &Stretch| stretch.policy.is_none();
        let idle_until = record.idle.iter().find(|idle| idle.from == 0 && is_operator(first)).map_or(0, |idle| idle.to);
        let idle_from = record.idle.iter().find(|idle| idle.to == last.to && is_operator(last));
        let mut head = idle_until.min(first.to).saturating_sub(KEPT_IDLE);
        let end = idle_from.map_or(last.to, |idle| (idle.from + KEPT_IDLE).min(last.to));
        if idle_until >= last.to {
            return None;
        }
        let mut events = Vec::new();
        for event in self.events() {
            let is_sign_of_life = matches!(event.event, DeviceEvent::Alive | DeviceEvent::Silent);
            if event.step < end && !(event.step < head && is_sign_of_life) {
                events.push(event);
            }
        }
        // States that repeat the one before say nothing new.
        let repeats = |pair: &[RecordedEvent]| pair[1].step < head && pair[0].event == pair[1].event;
        let repeated: Vec<bool> = std::iter::once(false).chain(events.windows(2).map(repeats)).collect();
        let mut repeated = repeated.into_iter();
        events.retain(|_| !repeated.next().unwrap_or(false));
        if events.iter().filter(|event| event.step < head).count() > MOST_MOVED {
            head = 0;
        }
        if head == 0 && end == last.to {
            return None;
        }
        for (sequence, event) in events.iter_mut().enumerate() {
            (event.sequence, event.step) = (sequence as u64, event.step.saturating_sub(head));
        }
        let mut in_command = record.in_command.clone();
        for stretch in &mut in_command {
            (stretch.from, stretch.to) = (stretch.from.saturating_sub(head), stretch.to.min(end).saturating_sub(head));
        }
        in_command.retain(|stretch| stretch.from < stretch.to);
        Some(Trim { cut: [head, end], in_command, events })
    }

    /// Marks the log as that of an episode whose idle ends were cut: `before` is the log of the whole episode, `cut` the
    /// number of control steps cut from its start and from its end. Undone parts are taken over.
    pub fn trimmed_from(&mut self, before: &Self, cut: [usize; 2]) {
        let head = cut[0];
        self.record.trimmed = cut;
        self.record.undone = before.record.undone.clone();
        for undone in &mut self.record.undone {
            (undone.from, undone.to) = (undone.from.saturating_sub(head), undone.to.saturating_sub(head));
        }
        for event in before.events.iter().filter(|event| event.undone.is_some()) {
            let (sequence, step) = (self.events.len() as u64, event.step.saturating_sub(head));
            self.events.push(EventLine { sequence, step, ..event.clone() });
        }
    }
}

/// Cuts intervals at a control step.
fn cut<R>(intervals: &mut Vec<Interval<R>>, at: usize) {
    intervals.retain(|interval| interval.from < at);
    intervals.iter_mut().for_each(|interval| interval.to = interval.to.min(at));
}
