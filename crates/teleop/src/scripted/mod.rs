//! Scripted operator: a program in place of a person, which acts through the events of a virtual device.
//!
//! It observes the TCP pose with a reaction delay and knows the goal poses from simulator ground truth. It deflects the
//! device in proportion to the remaining distance, with a tremor and with gains that overshoot, and pauses between
//! movements. On a keyboard it taps: it estimates how long to press, waits, observes, and corrects. It assumes the
//! frame [`OperatorFrame::World`](crate::mapping::OperatorFrame::World).

mod virtual_device;

pub use virtual_device::{VirtualDevice, VirtualKind};

use std::collections::VecDeque;
use std::f64::consts::TAU;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{EpisodeStart, Observation, PolicyError, Pose, Seed};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::device::{AXES, Control, DeviceEvent};
use crate::mapping::{MappingSettings, deflection};
use crate::source::{Operator, OperatorKind, Source};

/// A movement of the script, and what follows it.
#[derive(Clone, Debug, PartialEq)]
pub struct Waypoint {
    /// Goal pose of the TCP in the world.
    pub world_from_tcp: Pose,
    /// Distance from the goal at which it counts as reached, m.
    pub within_m: f64,
    /// Angle from the goal at which it counts as reached, rad.
    pub within_rad: f64,
    /// Control that is pressed once the goal is reached; `None` for none.
    pub press: Option<Control>,
}

/// Habits of the operator; the defaults are in the range of published figures on people, none was fitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Habits {
    /// Delay between a state of the robot and the reaction to it, s.
    pub reaction_s: f64,
    /// Minimum and maximum velocity per remaining distance, 1/s, drawn uniformly for each movement. Large gains
    /// overshoot.
    pub gain_per_s: [f64; 2],
    /// Amplitude of the tremor, share of the full deflection.
    pub tremor: f64,
    /// Minimum and maximum frequency of the tremor, Hz.
    pub tremor_hz: [f64; 2],
    /// Time constant of the first-order low-pass filter on the deflection, s.
    pub smoothing_s: f64,
    /// Minimum and maximum pause between movements, s.
    pub pause_s: [f64; 2],
    /// Time for which a goal must be observed as reached, s.
    pub content_s: f64,
    /// Time for which a button is pressed, s.
    pub press_s: f64,
    /// Time to wait for the gripper after a press, s.
    pub gripper_s: f64,
    /// Time after which a movement that has not reached its goal is given up and the episode ended, s.
    pub patience_s: f64,
    /// Largest relative error of the time for which a key is pressed, e.g. 0.15.
    pub tap_error: f64,
}

impl Default for Habits {
    fn default() -> Self {
        Self {
            // Visual reaction times are 0.2 to 0.25 s.
            reaction_s: 0.2,
            gain_per_s: [1.5, 2.5],
            tremor: 0.02,
            // Physiological tremor of the hand.
            tremor_hz: [8.0, 12.0],
            smoothing_s: 0.06,
            pause_s: [0.1, 0.6],
            content_s: 0.2,
            press_s: 0.1,
            gripper_s: 1.0,
            patience_s: 12.0,
            tap_error: 0.15,
        }
    }
}

/// Remaining distance (m) and angle (rad) below which keys are tapped in precision mode.
const PRECISE: [f64; 2] = [0.03, 0.1];
/// Longest press of a key, s.
const LONGEST_TAP_S: f64 = 1.0;

/// Scripted operator; its events are deterministic for a given seed of the episode.
pub struct ScriptedOperator {
    habits: Habits,
    mapping: MappingSettings,
    period_s: f64,
    kind: VirtualKind,
    waypoints: Vec<Waypoint>,
    episode: State,
}

struct State {
    device: VirtualDevice,
    rng: ChaCha8Rng,
    /// Poses `world_from_tcp` of the last control steps, the newest last; the first one, delayed by the reaction time,
    /// is what the operator observes now.
    seen: VecDeque<Pose>,
    waypoint: usize,
    phase: Phase,
    /// Control step in which the movement began.
    began: usize,
    /// Velocity per remaining distance of this movement, 1/s.
    gain_per_s: f64,
    /// Number of consecutive control steps in which the goal was observed as reached.
    content: usize,
    /// Deflection of each axis after the low-pass filter, -1 to 1.
    hand: [f64; AXES],
    /// Frequency (Hz) and phase (in periods, 0-1) of each axis's tremor.
    tremor: [[f64; 2]; AXES],
}

#[derive(Clone, Debug, PartialEq)]
enum Phase {
    /// Moves to the waypoint with a proportional device.
    Moving,
    /// Holds keys: remaining control steps per axis, signed by direction, and true in precision mode.
    Tapping([i64; AXES], bool),
    /// Waits for this many control steps, then observes the pose and taps again.
    Looking(usize),
    /// Holds a control for this many control steps, then waits for the gripper.
    Pressing(Control, usize),
    /// Waits for this many control steps before the next waypoint.
    Pausing(usize),
    /// Has reached the last waypoint or ended the episode.
    Done,
}

impl ScriptedOperator {
    /// Operator that moves along waypoints with a virtual device; `mapping` must be the one that decodes its events,
    /// and `period_s` the control period (s).
    pub fn new(
        kind: VirtualKind,
        waypoints: Vec<Waypoint>,
        habits: Habits,
        mapping: MappingSettings,
        period_s: f64,
    ) -> Self {
        let episode = State::new(kind, Seed::new(0), &habits);
        Self { habits, mapping, period_s, kind, waypoints, episode }
    }

    fn steps(&self, time_s: f64) -> usize {
        (time_s / self.period_s).round() as usize
    }

    /// Deflections and held controls of this control step.
    fn act(&mut self, step: usize) -> ([f64; AXES], Vec<Control>) {
        let mut wanted = [0.0; AXES];
        let mut held = Vec::new();
        let seen = self.episode.seen.front().copied().unwrap_or_default();
        let is_moving = matches!(self.episode.phase, Phase::Moving | Phase::Looking(_) | Phase::Tapping(..));
        if is_moving && step > self.episode.began + self.steps(self.habits.patience_s) {
            self.episode.phase = Phase::Pressing(Control::Finish, self.steps(self.habits.press_s));
        }
        match self.episode.phase.clone() {
            Phase::Done => {}
            Phase::Pausing(left) | Phase::Looking(left) if left > 0 => {
                self.episode.phase = match self.episode.phase {
                    Phase::Pausing(_) => Phase::Pausing(left - 1),
                    _ => Phase::Looking(left - 1),
                };
            }
            Phase::Pausing(_) => {
                let [least, most] = self.habits.gain_per_s;
                self.episode.gain_per_s = self.episode.rng.random_range(least..=most);
                self.episode.content = 0;
                self.episode.began = step;
                self.episode.phase = if self.kind == VirtualKind::Keyboard { Phase::Looking(0) } else { Phase::Moving };
            }
            Phase::Pressing(control, left) => {
                held.push(control);
                self.episode.phase = match left {
                    0 if control == Control::Finish => Phase::Done,
                    0 => Phase::Pausing(self.steps(self.habits.gripper_s)),
                    _ => Phase::Pressing(control, left - 1),
                };
            }
            Phase::Moving => match self.remaining(&seen) {
                None => self.arrive(),
                Some(left) => {
                    let MappingSettings { linear_m_s, angular_rad_s, .. } = self.mapping;
                    let share = |left: DVec3, most: f64| (left * self.episode.gain_per_s / most).clamp_length_max(1.0);
                    let (linear, angular) = (share(left.0, linear_m_s), share(left.1, angular_rad_s));
                    wanted = shares(linear, angular).map(|shaped| deflection(shaped, &self.mapping));
                }
            },
            Phase::Looking(_) => match self.remaining(&seen) {
                None => self.arrive(),
                Some(left) => {
                    self.episode.phase = self.taps(left);
                    if let Phase::Tapping(..) = self.episode.phase {
                        return self.act(step);
                    }
                }
            },
            Phase::Tapping(mut left, is_precise) => {
                held.extend(is_precise.then_some(Control::Precision));
                for (wanted, left) in wanted.iter_mut().zip(&mut left) {
                    *wanted = left.signum() as f64;
                    *left -= left.signum();
                }
                let is_over = left.iter().all(|steps| *steps == 0);
                // The reaction time, and as long again for the arm to come to rest.
                let wait = self.steps(2.0 * self.habits.reaction_s);
                self.episode.phase = if is_over { Phase::Looking(wait) } else { Phase::Tapping(left, is_precise) };
            }
        }
        if self.kind != VirtualKind::Keyboard {
            self.shake(&mut wanted, step);
        }
        (wanted, held)
    }

    /// Applies the low-pass filter, and tremor while any axis is deflected, to the wanted deflections in place.
    fn shake(&mut self, wanted: &mut [f64; AXES], step: usize) {
        let share = self.period_s / (self.habits.smoothing_s + self.period_s);
        let time_s = step as f64 * self.period_s;
        let is_pushing = wanted.iter().any(|axis| *axis != 0.0);
        for ((wanted, hand), [rate_hz, phase]) in wanted.iter_mut().zip(&mut self.episode.hand).zip(self.episode.tremor)
        {
            *hand = if is_pushing { *hand + (*wanted - *hand) * share } else { 0.0 };
            let tremor = self.habits.tremor * (TAU * (rate_hz * time_s + phase)).sin();
            *wanted = if is_pushing { (*hand + tremor).clamp(-1.0, 1.0) } else { 0.0 };
        }
    }

    /// Remaining motion as observed: translation (m) and rotation vector (rad) in the world frame. `None` once the goal
    /// was observed as reached for long enough, or without a waypoint.
    fn remaining(&mut self, seen: &Pose) -> Option<(DVec3, DVec3)> {
        let Waypoint { world_from_tcp, within_m, within_rad, .. } = self.waypoints.get(self.episode.waypoint)?;
        let way = world_from_tcp.position - seen.position;
        let turn = rotation_vector(world_from_tcp.rotation * seen.rotation.inverse());
        let is_there = way.length() <= *within_m && turn.length() <= *within_rad;
        // A keyboard is only observed after its keys have been released for the reaction time.
        let needed = if self.kind == VirtualKind::Keyboard { 1 } else { self.steps(self.habits.content_s) };
        self.episode.content = if is_there { self.episode.content + 1 } else { 0 };
        (self.episode.content < needed).then_some((way, turn))
    }

    /// Ends a movement: presses the waypoint's control or pauses, and goes on to the next waypoint.
    fn arrive(&mut self) {
        let press = self.waypoints.get(self.episode.waypoint).and_then(|waypoint| waypoint.press);
        self.episode.waypoint += 1;
        let [least, most] = self.habits.pause_s;
        let pause_s = self.episode.rng.random_range(least..=most);
        self.episode.phase = match press {
            Some(control) => Phase::Pressing(control, self.steps(self.habits.press_s)),
            None => Phase::Pausing(self.steps(pause_s)),
        };
        if press.is_none() && self.episode.waypoint >= self.waypoints.len() {
            self.episode.phase = Phase::Done;
        }
    }

    /// Key presses that should cover the remaining translation (m) and rotation vector (rad), with an error in their
    /// duration.
    fn taps(&mut self, (way, turn): (DVec3, DVec3)) -> Phase {
        let is_precise = way.length() < PRECISE[0] && turn.length() < PRECISE[1];
        let factor = if is_precise { self.mapping.precision } else { 1.0 } * self.period_s;
        let speeds = [self.mapping.linear_m_s * factor, self.mapping.angular_rad_s * factor];
        let longest = self.steps(LONGEST_TAP_S) as f64;
        let mut taps = [0; AXES];
        for (axis, (tap, left)) in taps.iter_mut().zip(shares(way, turn)).enumerate() {
            let error = 1.0 + self.habits.tap_error * self.episode.rng.random_range(-1.0..=1.0);
            *tap = (left / speeds[axis / 3] * error).clamp(-longest, longest).round() as i64;
        }
        if taps.iter().any(|steps| *steps != 0) { Phase::Tapping(taps, is_precise) } else { Phase::Looking(1) }
    }
}

impl State {
    fn new(kind: VirtualKind, seed: Seed, habits: &Habits) -> Self {
        let mut rng = seed.fork("scripted operator").rng();
        let [least, most] = habits.tremor_hz;
        let tremor = std::array::from_fn(|_| [rng.random_range(least..=most), rng.random_range(0.0..1.0)]);
        Self {
            device: VirtualDevice::new(kind),
            rng,
            seen: VecDeque::new(),
            waypoint: 0,
            phase: Phase::Pausing(0),
            began: 0,
            gain_per_s: 0.0,
            content: 0,
            hand: [0.0; AXES],
            tremor,
        }
    }
}

impl Source for ScriptedOperator {
    fn operator(&self) -> Operator {
        Operator { kind: OperatorKind::Scripted, name: format!("scripted, {}", self.kind.name()) }
    }

    fn is_privileged(&self) -> bool {
        true
    }

    fn start(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.episode = State::new(self.kind, start.seed, &self.habits);
        Ok(())
    }

    fn receive(&mut self, step: usize, observation: &Observation) -> Vec<DeviceEvent> {
        if let Some(&[x, y, z, qw, qx, qy, qz]) = observation.state.get(Observation::TOOL).map(Vec::as_slice) {
            self.episode.seen.push_back(Pose::from_wxyz_array([x, y, z], [qw, qx, qy, qz]));
        }
        let delay = self.steps(self.habits.reaction_s) + 1;
        while self.episode.seen.len() > delay {
            self.episode.seen.pop_front();
        }
        let (axes, held) = match step {
            0 => ([0.0; AXES], Vec::new()),
            _ => self.act(step),
        };
        let mut events = Vec::new();
        if step == 0 {
            events.push(self.episode.device.connected());
        }
        events.extend(self.episode.device.events(&axes, &held));
        events
    }
}

/// Components on the axes forward, left, up and the rotations about these, which in [`OperatorFrame::World`] are those
/// of the world.
///
/// [`OperatorFrame::World`]: crate::mapping::OperatorFrame::World
fn shares(linear: DVec3, angular: DVec3) -> [f64; AXES] {
    [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]
}

/// Rotation vector (axis times angle, rad) of at most π.
fn rotation_vector(rotation: DQuat) -> DVec3 {
    let rotation = if rotation.w < 0.0 { -rotation } else { rotation };
    rotation.to_scaled_axis()
}
