use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use genmanip_assets::panda;
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{
    ActionFrame, ActionSpace, ActionSpec, DeltaFrom, GripperEncoding, GripperSpec, Interpolation, Pose, RobotModel,
    RotationEncoding,
};
use genmanip_motion::{Chain, IkSettings, InverseKinematics};
use proptest::prelude::*;

use super::{Adapter, AdapterError, ArmReference, Pending};

const SPACES: [ActionSpace; 6] = [
    ActionSpace::JointPosition,
    ActionSpace::JointDegrees,
    ActionSpace::JointDelta,
    ActionSpace::JointVelocity,
    ActionSpace::EePose,
    ActionSpace::EeDelta,
];
const REFERENCES: [DeltaFrom; 3] = [DeltaFrom::Command, DeltaFrom::Measured, DeltaFrom::ChunkStart];
const ROTATIONS: [RotationEncoding; 5] = [
    RotationEncoding::QuatWxyz,
    RotationEncoding::QuatXyzw,
    RotationEncoding::SixD,
    RotationEncoding::FixedXyzEuler,
    RotationEncoding::AxisAngle,
];
const GRIPPERS: [GripperEncoding; 7] = [
    GripperEncoding::OpenPercent,
    GripperEncoding::WidthM,
    GripperEncoding::OpenFraction,
    GripperEncoding::ClosedFraction,
    GripperEncoding::PlusOneOpen,
    GripperEncoding::PlusOneClosed,
    GripperEncoding::Closed255,
];

fn robot() -> Arc<RobotModel> {
    panda()
}

/// Actions at 15 Hz, four control steps each.
fn adapter(spec: ActionSpec) -> Adapter {
    Adapter::new(spec, &robot(), &IkSettings::default(), 1.0 / 60.0, 4).unwrap()
}

static NOTHING: Pending = Pending { requested: None, path: Vec::new(), posture: None };

/// Reference of an arm at its target, with the gripper open.
fn at(arm: &[f64]) -> ArmReference<'_> {
    ArmReference { command: arm, width_m: 0.08, measured: arm, chunk_start: arm, pending: &NOTHING }
}

/// Every action specification except thresholds.
fn any_spec() -> impl Strategy<Value = ActionSpec> {
    let frames = [ActionFrame::World, ActionFrame::EndEffector];
    let indices = (0..SPACES.len(), 0..REFERENCES.len(), 0..frames.len(), 0..ROTATIONS.len(), 0..GRIPPERS.len());
    (indices, any::<bool>()).prop_map(move |((space, reference, frame, rotation, gripper), is_linear)| ActionSpec {
        between: if is_linear { Interpolation::Linear } else { Interpolation::Hold },
        delta_from: REFERENCES[reference],
        // Absolute poses are always in the world frame.
        frame: if SPACES[space] == ActionSpace::EePose { ActionFrame::World } else { frames[frame] },
        rotation: ROTATIONS[rotation],
        ..ActionSpec::new(SPACES[space], GRIPPERS[gripper])
    })
}

/// A configuration well within the limits, and three small steps from it.
fn any_motion() -> impl Strategy<Value = [Vec<f64>; 4]> {
    let shares = || prop::collection::vec(0.15..0.85_f64, 7);
    let steps = || prop::collection::vec(-0.08..0.08_f64, 7);
    (shares(), steps(), steps(), steps()).prop_map(|(shares, a, b, c)| {
        let robot = robot();
        let at = |step: &[f64]| {
            let joints = robot.arm_joints().zip(&shares).zip(step);
            joints.map(|((joint, share), step)| joint.lower + share * (joint.upper - joint.lower) + step).collect()
        };
        [at(&[0.0; 7]), at(&a), at(&b), at(&c)]
    })
}

proptest! {
    /// Converting to a space and back gives the same joint targets, or at least the same tcp pose unless the arm lags,
    /// and the same opening.
    #[test]
    fn every_specification_round_trips(
        spec in any_spec(), [command, measured, chunk_start, target] in any_motion(), width in 0.0..0.08_f32,
    ) {
        let (adapter, robot) = (adapter(spec), robot());
        // A command leads by little, so that it is a reference as it is.
        let measured: Vec<f64> = match spec.delta_from {
            DeltaFrom::Command => command.iter().zip(&measured).map(|(q, at)| q + 0.05 * (at - q)).collect(),
            DeltaFrom::Measured | DeltaFrom::ChunkStart => measured,
        };
        let from = ArmReference { command: &command, width_m: 0.03, measured: &measured, chunk_start: &chunk_start, pending: &NOTHING };
        let wanted: Vec<f32> = target.iter().map(|&q| q as f32).chain([width]).collect();
        let action = spec.encode(&robot, &wanted, &adapter.reference(from), 4.0 / 60.0);
        prop_assert_eq!(action.len(), spec.length(7));
        let native = adapter.to_native(&action, from).unwrap();
        let commands = &native.commands;
        prop_assert_eq!(commands.len(), 4);
        let last = commands.last().unwrap();
        prop_assert!((last[7] - width).abs() < 1e-6, "{} for {}", last[7], width);
        let arm: Vec<f64> = last[..7].iter().map(|&q| f64::from(q)).collect();
        if spec.space.is_joint() {
            let largest = arm.iter().zip(&target).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            prop_assert!(largest < 1e-6, "{largest} rad");
        } else {
            let (reached, goal) = (robot.tcp_pose(&arm), robot.tcp_pose(&target));
            let is_there = reached.position.distance(goal.position) < 1e-5 && reached.angle_to(&goal) < 2e-3;
            // Near a singularity the joints may be too slow; the adapter then reports a remaining path.
            prop_assert!(is_there || !native.pending.path.is_empty(), "{reached:?} for {goal:?}");
        }
        prop_assert!(last.iter().all(|value| value.is_finite()));
    }

    #[test]
    fn rotations_survive_every_encoding(q in prop::array::uniform4(-1.0..1.0_f64)) {
        prop_assume!(q.iter().map(|v| v * v).sum::<f64>() > 0.01);
        let wanted = DQuat::from_array(q).normalize();
        for encoding in ROTATIONS {
            let numbers = encoding.encode(wanted);
            prop_assert_eq!(numbers.len(), encoding.length());
            let back = encoding.decode(&numbers).unwrap();
            prop_assert!(back.dot(wanted).abs() > 1.0 - 1e-9, "{encoding:?}: {back} for {wanted}");
        }
    }
}

/// Gripper encodings at both ends, with a threshold, and beyond the range.
#[test]
fn grippers_open_and_close_in_the_right_direction() {
    let home = robot().home.clone();
    let from = at(&home);
    let width = |encoding, binary_threshold, number: f32| {
        let spec = ActionSpec {
            gripper: GripperSpec { encoding, binary_threshold },
            ..ActionSpec::new(ActionSpace::JointPosition, encoding)
        };
        let action: Vec<f32> = home.iter().map(|&q| q as f32).chain([number]).collect();
        adapter(spec).to_native(&action, from).unwrap().commands[0][7]
    };
    let cases = [
        (GripperEncoding::WidthM, None, [(0.0, 0.0), (0.03, 0.03), (0.08, 0.08)]),
        (GripperEncoding::OpenFraction, None, [(0.0, 0.0), (0.5, 0.04), (1.0, 0.08)]),
        (GripperEncoding::ClosedFraction, None, [(0.0, 0.08), (0.75, 0.02), (1.0, 0.0)]),
        (GripperEncoding::ClosedFraction, Some(0.5), [(0.5, 0.08), (0.51, 0.0), (7.0, 0.0)]),
        (GripperEncoding::PlusOneOpen, None, [(-1.0, 0.0), (0.0, 0.04), (1.5, 0.08)]),
        (GripperEncoding::PlusOneClosed, None, [(-1.0, 0.08), (0.0, 0.04), (1.0, 0.0)]),
        (GripperEncoding::PlusOneClosed, Some(0.0), [(-0.01, 0.08), (0.0, 0.08), (0.01, 0.0)]),
        (GripperEncoding::WidthM, Some(0.02), [(0.01, 0.0), (0.02, 0.0), (0.021, 0.08)]),
        (GripperEncoding::OpenPercent, None, [(0.0, 0.0), (50.0, 0.04), (100.0, 0.08)]),
        (GripperEncoding::Closed255, None, [(0.0, 0.08), (127.5, 0.04), (255.0, 0.0)]),
    ];
    for (encoding, threshold, numbers) in cases {
        for (number, expected) in numbers {
            let got = width(encoding, threshold, number);
            assert!((got - expected).abs() < 1e-6, "{encoding:?} {threshold:?}: {number} is {got} m, not {expected} m");
        }
    }
}

/// A rotation of 0.1 rad about the world's x axis and about the tool's, starting with the tool pointing down.
#[test]
fn deltas_use_the_frame_of_the_specification() {
    let robot = robot();
    let home = robot.home.clone();
    let from = at(&home);
    let start = robot.tcp_pose(&home);
    for (frame, along, about) in [
        (ActionFrame::World, DVec3::new(0.02, 0.0, 0.0), DVec3::X),
        (
            ActionFrame::EndEffector,
            start.transform_vector(DVec3::new(0.02, 0.0, 0.0)),
            start.transform_vector(DVec3::X),
        ),
    ] {
        let spec = ActionSpec {
            frame,
            rotation: RotationEncoding::AxisAngle,
            ..ActionSpec::new(ActionSpace::EeDelta, GripperEncoding::OpenFraction)
        };
        let commands = adapter(spec).to_native(&[0.02, 0.0, 0.0, 0.1, 0.0, 0.0, 1.0], from).unwrap().commands;
        let arm: Vec<f64> = commands[0][..7].iter().map(|&q| f64::from(q)).collect();
        let expected = Pose::new(start.position + along, DQuat::from_axis_angle(about, 0.1) * start.rotation);
        let reached = robot.tcp_pose(&arm);
        assert!((reached.position - expected.position).length() < 1e-5, "{frame:?}");
        assert!(reached.angle_to(&expected) < 1e-3, "{frame:?}");
    }
}

/// A tool that is requested to move faster than the arm can lags but does not lose distance while the lag is small: deltas
/// are relative to the requested pose, not to the reached one.
#[test]
fn tracking_errors_do_not_accumulate() {
    let robot = robot();
    let spec = ActionSpec {
        rotation: RotationEncoding::AxisAngle,
        ..ActionSpec::new(ActionSpace::EeDelta, GripperEncoding::WidthM)
    };
    let adapter = adapter(spec);
    let run = |step: f32| {
        let (mut command, mut pending) = (robot.home.clone(), Pending::default());
        let mut expected = robot.tcp_pose(&command);
        let mut lag = 0.0_f64;
        let rows = [[0.0, step, 0.0, 0.0, 0.0, 0.0, 0.08], [0.0, 0.02, 0.02, 0.0, 0.0, 0.1, 0.08]];
        for row in rows.iter().chain(&[[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.08]; 14]) {
            let native = adapter.to_native(row, ArmReference { pending: &pending, ..at(&command) }).unwrap();
            let change =
                Pose::new(DVec3::new(0.0, row[1].into(), row[2].into()), DQuat::from_rotation_z(row[5].into()));
            expected = ActionFrame::World.apply(&change, &expected);
            for target in &native.commands {
                for ((q, target), joint) in command.iter_mut().zip(target).zip(robot.arm_joints()) {
                    let far = joint.max_velocity / 60.0;
                    *q = f64::from(*target).clamp(*q - far, *q + far);
                }
            }
            pending = native.pending;
            lag = lag.max(robot.tcp_pose(&command).position.distance(expected.position));
        }
        let reached = robot.tcp_pose(&command);
        (lag, reached.position.distance(expected.position).max(1e-2 * reached.angle_to(&expected)))
    };
    let runs: Vec<(f64, f64)> = (4..26_u8).map(|step| run(0.01 * f32::from(step))).collect();
    let lags = runs.iter().filter(|(lag, _)| (0.004..0.019).contains(lag));
    assert!(lags.clone().count() > 0, "no step makes the arm lag a little: {runs:?}");
    for (lag, missed) in lags {
        assert!(*missed < 1e-5, "{missed} m are lost after a lag of {lag} m");
    }
}

#[test]
fn a_blocked_arm_does_not_wind_up() {
    let robot = robot();
    for (space, step) in [
        (ActionSpace::EeDelta, vec![0.0, 0.0, -0.05, 0.0, 0.0, 0.0]),
        (ActionSpace::JointDelta, vec![0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0]),
        (ActionSpace::JointVelocity, vec![0.0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ] {
        let spec =
            ActionSpec { rotation: RotationEncoding::AxisAngle, ..ActionSpec::new(space, GripperEncoding::WidthM) };
        let adapter = adapter(spec);
        let (blocked, mut command, mut pending) = (robot.home.clone(), robot.home.clone(), Pending::default());
        let here = robot.tcp_pose(&blocked);
        let mut below = Vec::new();
        for sign in [1.0_f32; 8].into_iter().chain([-1.0; 2]) {
            let row: Vec<f32> = step.iter().map(|&part| sign * part).chain([0.08]).collect();
            let from = ArmReference {
                command: &command,
                width_m: 0.08,
                measured: &blocked,
                chunk_start: &blocked,
                pending: &pending,
            };
            let native = adapter.to_native(&row, from).unwrap();
            command = native.commands[3][..7].iter().map(|&q| f64::from(q)).collect();
            pending = native.pending;
            below.push(here.position.z - robot.tcp_pose(&command).position.z);
        }
        let deepest = below.iter().copied().fold(0.0, f64::max);
        assert!((0.02..0.12).contains(&deepest), "{space:?}: {below:?}");
        assert!(below[7] - below[1] < 1e-3, "{space:?} winds up: {below:?}");
        assert!(below[9] < -0.005, "{space:?}: the second action back does not lead away: {below:?}");
    }
}

/// A lagging tool stays on its path, and no joint exceeds its velocity limit. Without that limit, the tool would have
/// been on time.
#[test]
fn a_lagging_tool_stays_on_its_path() {
    let robot = robot();
    let spec = ActionSpec {
        rotation: RotationEncoding::AxisAngle,
        ..ActionSpec::new(ActionSpace::EePose, GripperEncoding::WidthM)
    };
    let adapter = adapter(spec);
    // A quarter circle about the base in half a second, then a rest to catch up.
    let start = robot.tcp_pose(&robot.home);
    let requested: Vec<Pose> = (1..=30)
        .map(|row: i32| {
            let turn = DQuat::from_rotation_z(f64::from(row.min(8)) / 8.0 * FRAC_PI_2);
            Pose::new(turn * start.position, turn * start.rotation)
        })
        .collect();
    let (mut command, mut pending) = (robot.home.clone(), Pending::default());
    let (mut max_lag, mut off) = (0.0_f64, 0.0_f64);
    for wanted in &requested {
        let rotation = spec.rotation.encode(wanted.rotation);
        let row: Vec<f32> =
            wanted.position.to_array().iter().chain(&rotation).map(|&x| x as f32).chain([0.08]).collect();
        let native = adapter.to_native(&row, ArmReference { pending: &pending, ..at(&command) }).unwrap();
        // Four control steps per action: its targets are within the joint velocity limits.
        for ((q, target), joint) in command.iter().zip(&native.commands[3]).zip(robot.arm_joints()) {
            assert!(
                (f64::from(*target) - q).abs() <= joint.max_velocity * 4.0 / 60.0 + 1e-6,
                "{} too fast",
                joint.name
            );
        }
        for target in &native.commands {
            for ((q, target), joint) in command.iter_mut().zip(target).zip(robot.arm_joints()) {
                let far = joint.max_velocity / 60.0;
                *q = f64::from(*target).clamp(*q - far, *q + far);
            }
            let tool = robot.tcp_pose(&command).position;
            max_lag = max_lag.max(tool.distance(wanted.position));
            // On the circle at the height of the start, except for the 2 mm of chords between rows and for joints that
            // arrive at different times within a row.
            off = off.max((tool.truncate().length() - start.position.truncate().length()).abs());
            off = off.max((tool.z - start.position.z).abs());
        }
        pending = native.pending;
    }
    assert!(max_lag > 0.03, "the tool never lagged: {max_lag} m");
    assert!(off < 0.006, "{off} m off its path");
    assert!(robot.tcp_pose(&command).position.distance(requested[29].position) < 1e-4 && pending.path.is_empty());
}

/// The null space returns to the home posture, here from a configuration with a rotated elbow.
#[test]
fn the_posture_returns_to_home() {
    let robot = robot();
    let spec = ActionSpec {
        rotation: RotationEncoding::AxisAngle,
        ..ActionSpec::new(ActionSpace::EeDelta, GripperEncoding::WidthM)
    };
    let adapter = adapter(spec);
    let ik = InverseKinematics::new(Chain::new(&robot).unwrap(), IkSettings::default());
    let from_home = |q: &[f64]| q.iter().zip(&robot.home).map(|(q, home)| (q - home).powi(2)).sum::<f64>().sqrt();
    let solutions = ik.solve(&robot.tcp_pose(&robot.home), &robot.home);
    let start = solutions.into_iter().find(|q| (0.4..1.2).contains(&from_home(q))).unwrap();
    let (mut command, mut pending) = (start.clone(), Pending::default());
    for row in 0..60 {
        let step = if row % 2 == 0 { 0.002 } else { -0.002 };
        let native = adapter
            .to_native(&[step, 0.0, 0.0, 0.0, 0.0, 0.0, 0.08], ArmReference { pending: &pending, ..at(&command) })
            .unwrap();
        command = native.commands[3][..7].iter().map(|&q| f64::from(q)).collect();
        pending = native.pending;
    }
    let (there, here) = (robot.tcp_pose(&start), robot.tcp_pose(&command));
    assert!(here.position.distance(there.position) < 1e-4 && here.angle_to(&there) < 2e-3, "the tool has moved");
    assert!(from_home(&command) < 0.2 * from_home(&start), "{} of {} rad", from_home(&command), from_home(&start));
}

/// At 0.6 rad/s, each control step adds 0.01 rad.
#[test]
fn velocities_become_a_ramp() {
    let home = robot().home.clone();
    let from = at(&home);
    let spec = ActionSpec::new(ActionSpace::JointVelocity, GripperEncoding::WidthM);
    let commands = adapter(spec).to_native(&[0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.08], from).unwrap().commands;
    for (step, command) in commands.iter().enumerate() {
        let moved = f64::from(command[0]) - home[0];
        assert!((moved - 0.01 * (step + 1) as f64).abs() < 1e-6, "step {step}: {moved} rad");
    }
}

/// Linear interpolation from the command in force; the last command is bit-identical to the target.
#[test]
fn linear_interpolation_ends_at_the_action() {
    let home = robot().home.clone();
    let from = at(&home);
    let mut action: Vec<f32> = home.iter().map(|&q| q as f32).chain([0.04]).collect();
    action[0] += 0.1;
    let spec = |between| ActionSpec { between, ..ActionSpec::native() };
    let linear = adapter(spec(Interpolation::Linear)).to_native(&action, from).unwrap().commands;
    for (step, width) in [0.07, 0.06, 0.05, 0.04].into_iter().enumerate() {
        let moved = f64::from(linear[step][0]) - home[0];
        assert!((moved - 0.025 * (step + 1) as f64).abs() < 1e-6, "step {step}: {moved} rad");
        assert!((linear[step][7] - width).abs() < 1e-6, "step {step}: {} m", linear[step][7]);
    }
    assert_eq!(linear[3], action);
    assert_eq!(adapter(spec(Interpolation::Hold)).to_native(&action, from).unwrap().commands, vec![action; 4]);
}

#[test]
fn invalid_actions_are_rejected() {
    let home = robot().home.clone();
    let from = at(&home);
    let pose = |rotation| ActionSpec { rotation, ..ActionSpec::new(ActionSpace::EePose, GripperEncoding::WidthM) };
    let cases: [(ActionSpec, &[f32], &str); 5] = [
        (ActionSpec::native(), &[0.0; 7], "expected 8 numbers (joint_position, gripper width_m), got 7"),
        (
            pose(RotationEncoding::SixD),
            &[0.0; 8],
            "expected 10 numbers (ee_pose in the world frame with 6d, gripper width_m), got 8",
        ),
        (
            pose(RotationEncoding::QuatWxyz),
            &[0.5, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.08],
            "a quaternion, w first, got [0.0",
        ),
        (
            pose(RotationEncoding::AxisAngle),
            &[0.5, 0.0, f32::NAN, 0.0, 0.0, 0.0, 0.08],
            "number 2 of the action is NaN",
        ),
        (
            pose(RotationEncoding::AxisAngle),
            &[1.5, 0.0, 0.3, 0.0, 3.1, 0.0, 0.08],
            "no configuration of the arm brings",
        ),
    ];
    for (spec, action, message) in cases {
        let error = adapter(spec).to_native(action, from).unwrap_err();
        assert!(error.to_string().contains(message), "{error}");
    }
    let backwards = ActionSpec { frame: ActionFrame::EndEffector, ..pose(RotationEncoding::QuatWxyz) };
    let error = Adapter::new(backwards, &robot(), &IkSettings::default(), 1.0 / 60.0, 1).unwrap_err();
    assert!(matches!(error, AdapterError::Contract(_)), "{error}");
}

/// A mismatch names both sides; fields that the space does not use are ignored.
#[test]
fn specifications_are_compared_by_their_used_fields() {
    let delta = ActionSpec::new(ActionSpace::EeDelta, GripperEncoding::PlusOneClosed);
    let same = ActionSpec { rotation: RotationEncoding::SixD, ..ActionSpec::native() };
    assert_eq!(ActionSpec::native().require_same(&same), Ok(()));
    let cases = [
        (ActionSpec::native(), "space of the action: expected ee_delta, got joint_position"),
        (
            ActionSpec { delta_from: DeltaFrom::ChunkStart, ..delta },
            "reference of the action: expected command, got chunk_start",
        ),
        (
            ActionSpec { frame: ActionFrame::EndEffector, ..delta },
            "frame of the action: expected world, got end_effector",
        ),
        (ActionSpec { rotation: RotationEncoding::SixD, ..delta }, "expected quat_wxyz, got 6d"),
        (
            ActionSpec::new(ActionSpace::EeDelta, GripperEncoding::PlusOneOpen),
            "gripper of the action: expected plus_one_closed, got plus_one_open",
        ),
    ];
    for (given, message) in cases {
        let error = delta.require_same(&given).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
    let error = delta.require_same(&ActionSpec { between: Interpolation::Linear, ..delta }).unwrap_err().to_string();
    assert!(error.contains("motion between actions of the action: expected hold, got linear"), "{error}");
}
