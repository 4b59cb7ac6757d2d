//! Streams of commands through guard and interpolator.

use genmanip_core::Seed;
use rand::{Rng, RngExt};

use super::*;

mod connection;
mod fake;
mod machine;

const TICK_S: f64 = 1e-3;
/// Share by which a limit may be exceeded.
const SLACK: f64 = 1.001;

/// Checks one tick of all joints against the limits.
#[track_caller]
fn check_tick(before: &[JointState], after: &[JointState], limits: &[JointLimits], what: &str) {
    for ((before, after), limits) in before.iter().zip(after).zip(limits) {
        let jerk = (after.acceleration - before.acceleration).abs() / TICK_S;
        let speed = (after.position - before.position).abs() / TICK_S;
        assert!(jerk <= limits.jerk * SLACK, "{what}: jerk {jerk} {before:?} {after:?}");
        assert!(after.acceleration.abs() <= limits.acceleration * SLACK, "{what}: {after:?}");
        assert!(
            after.velocity.abs() <= limits.velocity * SLACK && speed <= limits.velocity * SLACK,
            "{what}: {after:?}"
        );
        assert!(after.position.is_finite(), "{what}: {after:?}");
    }
}

fn guard(limits: &[JointLimits], measured: &[f64]) -> (Guard, u64) {
    let mut guard = Guard::new(limits, measured, GuardSettings::default()).unwrap();
    let lease = guard.acquire(0.0).unwrap();
    guard.start(0.0, lease, true, measured).unwrap();
    (guard, lease)
}

fn command(lease: u64, sequence: u64, positions: Vec<f64>) -> Command {
    Command { lease, sequence, valid_for_s: 0.1, dead_man: true, positions, over_s: 0.0, width_m: None }
}

#[test]
fn no_stream_of_targets_violates_a_limit() {
    let (mut stops, mut fast) = (0, 0);
    for stream in 0..10_000 {
        let rng = &mut Seed::new(57).fork_index(stream).rng();
        let count = rng.random_range(1..=2);
        let all = JointLimits::PANDA.map(|limits| if stream % 3 == 0 { limits.slowed(0.1) } else { limits });
        let limits: Vec<JointLimits> = (0..count).map(|_| all[rng.random_range(0..7)]).collect();
        let home: Vec<f64> = limits.iter().map(|it| rng.random_range(it.lower..it.upper)).collect();
        let (mut guard, lease) = guard(&limits, &home);
        let mut sequence = 10_u64;
        // Half of the streams keep their targets for a while, so that joints get up to speed.
        let change = if stream % 2 == 0 { 1.0 } else { 0.03 };
        let mut positions = home.clone();
        let (mut now_s, mut silent_until) = (0.0, 0.0);
        let mut last = guard.joints().to_vec();
        for _ in 0..150 {
            // Bursts, gaps, late numbers, numbers that are none, jumps to anywhere.
            if now_s >= silent_until {
                for _ in 0..[0, 0, 1, 1, 5][rng.random_range(0..5)] {
                    sequence = sequence.saturating_add_signed([1, 1, 1, 3, -2, 0][rng.random_range(0..6)]);
                    if rng.random_bool(change) {
                        positions = limits.iter().map(|it| target(it, rng)).collect();
                    }
                    let mut command = command(lease, sequence, positions.clone());
                    command.valid_for_s = [0.1, 0.02, 1.0, f64::NAN, -1.0, 1e9][rng.random_range(0..6)];
                    command.over_s = [0.0, 0.0, 0.02, 0.1, f64::NAN][rng.random_range(0..5)];
                    command.dead_man = rng.random_bool(0.998);
                    let _ = guard.command(now_s, &command);
                }
                if rng.random_bool(0.02) {
                    silent_until = now_s + rng.random_range(0.0..0.06);
                }
            }
            now_s += TICK_S;
            let joints = guard.tick(now_s).to_vec();
            check_tick(&last, &joints, &limits, &format!("stream {stream} at {now_s}"));
            last = joints;
            fast += usize::from(last.iter().zip(&limits).any(|(joint, it)| joint.velocity.abs() > 0.99 * it.velocity));
            if guard.is_at_rest() && guard.mode() != Mode::Following {
                stops += 1;
                let measured: Vec<f64> = last.iter().map(|joint| joint.position).collect();
                guard.start(now_s, lease, true, &measured).unwrap();
            }
        }
    }
    assert!(stops > 1_000 && fast > 10_000, "{stops} stops, {fast} ticks at full speed: the streams try too little");
}

fn target(limits: &JointLimits, rng: &mut impl Rng) -> f64 {
    match rng.random_range(0..12) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => 1e12,
        3 => limits.lower - 1.0,
        _ => rng.random_range(limits.lower..limits.upper),
    }
}

#[test]
fn targets_are_reached_as_fast_as_the_limits_allow() {
    for limits in JointLimits::PANDA {
        let (from, to) = (limits.lower + 0.3, limits.upper - 0.3);
        let mut interpolator = Interpolator::new(&[limits], &[from], TICK_S).unwrap();
        assert!(
            interpolator.aim(&[to], 0.0) && !interpolator.aim(&[f64::NAN], 0.0) && !interpolator.aim(&[0.0, 0.0], 0.0)
        );
        let mut ticks = 0;
        let mut farthest = f64::MIN;
        while !(interpolator.is_at_rest() && (interpolator.joints()[0].position - to).abs() < 1e-6) {
            farthest = farthest.max(interpolator.tick()[0].position);
            ticks += 1;
            assert!(ticks < 5_000, "{limits:?} {:?}", interpolator.joints());
        }
        let JointLimits { velocity, acceleration, jerk, .. } = limits;
        let fastest_s = (to - from) / velocity + velocity / acceleration + acceleration / jerk;
        assert!(f64::from(ticks) * TICK_S < fastest_s + 0.02, "{limits:?}: {ticks} ticks, {fastest_s} s");
        // The fastest way switches within ticks: a fifth of a millimetre at the end of an arm of 1 m.
        assert!(farthest < to + 2e-4, "{limits:?}: overshoots to {farthest}");
    }
}

#[test]
fn a_stream_is_followed_smoothly_and_without_overshoot() {
    for limits in JointLimits::PANDA {
        let middle = f64::midpoint(limits.lower, limits.upper);
        let mut interpolator = Interpolator::new(&[limits], &[middle], TICK_S).unwrap();
        // A quarter of a sine at 60 Hz that ends abruptly, at 0.6 rad/s in the middle of its course.
        let wanted = |time_s: f64| middle + 0.3 * (1.0 - (2.0 * time_s).cos());
        let (mut worst, mut roughest) = (0.0_f64, 0.0_f64);
        let mut before = 0.0;
        for tick in 0..800 {
            let now_s = f64::from(tick) * TICK_S;
            if tick % 16 == 0 {
                interpolator.aim(&[wanted(now_s)], 0.05);
            }
            let joint = interpolator.tick()[0];
            if tick > 300 {
                worst = worst.max((joint.position - wanted(now_s - 0.05)).abs());
                roughest = roughest.max((joint.acceleration - before).abs() / TICK_S);
            }
            before = joint.acceleration;
        }
        let end = wanted(0.784);
        let mut farthest = f64::MIN;
        for _ in 0..400 {
            farthest = farthest.max(interpolator.tick()[0].position);
        }
        assert!(worst < 8e-3, "{limits:?}: {worst} rad off");
        assert!(farthest < end + 2e-4 && farthest > end - 1e-5, "{limits:?}: {farthest} instead of {end}");
        assert!(roughest <= limits.jerk * SLACK, "{roughest}");
    }
}

/// Joints whose accelerations differ keep to the straight path of a fast stream whose commands come unevenly.
#[test]
fn all_joints_lag_alike() {
    let limits = JointLimits::PANDA;
    let start: Vec<f64> = limits.iter().map(|it| f64::midpoint(it.lower, it.upper)).collect();
    let way = [0.3, 0.5, -0.4, 0.6, 0.1, -0.5, 0.7];
    let length = way.iter().map(|it| it * it).sum::<f64>().sqrt();
    let mut interpolator = Interpolator::new(&limits, &start, TICK_S).unwrap();
    let rng = &mut Seed::new(7).rng();
    let (mut worst_rad, mut next) = (0.0_f64, 0);
    for tick in 0..1500 {
        // There and back, at up to 1.2 rad/s.
        let share = 0.5 - 0.5 * (4.2 * f64::from(tick) * TICK_S).cos();
        if tick == next {
            let target: Vec<f64> = start.iter().zip(way).map(|(from, way)| from + share * way).collect();
            interpolator.aim(&target, 0.05);
            next += rng.random_range(8..26);
        }
        let off: Vec<f64> = interpolator.tick().iter().zip(&start).map(|(joint, from)| joint.position - from).collect();
        let along = off.iter().zip(way).map(|(off, way)| off * way).sum::<f64>() / length;
        let aside = off.iter().zip(way).map(|(off, way)| (off - along * way / length).powi(2)).sum::<f64>().sqrt();
        worst_rad = worst_rad.max(aside);
    }
    assert!(worst_rad < 4e-3, "{worst_rad} rad beside the path");
}

/// Time from the passed deadline to the first braking tick and to rest, s.
fn stop_times(limits: &[JointLimits]) -> (f64, f64) {
    let start: Vec<f64> = limits.iter().map(|it| it.lower + 0.1).collect();
    let far: Vec<f64> = limits.iter().map(|it| it.upper).collect();
    let (mut guard, lease) = guard(limits, &start);
    let (mut now_s, mut sequence) = (0.0, 0);
    while guard.joints().iter().zip(limits).any(|(joint, it)| joint.velocity < 0.999 * it.velocity) {
        sequence += 1;
        guard.command(now_s, &command(lease, sequence, far.clone())).unwrap();
        now_s += TICK_S;
        guard.tick(now_s);
    }
    let deadline_s = now_s - TICK_S + 0.1;
    let mut braking_s = None;
    let mut last = guard.joints().to_vec();
    loop {
        now_s += TICK_S;
        let joints = guard.tick(now_s).to_vec();
        check_tick(&last, &joints, limits, "stop");
        if joints.iter().all(|joint| joint.acceleration < 0.0) && guard.mode() != Mode::Following {
            braking_s = braking_s.or(Some(now_s - deadline_s));
        }
        last = joints;
        if guard.is_at_rest() {
            assert_eq!(guard.mode(), Mode::Stopping(StopReason::Deadline));
            return (braking_s.unwrap(), now_s - deadline_s);
        }
    }
}

#[test]
fn the_arm_brakes_at_the_deadline_and_stands_soon() {
    for (share, most_s) in [(1.0, 0.35), (0.1, 0.1)] {
        // One joint at a time: each has its full speed when the deadline passes.
        for limits in JointLimits::PANDA {
            let (braking_s, rest_s) = stop_times(&[limits.slowed(share)]);
            assert!(braking_s <= 0.02, "{limits:?}: brakes after {braking_s} s");
            assert!(rest_s <= most_s, "{limits:?}: stands after {rest_s} s");
        }
    }
}

#[test]
fn nothing_jumps_at_start_or_resume() {
    let limits = JointLimits::PANDA;
    let home = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8];
    let (mut guard, lease) = guard(&limits, &home);
    let far: Vec<f64> = limits.iter().map(|it| it.upper).collect();
    guard.command(0.0, &command(lease, 1, far.clone())).unwrap();
    let step = |before: &[JointState], after: &[JointState]| -> f64 {
        before.iter().zip(after).map(|(a, b)| (a.position - b.position).abs()).fold(0.0, f64::max)
    };
    let before = guard.joints().to_vec();
    let after = guard.tick(TICK_S).to_vec();
    // An arm of 1.2 m moves by less than a hundredth of a millimetre.
    assert!(step(&before, &after) < 5e-6, "{after:?}");
    let mut now_s = TICK_S;
    while !(guard.is_at_rest() && guard.mode() == Mode::Stopping(StopReason::Deadline)) {
        now_s += TICK_S;
        guard.tick(now_s);
    }
    assert_eq!(guard.command(now_s, &command(lease, 2, far.clone())), Err(Refused::Stopped(StopReason::Deadline)));
    // The arm lags behind its setpoints by a little: they go on from where they are.
    let measured: Vec<f64> = guard.joints().iter().map(|joint| joint.position - 0.003).collect();
    let before = guard.joints().to_vec();
    guard.start(now_s, lease, true, &measured).unwrap();
    guard.command(now_s, &command(lease, 3, far)).unwrap();
    let after = guard.tick(now_s + TICK_S).to_vec();
    assert!(step(&before, &after) < 5e-6, "{after:?}");
    // After a reflex of the arm they go on from where it is.
    let stopped = [0.1; 7];
    guard.arm_stopped(&stopped);
    assert_eq!(guard.mode(), Mode::Stopping(StopReason::Arm));
    assert!(guard.joints().iter().all(|joint| joint.position == 0.1 && joint.velocity == 0.0));
}

#[test]
fn only_the_holder_of_the_lease_moves_the_arm() {
    let limits = [JointLimits::PANDA[0]];
    let mut guard = Guard::new(&limits, &[0.0], GuardSettings::default()).unwrap();
    assert_eq!(guard.command(0.0, &command(1, 1, vec![0.5])), Err(Refused::NoLease(1)));
    let lease = guard.acquire(0.0).unwrap();
    assert!(matches!(guard.acquire(5.0), Err(Refused::Leased { .. })));
    assert_eq!(guard.command(0.0, &command(lease, 1, vec![0.5])), Err(Refused::Stopped(StopReason::NotStarted)));
    assert_eq!(guard.start(0.0, lease, false, &[0.0]), Err(Refused::DeadMan));
    assert_eq!(guard.start(0.0, lease, true, &[]), Err(Refused::Positions { expected: 1 }));
    guard.start(0.0, lease, true, &[0.0]).unwrap();
    let cases = [
        (command(lease + 1, 2, vec![0.5]), Refused::NoLease(lease + 1)),
        (command(lease, 1, vec![0.5]), Refused::Sequence { got: 1, last: 1 }),
        (command(lease, 2, vec![f64::NAN]), Refused::Positions { expected: 1 }),
        (command(lease, 3, vec![0.1, 0.1]), Refused::Positions { expected: 1 }),
        (Command { valid_for_s: 2.0, ..command(lease, 4, vec![0.5]) }, Refused::Validity { got: 2.0, most: 1.0 }),
    ];
    for (command, wanted) in cases {
        assert_eq!(guard.command(0.01, &command), Err(wanted));
    }
    guard.command(0.01, &command(lease, 5, vec![0.5])).unwrap();
    guard.tick(0.011);
    // A released switch stops the arm at once, and stays in force until a new start.
    let released = Command { dead_man: false, ..command(lease, 6, vec![0.5]) };
    assert_eq!(guard.command(0.012, &released), Err(Refused::DeadMan));
    assert_eq!(guard.mode(), Mode::Stopping(StopReason::DeadMan));
    assert_eq!(guard.start(0.012, lease, true, &[0.0]), Err(Refused::Moving));
    // A holder that says nothing loses the lease; the next one gets another number.
    let second = guard.acquire(30.0).unwrap();
    assert!(second > lease && guard.release(30.0, lease, false) == Err(Refused::NoLease(lease)));
    guard.release(30.0, second, false).unwrap();
    guard.acquire(30.0).unwrap();
}
