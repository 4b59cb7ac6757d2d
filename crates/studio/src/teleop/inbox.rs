//! Device events of a page on their way to the control loop.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use genmanip_core::{EpisodeStart, Observation, PolicyError};
use genmanip_teleop::device::{Control, Device, DeviceEvent};
use genmanip_teleop::{Operator, Source};

/// Wall-clock time without events after which the arm holds. With the control step in progress and the one that holds,
/// at most 100 ms at 60 Hz.
pub const SILENCE: Duration = Duration::from_millis(60);
/// Most events between two control steps; the policy takes more for a broken connection. A mouse at 8 kHz sends 133.
pub const MOST_EVENTS: usize = 256;
/// Most events of a take; later ones are dropped, so that the arm holds.
const MOST_OF_TAKE: usize = 200_000;
/// Largest sizes of the parts of an event: report, descriptor and names (bytes), axes and buttons.
const MOST_REPORT: usize = 64;
const MOST_DESCRIPTOR: usize = 4096;
const MOST_NAME: usize = 120;
const MOST_VALUES: usize = 32;

/// Events between the socket and the control loop.
#[derive(Debug)]
pub struct Inbox {
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    events: Vec<DeviceEvent>,
    /// Controls that were pressed on the page.
    pressed: Vec<Control>,
    /// Device that was connected last.
    device: Option<Device>,
    /// Device of the page, while a program of its own sends the events of another one; the page's events are dropped
    /// then. `None` without such a program.
    behind: Option<Option<Device>>,
    /// Sequence number of the last accepted message of that program.
    program_sequence: Option<u64>,
    /// Time of the last accepted event.
    heard: Instant,
    is_silent: bool,
    /// Sequence number of the last accepted message.
    sequence: Option<u64>,
    /// Time of the page at which that message was sent, ms.
    sent_ms: f64,
    /// Events of the take.
    of_take: usize,
    dropped: u64,
}

/// Counters of an inbox, for display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Received {
    /// Sequence number of the last accepted message; `None` before the first one.
    pub sequence: Option<u64>,
    /// Time of the page at which that message was sent, ms.
    pub sent_ms: f64,
    /// Events dropped for their number or size, and messages out of order.
    pub dropped: u64,
}

impl Inbox {
    /// An empty inbox without a device.
    pub fn new(now: Instant) -> Self {
        let state = State {
            events: Vec::new(),
            pressed: Vec::new(),
            device: None,
            behind: None,
            program_sequence: None,
            heard: now,
            is_silent: false,
            sequence: None,
            sent_ms: 0.0,
            of_take: 0,
            dropped: 0,
        };
        Self { state: Mutex::new(state) }
    }

    /// Accepts the events of a message of the page; a message that is not newer than the last one is dropped.
    pub fn put(&self, sequence: u64, sent_ms: f64, events: Vec<DeviceEvent>, now: Instant) {
        let mut state = self.lock();
        if state.sequence.is_some_and(|last| sequence <= last) {
            state.dropped += 1;
            return;
        }
        (state.sequence, state.sent_ms) = (Some(sequence), sent_ms);
        if let Some(own) = &mut state.behind {
            for event in events.into_iter().filter(is_bounded) {
                match event {
                    DeviceEvent::Connected { device } => *own = Some(device),
                    DeviceEvent::Disconnected => *own = None,
                    _ => {}
                }
            }
            return;
        }
        state.accept(events, now);
    }

    /// Accepts the events of a message of a program beside the page; a message that is not newer than the last one is
    /// dropped.
    pub fn put_from_program(&self, sequence: u64, events: Vec<DeviceEvent>, now: Instant) {
        let mut state = self.lock();
        if state.behind.is_none() || state.program_sequence.is_some_and(|last| sequence <= last) {
            state.dropped += 1;
            return;
        }
        state.program_sequence = Some(sequence);
        state.accept(events, now);
    }

    /// Lets a program beside the page send the events; `false` gives that back to the page.
    pub fn join(&self, joins: bool) {
        let mut state = self.lock();
        if joins {
            let own = state.device.take();
            state.behind.get_or_insert(own);
            state.program_sequence = None;
        } else if let Some(own) = state.behind.take() {
            state.device = own;
        }
        let device = state.device.clone();
        state.events = vec![device.map_or(DeviceEvent::Disconnected, |device| DeviceEvent::Connected { device })];
    }

    /// Presses a control otherwise than on the device.
    pub fn press(&self, control: Control) {
        self.lock().pressed.push(control);
    }

    /// Forgets everything that has not been used, and connects the device anew: nothing before counts, and the device
    /// has to be released first.
    pub fn restart(&self, now: Instant) {
        let mut state = self.lock();
        state.pressed.clear();
        state.heard = now;
        state.is_silent = false;
        let connected = state.device.clone().map(|device| DeviceEvent::Connected { device });
        state.events = vec![connected.unwrap_or(DeviceEvent::Disconnected)];
    }

    /// As [`Inbox::restart`], for a new take.
    pub fn begin_take(&self, now: Instant) {
        self.lock().of_take = 0;
        self.restart(now);
    }

    /// Accepts a new connection, with sequence numbers of its own and without a device.
    pub fn reconnect(&self) {
        let mut state = self.lock();
        state.sequence = None;
        if let Some(own) = &mut state.behind {
            *own = None;
            return;
        }
        state.device = None;
        state.events = vec![DeviceEvent::Disconnected];
    }

    /// Takes the events since the last call, and a [`DeviceEvent::Silent`] once after [`SILENCE`].
    pub fn take(&self, now: Instant) -> Vec<DeviceEvent> {
        let mut state = self.lock();
        let pressed = std::mem::take(&mut state.pressed).into_iter().take(MOST_EVENTS);
        let mut events: Vec<DeviceEvent> = pressed.map(|control| DeviceEvent::Pressed { control }).collect();
        events.append(&mut state.events);
        if !state.is_silent && now.saturating_duration_since(state.heard) > SILENCE {
            state.is_silent = true;
            events.push(DeviceEvent::Silent);
        }
        events
    }

    /// Counters.
    pub fn received(&self) -> Received {
        let state = self.lock();
        Received { sequence: state.sequence, sent_ms: state.sent_ms, dropped: state.dropped }
    }

    // A panic of another thread leaves the values consistent, so a poisoned lock is used.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// Adds events of the device that moves the arm.
    fn accept(&mut self, events: Vec<DeviceEvent>, now: Instant) {
        for event in events {
            // One more than the policy accepts, so that it notices.
            let has_room = self.events.len() <= MOST_EVENTS && self.of_take < MOST_OF_TAKE;
            if !has_room || !is_bounded(&event) {
                self.dropped += 1;
                continue;
            }
            match &event {
                DeviceEvent::Connected { device } => self.device = Some(device.clone()),
                DeviceEvent::Disconnected => self.device = None,
                _ => {}
            }
            (self.heard, self.is_silent) = (now, false);
            self.of_take += 1;
            self.events.push(event);
        }
    }
}

/// True if all parts of an event have a size that a device can have. [`DeviceEvent::Silent`] and
/// [`DeviceEvent::Pressed`] are the server's own.
fn is_bounded(event: &DeviceEvent) -> bool {
    match event {
        DeviceEvent::Connected { device: Device::SpaceMouse { name, descriptor } } => {
            name.len() <= MOST_NAME && descriptor.len() <= MOST_DESCRIPTOR
        }
        DeviceEvent::Connected {
            device: Device::Gamepad { name } | Device::LeaderArm { name } | Device::PoseTracker { name, .. },
        } => name.len() <= MOST_NAME,
        DeviceEvent::Joints { position_rad, .. } => position_rad.len() <= MOST_VALUES,
        DeviceEvent::Report { bytes } => bytes.len() <= MOST_REPORT,
        DeviceEvent::Gamepad { axes, buttons } => axes.len() <= MOST_VALUES && buttons.len() <= MOST_VALUES,
        DeviceEvent::Key { code, .. } => code.len() <= MOST_NAME,
        DeviceEvent::Silent | DeviceEvent::Pressed { .. } => false,
        DeviceEvent::Connected { device: Device::Keyboard }
        | DeviceEvent::Pose { .. }
        | DeviceEvent::Alive
        | DeviceEvent::Blurred
        | DeviceEvent::Disconnected => true,
    }
}

/// A person at the page, whose events come through an inbox.
#[derive(Debug)]
pub struct PageSource {
    /// Name of the person.
    pub name: String,
    /// Inbox of the events.
    pub inbox: Arc<Inbox>,
}

impl Source for PageSource {
    fn operator(&self) -> Operator {
        Operator { kind: genmanip_teleop::OperatorKind::Person, name: self.name.clone() }
    }

    /// The page draws the poses of the simulator, not images of cameras.
    fn is_privileged(&self) -> bool {
        true
    }

    fn start(&mut self, _start: &EpisodeStart) -> Result<(), PolicyError> {
        Ok(())
    }

    fn receive(&mut self, _step: usize, _observation: &Observation) -> Vec<DeviceEvent> {
        self.inbox.take(Instant::now())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(down: bool) -> DeviceEvent {
        DeviceEvent::Key { code: "KeyW".into(), down }
    }

    fn connected() -> DeviceEvent {
        DeviceEvent::Connected { device: Device::Keyboard }
    }

    #[test]
    fn silence_is_reported_once_and_ends_with_an_event() {
        let start = Instant::now();
        let after = |ms: u64| start + Duration::from_millis(ms);
        let inbox = Inbox::new(start);
        inbox.put(0, 0.0, vec![connected(), key(true)], start);
        assert_eq!(inbox.take(after(10)), [connected(), key(true)]);
        assert_eq!(inbox.take(after(60)), []);
        assert_eq!(inbox.take(after(61)), [DeviceEvent::Silent]);
        assert_eq!(inbox.take(after(300)), []);
        inbox.put(1, 0.0, vec![DeviceEvent::Alive], after(310));
        assert_eq!(inbox.take(after(320)), [DeviceEvent::Alive]);
        assert_eq!(inbox.take(after(400)), [DeviceEvent::Silent]);
    }

    #[test]
    fn floods_old_messages_and_huge_events_are_dropped() {
        let now = Instant::now();
        let inbox = Inbox::new(now);
        inbox.put(5, 0.0, vec![key(true); 10_000], now);
        inbox.put(5, 0.0, vec![key(false)], now);
        inbox.put(4, 0.0, vec![key(false)], now);
        assert_eq!(inbox.take(now).len(), MOST_EVENTS + 1);
        assert_eq!(inbox.received().dropped, 10_000 - (MOST_EVENTS as u64 + 1) + 2);
        let huge = DeviceEvent::Key { code: "K".repeat(MOST_NAME + 1), down: true };
        let own = DeviceEvent::Pressed { control: Control::Finish };
        inbox.put(6, 0.0, vec![huge, own, DeviceEvent::Silent], now);
        assert_eq!(inbox.take(now), []);
    }

    #[test]
    fn nothing_is_replayed_after_a_restart_or_a_new_connection() {
        let now = Instant::now();
        let inbox = Inbox::new(now);
        inbox.put(0, 0.0, vec![connected(), key(true)], now);
        inbox.press(Control::Gripper);
        inbox.restart(now);
        assert_eq!(inbox.take(now), [connected()]);
        inbox.put(1, 0.0, vec![key(true)], now);
        inbox.reconnect();
        assert_eq!(inbox.take(now), [DeviceEvent::Disconnected]);
        inbox.put(0, 0.0, vec![connected()], now);
        assert_eq!(inbox.take(now), [connected()]);
    }

    #[test]
    fn a_program_beside_the_page_sends_the_events_until_it_leaves() {
        let now = Instant::now();
        let inbox = Inbox::new(now);
        inbox.put(0, 0.0, vec![connected(), key(true)], now);
        inbox.put_from_program(0, vec![key(true)], now);
        assert_eq!(inbox.take(now), [connected(), key(true)], "it has not joined");
        inbox.join(true);
        let leader = DeviceEvent::Connected { device: Device::LeaderArm { name: "gello".into() } };
        inbox.put_from_program(0, vec![leader.clone()], now);
        inbox.put_from_program(0, vec![leader.clone()], now);
        inbox.put(1, 0.0, vec![key(false)], now);
        assert_eq!(inbox.take(now), [DeviceEvent::Disconnected, leader.clone()]);
        assert_eq!((inbox.received().sequence, inbox.received().dropped), (Some(1), 2));
        inbox.restart(now);
        assert_eq!(inbox.take(now), [leader]);
        inbox.join(false);
        assert_eq!(inbox.take(now), [connected()], "the page's keyboard again");
    }
}
