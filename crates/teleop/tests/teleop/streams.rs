//! Leader arms and trackers: ramp at a mismatch, clutch, silence.

use genmanip_assets::panda;
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_teleop::TeleopSettings;
use genmanip_teleop::device::{Decoder, Device, DeviceEvent};
use genmanip_teleop::record::Hold;
use genmanip_teleop::target::Limit;

use super::{Run, last_motion, run, start, start_arm};

/// A leader arm that is at `joints` from step 1 to before `until`.
fn led(joints: &[f64], until: usize) -> Vec<(usize, DeviceEvent)> {
    let state =
        |gripper: f64| DeviceEvent::Joints { position_rad: joints.to_vec(), gripper: Some(gripper), clutch: false };
    let device = Device::LeaderArm { name: "test".into() };
    let states = (1..until).map(|step| (step, state(if step < 200 { 1.0 } else { 0.0 })));
    std::iter::once((0, DeviceEvent::Connected { device })).chain(states).collect()
}

/// Joint positions of a leader arm that is not where the robot is.
fn elsewhere() -> Vec<f64> {
    let offsets = [0.2, -0.1, 0.1, 0.0, 0.1, 0.0, 0.2];
    start_arm().iter().zip(offsets).map(|(joint, offset)| joint + offset).collect()
}

/// Distances between the poses of successive control steps, m.
fn ways(run: &Run) -> Vec<f64> {
    std::iter::once(&start())
        .chain(&run.poses)
        .collect::<Vec<_>>()
        .windows(2)
        .map(|pair| pair[0].position.distance(pair[1].position))
        .collect()
}

#[test]
fn a_leader_arm_elsewhere_is_approached_slowly_and_then_followed() {
    let settings = TeleopSettings::default();
    let (near_m, ramp_m_s) = (settings.follow.near_m, settings.follow.ramp_m_s);
    let goal = panda().tcp_pose(&elsewhere());
    assert!(goal.position.distance(start().position) > 2.0 * near_m, "the test needs a mismatch");
    let run = run(settings, led(&elsewhere(), 300), 300);
    let ways = ways(&run);
    let caught_up = run.poses.iter().position(|pose| pose.position.distance(goal.position) < near_m).unwrap();
    assert!(ways[..caught_up].iter().all(|way| *way < ramp_m_s / 60.0 + 1e-6), "{ways:?}");
    assert!(ways[1] > 0.9 * ramp_m_s / 60.0, "{}", ways[1]);
    assert!(run.poses[199].position.distance(goal.position) < 1e-3 && run.poses[199].angle_to(&goal) < 0.01);
    let record = run.policy.record();
    let ramp = record.limited.iter().find(|limited| limited.reason == Limit::Ramp).unwrap();
    assert!(ramp.from <= 1 && ramp.to < 200, "{ramp:?}");
    // The gripper closes when the leader's does, not before.
    assert!(run.widths[199] > 0.079 && run.widths[299] < 0.01, "{} {}", run.widths[199], run.widths[299]);
    assert_eq!(record.devices[0].kind(), "leader_arm");
}

#[test]
fn a_stream_that_falls_silent_or_is_disengaged_holds_within_100_ms() {
    let mut events = led(&elsewhere(), 20);
    let silent = run(TeleopSettings::default(), events.clone(), 60);
    let last = last_motion(&silent);
    assert!((19..25).contains(&last), "moved until {last}");
    assert_eq!(silent.policy.status().held, Some(Hold::Silence));
    // Back after a second: it does not jump.
    events.extend(led(&elsewhere(), 140).into_iter().filter(|(step, _)| *step >= 80));
    let back = run(TeleopSettings::default(), events, 140);
    assert!(ways(&back)[80..].iter().all(|way| *way < 0.08 / 60.0 + 1e-6));
    assert!(last_motion(&back) > 100);
    let clutch = DeviceEvent::Joints { position_rad: elsewhere(), gripper: None, clutch: true };
    let mut events = led(&elsewhere(), 20);
    events.extend((20..60).map(|step| (step, clutch.clone())));
    let held = run(TeleopSettings::default(), events, 60);
    assert_eq!((last_motion(&held), held.policy.status().held), (19, Some(Hold::Clutch)));
    let other = run(TeleopSettings::default(), led(&elsewhere()[1..], 20), 20);
    assert_eq!((last_motion(&other), other.policy.status().held), (0, Some(Hold::OtherJoints)));
}

#[test]
fn a_tracker_moves_the_tool_from_where_it_was_engaged() {
    let at = |position_m: [f64; 3], turn_rad: f64, clutch: bool| {
        let turn = DQuat::from_rotation_z(turn_rad);
        let orientation_wxyz = [turn.w, turn.x, turn.y, turn.z];
        DeviceEvent::Pose { position_m, orientation_wxyz, gripper: None, clutch }
    };
    let device = Device::PoseTracker { name: "phone".into(), is_absolute: false };
    let mut events = vec![(0, DeviceEvent::Connected { device })];
    // Engaged anywhere, moved 5 cm up and turned by 0.2 rad; then carried back with the clutch, and moved up again.
    events.extend((1..10).map(|step| (step, at([3.0, 1.0, 2.0], 0.5, false))));
    events.extend((10..90).map(|step| (step, at([3.0, 1.0, 2.05], 0.7, false))));
    events.extend((90..100).map(|step| (step, at([3.0, 1.0, 2.0], 0.5, true))));
    events.extend((100..110).map(|step| (step, at([3.0, 1.0, 2.0], 0.5, false))));
    events.extend((110..190).map(|step| (step, at([3.0, 1.0, 2.03], 0.5, false))));
    let run = run(TeleopSettings::default(), events, 190);
    let rise = |step: usize| run.poses[step].position.z - start().position.z;
    assert!(rise(9).abs() < 1e-6 && (rise(89) - 0.05).abs() < 1e-3, "{} {}", rise(9), rise(89));
    let turned = run.poses[89].rotation * start().rotation.inverse();
    assert!((turned.to_scaled_axis() - DVec3::Z * 0.2).length() < 0.01, "{turned}");
    assert!((rise(109) - rise(89)).abs() < 1e-3 && (rise(189) - 0.08).abs() < 2e-3, "{} {}", rise(109), rise(189));
}

#[test]
fn states_of_streams_that_are_no_numbers_are_refused() {
    let mut decoder = Decoder::default();
    let joints = |value: f64| DeviceEvent::Joints { position_rad: vec![value; 7], gripper: None, clutch: false };
    let pose = |w: f64| DeviceEvent::Pose {
        position_m: [0.0; 3],
        orientation_wxyz: [w, 0.0, 0.0, 0.0],
        gripper: None,
        clutch: false,
    };
    decoder.apply(&DeviceEvent::Connected { device: Device::LeaderArm { name: "test".into() } }).unwrap();
    decoder.apply(&joints(0.1)).unwrap();
    assert!(decoder.apply(&joints(f64::NAN)).is_err() && decoder.apply(&pose(1.0)).is_err());
    decoder
        .apply(&DeviceEvent::Connected { device: Device::PoseTracker { name: "test".into(), is_absolute: true } })
        .unwrap();
    decoder.apply(&pose(1.0)).unwrap();
    assert!(decoder.apply(&pose(0.5)).is_err() && decoder.apply(&pose(0.0)).is_err());
}
