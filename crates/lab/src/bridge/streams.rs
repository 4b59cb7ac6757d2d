//! Random streams of commands against the limits of the bridge.

use genmanip_core::Seed;
use genmanip_pipeline::real::simulated::bridge_robot;
use genmanip_real::bridge::client::SLOW;
use genmanip_real::bridge::{
    Bridge, BridgeRobot, BridgeSettings, Command, JointState, Motion, Orders, Reading, Reply, Request, StopReason,
};
use genmanip_workspace::{WorkspaceError, worlds};
use rand::{Rng, RngExt};
use serde::Serialize;

use crate::clock::cpu_clock;

/// Control periods of a stream.
const TICKS: usize = 400;

/// Violations of limits, and times to stop, over random streams of commands.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Streams {
    /// Number of streams.
    pub count: usize,
    /// Largest velocity, acceleration and jerk of any setpoint, as shares of their limits.
    pub worst_share: [f64; 3],
    /// Number of stops because no command came in time, at full and at slow speed.
    pub deadlines: [usize; 2],
    /// Longest time from a deadline to the first control period of braking, s.
    pub braking_s: f64,
    /// Longest time from a deadline to standstill, s, at full and at slow speed.
    pub standing_s: [f64; 2],
    /// Largest step of the tool in the first control period after a start, mm.
    pub start_step_mm: f64,
    /// Number of starts.
    pub starts: usize,
    /// CPU time, s.
    pub cpu_s: f64,
}

/// Random streams of commands to the default robot's bridge: bursts, gaps, late and repeated numbers, jumps, NaN.
///
/// # Errors
/// If the built-in world cannot be read.
pub fn measure(count: usize, seed: Seed) -> Result<Streams, WorkspaceError> {
    let mut clock = cpu_clock();
    let robot = worlds::robot(&worlds::read_world(None)?)?;
    let robot = bridge_robot(&robot);
    let mut found = Streams { count, ..Streams::default() };
    for stream in 0..count {
        let rng = &mut seed.fork("streams").fork_index(stream as u64).rng();
        let slow = stream % 3 == 0;
        one_stream(&robot, slow, rng, &mut found);
    }
    found.cpu_s = clock();
    Ok(found)
}

fn one_stream(robot: &BridgeRobot, slow: bool, rng: &mut impl Rng, found: &mut Streams) {
    let tick_s = BridgeSettings::default().guard.tick_s;
    let limits = &robot.joints;
    let home: Vec<f64> = limits.iter().map(|it| rng.random_range(it.lower..it.upper)).collect();
    let reading = |positions: Vec<f64>| Reading { positions, ..Reading::default() };
    let Some(mut bridge) = Bridge::new(robot.clone(), BridgeSettings::default(), reading(home.clone())) else { return };
    let speed = if slow { SLOW } else { 1.0 };
    let Some(Reply::Lease { lease }) = bridge.handle(0.0, &Request::Acquire {}) else { return };
    let start = Request::Start { lease, dead_man: true, speed, workspace_m: None };
    let (mut now_s, mut silent_until_s, mut deadline_s, mut sequence) = (0.0, 0.0, f64::INFINITY, 10_u64);
    let mut last: Vec<JointState> = home.iter().copied().map(JointState::at_rest).collect();
    let mut targets = home;
    // Half of the streams keep their targets for a while, so that joints get up to speed.
    let change = if rng.random_bool(0.5) { 1.0 } else { 0.03 };
    let (mut has_started, mut is_stopping) = (false, false);
    for _ in 0..TICKS {
        if !has_started && bridge.is_at_rest() {
            bridge.handle(now_s, &start);
            deadline_s = now_s + BridgeSettings::default().guard.longest_validity_s;
            (has_started, is_stopping) = (true, false);
            found.starts += 1;
        }
        if now_s >= silent_until_s {
            for _ in 0..[0, 0, 1, 1, 5][rng.random_range(0..5)] {
                sequence = sequence.saturating_add_signed([1, 1, 1, 3, -2, 0][rng.random_range(0..6)]);
                if rng.random_bool(change) {
                    targets = limits.iter().map(|it| wild(it.lower, it.upper, rng)).collect();
                }
                let command = Command {
                    lease,
                    sequence,
                    valid_for_s: [0.1, 0.02, 0.05, f64::NAN, -1.0, 1e9][rng.random_range(0..6)],
                    dead_man: rng.random_bool(0.999),
                    positions: targets.clone(),
                    over_s: [0.0, 0.02, 0.05, f64::NAN][rng.random_range(0..4)],
                    width_m: None,
                };
                if bridge.handle(now_s, &Request::Command(command.clone())).is_none() {
                    deadline_s = now_s + command.valid_for_s;
                }
            }
            if rng.random_bool(0.02) {
                silent_until_s = now_s + rng.random_range(0.0..0.3);
            }
        }
        now_s += tick_s;
        let positions = last.iter().map(|joint| joint.position).collect();
        let Orders { setpoints, .. } = bridge.tick(now_s, reading(positions));
        for ((before, after), it) in last.iter().zip(&setpoints).zip(limits) {
            let velocity = after.velocity.abs().max((after.position - before.position).abs() / tick_s);
            let jerk = (after.acceleration - before.acceleration).abs() / tick_s;
            let shares = [velocity / (it.velocity * speed), after.acceleration.abs() / it.acceleration, jerk / it.jerk];
            found.worst_share.iter_mut().zip(shares).for_each(|(worst, share)| *worst = worst.max(share));
        }
        if has_started && last.iter().all(|joint| joint.velocity == 0.0 && joint.acceleration == 0.0) {
            let arm = |joints: &[JointState]| joints.iter().map(|joint| joint.position).collect::<Vec<_>>();
            let (from, to) = ((robot.tool)(&arm(&last)), (robot.tool)(&arm(&setpoints)));
            let step_m = from.iter().zip(to).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            found.start_step_mm = found.start_step_mm.max(1e3 * step_m);
        }
        last = setpoints;
        let state = bridge.state(now_s);
        if state.reason == Some(StopReason::Deadline) && has_started {
            if !std::mem::replace(&mut is_stopping, true) {
                found.deadlines[usize::from(slow)] += 1;
                found.braking_s = found.braking_s.max(now_s - deadline_s);
            }
            if state.motion == Motion::Standing {
                let standing_s = &mut found.standing_s[usize::from(slow)];
                *standing_s = standing_s.max(now_s - deadline_s);
            }
        }
        has_started = has_started && state.motion != Motion::Standing;
    }
}

fn wild(lower: f64, upper: f64, rng: &mut impl Rng) -> f64 {
    match rng.random_range(0..40) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => 1e12,
        3 => lower - 1.0,
        _ => rng.random_range(lower..upper),
    }
}

impl Streams {
    /// The measurement in words.
    pub fn text(&self) -> String {
        let [velocity, acceleration, jerk] = self.worst_share;
        format!(
            "{} streams: velocity {velocity:.5}, acceleration {acceleration:.5}, jerk {jerk:.5} of the limits\n\
             {} stops at the deadline: braking after {:.1} ms at most, standing after {:.0} ms; {} in slow mode, standing \
             after {:.0} ms\n{} starts: the tool steps by {:.4} mm at most\n",
            self.count,
            self.deadlines[0],
            1e3 * self.braking_s,
            1e3 * self.standing_s[0],
            self.deadlines[1],
            1e3 * self.standing_s[1],
            self.starts,
            self.start_step_mm
        )
    }
}
