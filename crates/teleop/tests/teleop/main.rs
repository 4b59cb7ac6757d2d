//! Input path without a simulator: raw events to commanded poses, on an arm that follows exactly.

#![allow(clippy::unwrap_used)] // Clippy's exemption covers test functions only, not their helpers.

mod log;
mod streams;

use std::collections::BTreeMap;

use genmanip_assets::panda;
use genmanip_assets::worlds::default_world;
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{CameraMount, EpisodeStart, Observation, Policy, Pose, Seed};
use genmanip_motion::{Chain, IkSettings, InverseKinematics};
use rand::RngExt;

use genmanip_teleop::device::{
    AXES, Control, Decoder, Device, DeviceEvent, ReportLayout, SIX_AXIS_CONTROLLER, SPACE_NAVIGATOR,
};
use genmanip_teleop::mapping::{Axes, Mapping, MappingSettings, OperatorFrame, deflection, shape};
use genmanip_teleop::record::{Hold, Playback, RecordedEvent, events_from_lines, events_to_lines};
use genmanip_teleop::scripted::{VirtualDevice, VirtualKind};
use genmanip_teleop::target::{Limit, Target, TargetSettings};
use genmanip_teleop::{Operator, OperatorKind, TeleopSettings, Teleoperation};

/// Steps of a second.
const RATE: usize = 60;

/// An operator whose arm follows exactly: the commanded poses and widths of each control step.
struct Run {
    policy: Teleoperation,
    poses: Vec<Pose>,
    widths: Vec<f64>,
}

/// Arm at the start: its hand is turned about all axes.
fn start_arm() -> Vec<f64> {
    let offsets = [0.2, 0.1, -0.15, 0.1, 0.2, 0.15, -0.3];
    panda().home.iter().zip(offsets).map(|(home, offset)| home + offset).collect()
}

/// Tool at the start.
fn start() -> Pose {
    panda().tcp_pose(&start_arm())
}

/// Runs `steps` control steps on events by step; `follows` gives the measured pose for a commanded one.
fn run_with(
    settings: TeleopSettings,
    events: Vec<(usize, DeviceEvent)>,
    steps: usize,
    follows: impl Fn(Pose) -> Pose,
) -> Run {
    let events = events.into_iter().enumerate();
    let events = events.map(|(sequence, (step, event))| RecordedEvent { sequence: sequence as u64, step, event });
    let operator = Operator { kind: OperatorKind::Scripted, name: "test".into() };
    let source = Box::new(Playback::new(operator, events.collect()));
    let mut policy = Teleoperation::new(settings, source, &panda(), &default_world()).unwrap();
    let seed = Seed::new(1);
    policy.reset(&EpisodeStart { instruction: String::new(), seed, cameras: Vec::new(), scenario: None }).unwrap();
    let (mut poses, mut widths) = (Vec::new(), Vec::new());
    let kinematics = InverseKinematics::new(Chain::new(&panda()).unwrap(), IkSettings::default());
    let (mut arm, mut requested, mut measured, mut width) = (start_arm(), start(), start(), 0.08);
    for _ in 0..steps {
        let state = [&arm[..], &[width]].concat();
        let named = [
            (Observation::STATE, state.clone()),
            (Observation::COMMAND, state),
            (Observation::TOOL, measured.to_row().to_vec()),
            (Observation::TOOL_TARGET, requested.to_row().to_vec()),
        ];
        let state: BTreeMap<_, _> = named.map(|(key, values)| (key.to_owned(), values)).into();
        let action = policy.act(&Observation { state, ..Observation::default() }).unwrap().actions.remove(0);
        let numbers: Vec<f64> = action.iter().copied().map(f64::from).collect();
        let [x, y, z, qw, qx, qy, qz, w] = numbers[..] else { panic!("{numbers:?}") };
        requested = Pose::from_wxyz_array([x, y, z], [qw, qx, qy, qz]);
        arm = kinematics.follow(&requested, &arm, &[f64::INFINITY; 7]).expect("the arm can follow every command");
        measured = follows(requested);
        width = w;
        poses.push(requested);
        widths.push(w);
    }
    Run { policy, poses, widths }
}

fn run(settings: TeleopSettings, events: Vec<(usize, DeviceEvent)>, steps: usize) -> Run {
    run_with(settings, events, steps, |pose| pose)
}

/// A device that is connected, then deflected from step 1 on, until before `until`.
fn pushed(kind: VirtualKind, axes: [f64; AXES], until: usize) -> Vec<(usize, DeviceEvent)> {
    let mut device = VirtualDevice::new(kind);
    let mut events = vec![(0, device.connected())];
    events.extend(device.events(&[0.0; AXES], &[]).into_iter().map(|event| (0, event)));
    for step in 1..until {
        events.extend(device.events(&axes, &[]).into_iter().map(|event| (step, event)));
    }
    events
}

/// Unlimited, so that gains show.
fn in_frame(frame: OperatorFrame, camera: Option<&str>) -> TeleopSettings {
    TeleopSettings {
        mapping: MappingSettings { frame, ..MappingSettings::default() },
        camera: camera.map(str::to_owned),
        ..TeleopSettings::default()
    }
}

fn unit(axis: usize, sign: f64) -> [f64; AXES] {
    std::array::from_fn(|at| if at == axis { sign } else { 0.0 })
}

#[test]
fn every_axis_of_every_device_moves_as_said_in_every_frame() {
    let (world, robot) = (default_world(), panda());
    let camera = |name: &str| world.cameras.iter().find(|camera| camera.name == name).unwrap();
    let (fixed, wrist) = (camera("static").mount_from_camera, camera("wrist"));
    assert_eq!(wrist.mount, CameraMount::Hand);
    let wrist = start() * robot.hand_from_tcp.inverse() * wrist.mount_from_camera;
    let tool = start();
    // Forward, left and up in the world, as directions of other frames.
    let frames = [
        (OperatorFrame::World, None, [DVec3::X, DVec3::Y, DVec3::Z]),
        (OperatorFrame::Hand, None, [DVec3::Z, -DVec3::Y, DVec3::X].map(|axis| tool.rotation * axis)),
        (OperatorFrame::Camera, Some("static"), [DVec3::Z, -DVec3::X, -DVec3::Y].map(|axis| fixed.rotation * axis)),
        (OperatorFrame::Camera, Some("wrist"), [DVec3::Z, -DVec3::X, -DVec3::Y].map(|axis| wrist.rotation * axis)),
    ];
    let settings = MappingSettings::default();
    for kind in VirtualKind::ALL {
        for (frame, camera, directions) in &frames {
            for axis in 0..AXES {
                for sign in [1.0, -1.0] {
                    let run = run(in_frame(*frame, *camera), pushed(kind, unit(axis, sign), 11), 11);
                    let end = run.poses[10];
                    let (way, turn) = (end.position - tool.position, end.rotation * tool.rotation.inverse());
                    let turn = if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis();
                    let direction = directions[axis % 3] * sign / 6.0;
                    let (want_way, want_turn) = match axis < 3 {
                        true => (direction * settings.linear_m_s, DVec3::ZERO),
                        false => (DVec3::ZERO, direction * settings.angular_rad_s),
                    };
                    let case = format!("{} {frame:?} {camera:?} axis {axis} {sign}", kind.name());
                    assert!(way.distance(want_way) < 1e-6, "{case}: {way} instead of {want_way}");
                    assert!(turn.distance(want_turn) < 1e-6, "{case}: {turn} instead of {want_turn}");
                }
            }
        }
    }
}

/// Commanded poses of readings, without limits of an arm: decoder, mapping and target alone.
fn unlimited(axes: Axes, kind: VirtualKind, deflections: impl Iterator<Item = [f64; AXES]>) -> Vec<Pose> {
    let (mut device, mut decoder) = (VirtualDevice::new(kind), Decoder::default());
    let settings = MappingSettings { frame: OperatorFrame::Camera, ..MappingSettings::default() };
    let mut mapping = Mapping::new(settings, Some(axes));
    let limits = TargetSettings {
        workspace_m: [[-9.0; 3], [9.0; 3]],
        linear_m_s: 1.0,
        angular_rad_s: 9.0,
        ..TargetSettings::default()
    };
    let mut target = Target::new(limits, start());
    decoder.apply(&device.connected()).unwrap();
    let mut poses = Vec::new();
    for deflection in std::iter::once([0.0; AXES]).chain(deflections) {
        device.events(&deflection, &[]).iter().for_each(|event| decoder.apply(event).unwrap());
        let command = mapping.command(&decoder.reading());
        let measured = target.pose();
        assert_eq!(target.advance(&command.twist, 1.0 / RATE as f64, &measured, |_| true), []);
        poses.push(target.pose());
    }
    poses
}

/// Frames fixed in the world and on the hand, at random.
fn frames() -> [Axes; 4] {
    let turned = DQuat::from_rotation_x(1.0) * DQuat::from_rotation_z(2.0);
    [Axes::WORLD, Axes::hand(), Axes::World(turned), Axes::Tool(turned)]
}

#[test]
fn translation_does_not_turn_and_rotation_does_not_move() {
    for axes in frames() {
        for (axis, sign) in (0..AXES).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
            // 0.3 m at 0.2 m/s, 90 degrees at 0.8 rad/s.
            let steps = if axis < 3 { 90 } else { 118 };
            let poses = unlimited(axes, VirtualKind::Gamepad, std::iter::repeat_n(unit(axis, sign), steps));
            let end = poses.last().unwrap();
            let (way_m, turn_rad) = (end.position.distance(start().position), end.angle_to(&start()));
            let wanted = if axis < 3 { (0.3, 0.0) } else { (0.0, 0.8 * 118.0 / 60.0) };
            assert!((way_m - wanted.0).abs() < 1e-12 && (turn_rad - wanted.1).abs() < 1e-7, "{axes:?} {axis} {sign}");
        }
    }
}

#[test]
fn ten_thousand_commands_there_and_back_return() {
    for axes in frames() {
        let mut rng = Seed::new(5).rng();
        let there: Vec<[f64; AXES]> =
            (0..5000).map(|_| std::array::from_fn(|_| f64::from(rng.random_range(-350..=350)) / 350.0)).collect();
        let back: Vec<_> = there.iter().rev().map(|axes| axes.map(|axis| -axis)).collect();
        let poses = unlimited(axes, VirtualKind::SpaceMouse, there.into_iter().chain(back));
        let (farthest, end) = (poses[5000], poses[10_000]);
        assert!(farthest.position.distance(start().position) > 0.01);
        let (off_m, off_deg) = (end.position.distance(start().position), end.angle_to(&start()).to_degrees());
        assert!(off_m < 1e-10 && off_deg < 1e-5, "{axes:?}: {off_m} m, {off_deg} degrees");
        assert!((end.rotation.length() - 1.0).abs() < 1e-9);
    }
}

/// Last control step in which the tool moved.
fn last_motion(run: &Run) -> usize {
    let moved = |step: &usize| run.poses[*step] != run.poses[step - 1];
    (1..run.poses.len()).filter(moved).max().unwrap_or(0)
}

#[test]
fn faults_of_the_input_hold_the_arm_within_100_ms() {
    let forward = unit(2, 1.0);
    // The last event is received before control step 19; steps of 1/60 s, six of which are 100 ms.
    for kind in VirtualKind::ALL {
        for (name, fault) in [
            ("silence", vec![]),
            ("disconnected", vec![DeviceEvent::Disconnected]),
            ("blurred", vec![DeviceEvent::Blurred]),
        ] {
            let mut events = pushed(kind, forward, 20);
            events.extend(fault.into_iter().map(|event| (20, event)));
            let run = run(TeleopSettings::default(), events, 2 * RATE);
            let last = last_motion(&run);
            assert!((19..25).contains(&last), "{} {name}: moved until {last}", kind.name());
        }
    }
}

#[test]
fn a_bare_sign_of_life_keeps_only_a_keyboard_moving() {
    for (kind, moves) in
        [(VirtualKind::SpaceMouse, false), (VirtualKind::Gamepad, false), (VirtualKind::Keyboard, true)]
    {
        let mut events = pushed(kind, unit(2, 1.0), 20);
        events.extend((20..60).map(|step| (step, DeviceEvent::Alive)));
        let last = last_motion(&run(TeleopSettings::default(), events, 60));
        assert_eq!(last > 50, moves, "{}: {last}", kind.name());
    }
}

#[test]
fn a_flood_costs_one_command_per_control_step_and_more_than_that_holds() {
    let flood = |count: usize| {
        let mut device = VirtualDevice::new(VirtualKind::SpaceMouse);
        let mut events = pushed(VirtualKind::SpaceMouse, unit(2, 1.0), 20);
        let many = (0..count).flat_map(|_| device.events(&unit(2, 1.0), &[]));
        events.extend(many.map(|event| (20, event)));
        run(TeleopSettings::default(), events, 40)
    };
    let flooded = flood(10_000);
    let step = |at: usize| flooded.poses[at].position.z - flooded.poses[at - 1].position.z;
    assert!((step(20) - step(19)).abs() < 1e-7, "{} after {}", step(20), step(19));
    assert_eq!(flooded.policy.record().refused, 0);
    let drowned = flood(10_001);
    assert_eq!(last_motion(&drowned), 19);
    assert_eq!(drowned.policy.record().refused, 1);
}

#[test]
fn a_connection_starts_from_a_released_device_and_replays_nothing() {
    let mut device = VirtualDevice::new(VirtualKind::SpaceMouse);
    let mut events = pushed(VirtualKind::SpaceMouse, unit(2, 1.0), 20);
    events.push((20, DeviceEvent::Disconnected));
    // Deflected again for a second, and all of it arrives at once after the new connection.
    events.push((80, device.connected()));
    for _ in 0..60 {
        events.extend(device.events(&unit(2, 1.0), &[]).into_iter().map(|event| (80, event)));
    }
    events.extend(
        (81..100).flat_map(|step| device.events(&unit(2, 1.0), &[]).into_iter().map(move |event| (step, event))),
    );
    let held = run(TeleopSettings::default(), events.clone(), 100);
    assert_eq!(last_motion(&held), 19);
    assert_eq!(held.policy.status().held, Some(Hold::ReleaseFirst));
    // Released once, it moves.
    events.extend(device.events(&[0.0; AXES], &[]).into_iter().map(|event| (100, event)));
    events.extend(device.events(&unit(2, 1.0), &[]).into_iter().map(|event| (101, event)));
    let moved = run(TeleopSettings::default(), events, 102);
    assert_eq!(last_motion(&moved), 101);
}

#[test]
fn controls_act_on_every_device() {
    for kind in [VirtualKind::SpaceMouse, VirtualKind::Gamepad, VirtualKind::Keyboard] {
        let mut device = VirtualDevice::new(kind);
        let mut events = vec![(0, device.connected())];
        let up = unit(2, 1.0);
        let mut push = |step: usize, axes: [f64; AXES], held: &[Control]| {
            events.extend(device.events(&axes, held).into_iter().map(|event| (step, event)));
        };
        push(0, unit(0, 0.0), &[]);
        push(1, up, &[]);
        push(2, up, &[Control::Precision]);
        push(3, up, &[Control::Clutch]);
        push(4, up, &[]);
        push(5, unit(0, 0.0), &[Control::Gripper]);
        for step in 6..90 {
            push(step, unit(0, 0.0), &[Control::Gripper]);
        }
        push(90, unit(0, 0.0), &[]);
        push(91, unit(0, 0.0), &[Control::Gripper]);
        push(92, up, &[Control::Frame]);
        let run = run(TeleopSettings::default(), events, 150);
        let way = |step: usize| {
            run.poses[step].position.z - if step == 0 { start().position.z } else { run.poses[step - 1].position.z }
        };
        let case = kind.name();
        assert!((way(1) - 0.2 / 60.0).abs() < 1e-6, "{case}: {}", way(1));
        assert!((way(2) - 0.05 / 60.0).abs() < 1e-6, "{case}: {}", way(2));
        assert!(way(3).abs() < 1e-7 && way(4).abs() < 1e-7, "{case}: the clutch, and until release");
        // A held button closes once; the next press opens.
        assert!(run.widths[89] < 1e-3 && (run.widths[149] - 0.08).abs() < 1e-3, "{case}");
        let record = run.policy.record();
        assert_eq!(record.frames.last().unwrap().1, OperatorFrame::Hand, "{case}");
        assert!(record.held.iter().any(|held| held.reason == Hold::Clutch && (held.from, held.to) == (3, 4)), "{case}");
    }
}

#[test]
fn the_target_keeps_its_limits_and_says_so() {
    let settings = TargetSettings::default();
    // An arm that stands: it cannot follow.
    let stuck =
        run_with(TeleopSettings::default(), pushed(VirtualKind::SpaceMouse, unit(2, 1.0), 120), 120, |_| start());
    let lead = stuck.poses[119].position.distance(start().position);
    assert!(lead <= settings.lead_m + 1e-6 && lead > settings.lead_m - 0.004, "{lead}");
    assert!(stuck.policy.status().limits.contains(&Limit::Lead));
    // Down to the table, and beyond the border of the workspace.
    let low = run(TeleopSettings::default(), pushed(VirtualKind::SpaceMouse, unit(2, -1.0), 200), 200);
    assert!((low.poses[199].position.z - settings.workspace_m[0][2]).abs() < 1e-6);
    assert_eq!(low.policy.status().limits, [Limit::Workspace]);
    // Out of reach: the target waits in the posture of the arm, and never asks for what the arm cannot follow.
    let mut wide = TeleopSettings::default();
    wide.target.workspace_m = [[-9.0; 3], [9.0; 3]];
    let far = run(wide, pushed(VirtualKind::SpaceMouse, unit(0, 1.0), 400), 400);
    assert!((400 - last_motion(&far)) > 60 && far.policy.status().limits.contains(&Limit::Reach));
    // Translations along two axes at once are faster than one.
    let both = [1.0, 0.0, 1.0, 0.0, 0.0, 0.0];
    let fast = run(TeleopSettings::default(), pushed(VirtualKind::SpaceMouse, both, 10), 10);
    let speed = fast.poses[9].position.distance(fast.poses[8].position) * RATE as f64;
    assert!((speed - settings.linear_m_s).abs() < 1e-5, "{speed}");
    assert_eq!(fast.policy.record().limited[0].reason, Limit::Speed);
}

#[test]
fn recorded_events_give_the_same_commands() {
    let mut rng = Seed::new(8).rng();
    for kind in VirtualKind::ALL {
        let mut device = VirtualDevice::new(kind);
        let mut events = vec![(0, device.connected())];
        for step in 0..200 {
            let axes = if step == 0 { [0.0; AXES] } else { std::array::from_fn(|_| rng.random_range(-1.0..=1.0)) };
            events.extend(device.events(&axes, &[]).into_iter().map(|event| (step, event)));
        }
        let first = run(TeleopSettings::default(), events, 200);
        let lines = events_to_lines(first.policy.events());
        let read = events_from_lines(std::str::from_utf8(&lines).unwrap()).unwrap();
        assert_eq!(read, first.policy.events());
        let again =
            run(TeleopSettings::default(), read.into_iter().map(|event| (event.step, event.event)).collect(), 200);
        assert_eq!(first.poses, again.poses, "{}", kind.name());
        assert!(last_motion(&first) > 190);
    }
    let error = events_from_lines("{\"sequence\":1,\"step\":0,\"event\":{\"type\":\"alive\"}}").unwrap_err();
    assert!(error.to_string().contains("line 1"), "{error}");
}

/// Browsers tell a page the items of a report descriptor, from which the page writes another: its layout is the same.
#[test]
fn the_descriptor_that_the_page_writes_has_the_layout_of_the_device() {
    let file: serde_json::Value =
        serde_json::from_str(include_str!("../../testdata/space_navigator_webhid.json")).unwrap();
    let connected = serde_json::json!({ "kind": "space_mouse", "name": "", "descriptor": file["descriptor"] });
    let Ok(Device::SpaceMouse { descriptor, .. }) = serde_json::from_value(connected) else { panic!("no SpaceMouse") };
    assert_eq!(ReportLayout::parse(&descriptor).unwrap(), ReportLayout::parse(SPACE_NAVIGATOR).unwrap());
}

#[test]
fn reports_are_read_by_the_descriptor() {
    let read = |descriptor: &[u8], report: &[u8]| {
        let (mut axes, mut buttons) = ([0.0; AXES], 0);
        let applied = ReportLayout::parse(descriptor).unwrap().apply(report, &mut axes, &mut buttons);
        applied.map(|()| (axes.map(|axis| (axis * 350.0).round()), buttons))
    };
    let first = read(SPACE_NAVIGATOR, &[0x01, 0x76, 0, 0, 0, 0xfa, 0xff]).unwrap();
    assert_eq!(first, ([118.0, 0.0, -6.0, 0.0, 0.0, 0.0], 0));
    let second = read(SPACE_NAVIGATOR, &[0x02, 0x5e, 0x01, 0xa2, 0xfe, 0x01, 0]).unwrap();
    assert_eq!(second, ([0.0, 0.0, 0.0, 350.0, -350.0, 1.0], 0));
    assert_eq!(read(SPACE_NAVIGATOR, &[0x03, 0x02, 0x00]).unwrap().1, 2);
    let all = read(SIX_AXIS_CONTROLLER, &[1, 1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6, 0]).unwrap();
    assert_eq!(all.0, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    // Cut off: what is there counts.
    assert_eq!(read(SIX_AXIS_CONTROLLER, &[1, 1, 0, 2]).unwrap().0, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert!(read(SPACE_NAVIGATOR, &[9, 1]).is_err() && read(SPACE_NAVIGATOR, &[]).is_err());
    // Without report ids, from 0 to 255, in five bits after three of padding.
    let plain = [
        0x05, 0x01, 0x09, 0x04, 0xa1, 0x01, 0x75, 0x03, 0x95, 0x01, 0x81, 0x03, 0x09, 0x31, 0x15, 0x00, 0x25, 0x1e,
        0x75, 0x05, 0x95, 0x01, 0x81, 0x02, 0xc0,
    ];
    assert_eq!(read(&plain, &[0xf7]).unwrap().0, [0.0, 350.0, 0.0, 0.0, 0.0, 0.0]);
}

#[test]
fn broken_descriptors_are_refused() {
    let refused = |descriptor: &[u8]| ReportLayout::parse(descriptor).unwrap_err().to_string();
    for (descriptor, expected) in [
        (&[][..], "one of the axes"),
        (&[0x05], "byte 0: expected a complete item"),
        (&[0xfe, 0x20], "one of the axes"),
        (&[0xb4], "a push before every pop"),
        (&[0x75, 0x40], "at most 32 bits"),
        (&[0x85, 0x00], "a report id"),
        (&[0x05, 0x01, 0x09, 0x30, 0x75, 0x08, 0x95, 0x01, 0x81, 0x02], "a range of values"),
        (&[0x05, 0x01, 0x29, 0x30], "a usage minimum"),
        (&[0; 5000], "at most 4096 bytes"),
    ] {
        let message = refused(descriptor);
        assert!(message.contains(expected), "{descriptor:?}: {message}");
    }
    // Mutated descriptors and reports may be refused, but neither panic nor give values out of range.
    let mut rng = Seed::new(3).rng();
    let mut read = 0;
    for _ in 0..20_000 {
        let mut descriptor = SPACE_NAVIGATOR.to_vec();
        for _ in 0..rng.random_range(1..6) {
            let at = rng.random_range(0..descriptor.len());
            descriptor[at] = rng.random_range(0..=255);
        }
        descriptor.truncate(rng.random_range(1..=descriptor.len()));
        let Ok(layout) = ReportLayout::parse(&descriptor) else { continue };
        let report: Vec<u8> = (0..rng.random_range(0..16)).map(|_| rng.random_range(0..4)).collect();
        let (mut axes, mut buttons) = ([0.0; AXES], 0);
        read += usize::from(layout.apply(&report, &mut axes, &mut buttons).is_ok());
        assert!(axes.iter().all(|axis| axis.abs() <= 1.0));
    }
    assert!(read > 100, "{read}");
}

#[test]
fn events_of_other_devices_are_refused() {
    let mut decoder = Decoder::default();
    let key = DeviceEvent::Key { code: "KeyW".into(), down: true };
    assert!(decoder.apply(&key).unwrap_err().to_string().contains("connected device is none"));
    decoder.apply(&DeviceEvent::Connected { device: Device::Gamepad { name: "pad".into() } }).unwrap();
    assert!(decoder.apply(&key).is_err() && decoder.apply(&DeviceEvent::Report { bytes: vec![1] }).is_err());
    for (axes, buttons) in
        [(vec![0.0; 4], vec![0.0; 12]), (vec![0.0; 2], vec![0.0; 17]), (vec![f64::NAN; 4], vec![0.0; 17])]
    {
        assert!(decoder.apply(&DeviceEvent::Gamepad { axes, buttons }).is_err());
    }
    assert_eq!(decoder.reading().axes, [0.0; AXES]);
}

#[test]
fn response_curve_and_its_inverse() {
    let settings = MappingSettings::default();
    assert_eq!([0.0, 0.1, -0.1, 1.0, -1.0, 2.0].map(|axis| shape(axis, &settings)), [0.0, 0.0, 0.0, 1.0, -1.0, 1.0]);
    for shaped in [-1.0, -0.3, 0.0, 0.01, 0.5, 1.0] {
        assert!((shape(deflection(shaped, &settings), &settings) - shaped).abs() < 1e-12);
    }
    let unknown = TeleopSettings { camera: Some("roof".into()), ..TeleopSettings::default() };
    let source = Playback::new(Operator { kind: OperatorKind::Person, name: String::new() }, Vec::new());
    let error = Teleoperation::new(unknown, Box::new(source), &panda(), &default_world()).err().unwrap();
    assert!(error.contains("static") && error.contains("`roof`"), "{error}");
}

#[test]
fn a_silent_source_holds_until_its_next_event_and_pressed_controls_need_no_device() {
    let key = |step, down| (step, DeviceEvent::Key { code: "KeyR".into(), down });
    let mut events = vec![(0, DeviceEvent::Connected { device: Device::Keyboard }), key(5, true)];
    events.extend((6..40).filter(|step| !(15..25).contains(step)).map(|step| (step, DeviceEvent::Alive)));
    events.push((15, DeviceEvent::Silent));
    events.push((30, DeviceEvent::Pressed { control: Control::Gripper }));
    events.sort_by_key(|(step, _)| *step);
    let run = run(TeleopSettings::default(), events, 40);
    let rises: Vec<bool> = run.poses.windows(2).map(|pair| pair[1].position.z - pair[0].position.z > 1e-6).collect();
    assert!(rises[5..14].iter().all(|rises| *rises) && rises[25..39].iter().all(|rises| *rises), "{rises:?}");
    assert!(!rises[14..24].iter().any(|rises| *rises), "held from the first step on: {rises:?}");
    assert!(run.widths[39] < run.widths[29], "{:?}", run.widths);
}

#[test]
fn a_flood_replays_to_the_same_poses() {
    let mut settings = TeleopSettings::default();
    settings.input.most_events = 20;
    let mut events = vec![(0, DeviceEvent::Connected { device: Device::Keyboard })];
    events.extend((5..10).map(|step| (step, DeviceEvent::Key { code: "KeyR".into(), down: true })));
    events.extend(std::iter::repeat_n((10, DeviceEvent::Key { code: "KeyR".into(), down: true }), 50));
    events.extend((11..20).map(|step| (step, DeviceEvent::Alive)));
    let first = run(settings.clone(), events, 20);
    assert_eq!(first.poses[9].position, first.poses[19].position, "the keys are released");
    let recorded = first.policy.events().iter().map(|event| (event.step, event.event.clone())).collect();
    assert_eq!(run(settings, recorded, 20).poses, first.poses);
}
