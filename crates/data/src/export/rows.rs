//! Rows of an episode: state, action, end effector, simulator state, camera poses and video.

use genmanip_core::glam::DQuat;
use genmanip_core::{ActionSpace, ActionSpec, Frame, Pose, RobotModel, RotationEncoding};

use super::features::{Feature, Values, VideoFeature};
use super::metadata::EpisodeMetadata;
use super::{EpisodeRows, ExportSettings, ExtraColumns, Source, sampling};
use super::{boxes, privileged};
use crate::frames::pose_to_row;
use crate::{CameraTrack, DataError};

const END_EFFECTOR: [&str; 7] = ["x", "y", "z", "rotation_x", "rotation_y", "rotation_z", "gripper_width"];
const POSE: [&str; 7] = ["x", "y", "z", "qw", "qx", "qy", "qz"];

/// Joint speed below which a row counts as idle, rad/s: above the creep of the gravity-compensated arm while it holds a
/// command.
const IDLE_RAD_PER_S: f64 = 0.01;

/// Control steps covered by one row; never empty.
struct Interval<'a> {
    /// Last frame of the previous row, whose command is in force at the start; `None` in the first row.
    before: Option<&'a Frame>,
    /// State at the start of the row.
    now: &'a Frame,
    /// All control steps until the next row.
    steps: &'a [Frame],
    /// Last control step, whose command is the row's action.
    last: &'a Frame,
}

/// Rows and videos of an episode.
pub fn rows(source: &Source, robot: &RobotModel, settings: &ExportSettings) -> Result<EpisodeRows, DataError> {
    let result = &source.episode.result;
    let (_, stride) = sampling(source.episode.frames.len(), result.control_rate_hz, settings.fps)?;
    check_dimensions(source, robot)?;
    let intervals = intervals(&source.episode.frames, stride);
    let arm: Vec<&str> = robot.arm_joints().map(|joint| joint.name.as_str()).collect();
    let state_names = settings.action.state_names(&arm);
    let state_names: Vec<&str> = state_names.iter().map(String::as_str).collect();
    let is_last = |row: usize| row + 1 == intervals.len();
    let home = &source.episode.scenario.world.robot.home;

    let mut features = vec![
        vectors("observation.state", &state_names, &intervals, |row| {
            settings.action.encode_state(&row.now.joint_position, row.now.gripper_width, robot)
        }),
        actions(&intervals, robot, home, settings),
        vectors("ee.state", &END_EFFECTOR, &intervals, |row| end_effector(&row.now.tcp, row.now.gripper_width)),
        vectors("ee.action", &END_EFFECTOR, &intervals, |row| commanded_end_effector(robot, &row.last.command)),
        quaternions("ee.quaternion", &intervals, robot.tcp_pose(home).rotation),
        vectors("ee.rotation_6d", RotationEncoding::SixD.names(), &intervals, |row| {
            RotationEncoding::SixD.encode(row.now.tcp.rotation).iter().map(|value| *value as f32).collect()
        }),
        flags("is_idle", &intervals, |_, row| is_idle(row)),
        vectors("sim.joint_velocity", &arm, &intervals, |row| {
            row.now.joint_velocity.iter().map(|value| *value as f32).collect()
        }),
        vectors("sim.joint_torque", &arm, &intervals, |row| largest_torques(row.steps)),
        numbers("sim.grip_force", &intervals, |row| largest(row.steps, |step| step.grip_force)),
        numbers("sim.stray_contact_n", &intervals, |row| largest(row.steps, |step| step.stray_contact_n)),
        flags("sim.grasped", &intervals, |_, row| row.now.grasped.is_some()),
    ];
    if settings.has_corrections {
        let from = result.correction.as_ref().map(|correction| correction.from_step);
        // The row in which the expert takes over still counts as the other policy's.
        features.push(flags("is_correction", &intervals, |row, _| from.is_some_and(|from| row * stride >= from)));
    }
    if settings.columns.contains(&ExtraColumns::Sim) {
        let states: Vec<&Frame> = intervals.iter().map(|row| row.now).collect();
        features.extend(privileged::features(&states, &result.id)?);
    }
    if settings.columns.contains(&ExtraColumns::Boxes) {
        for masks in &source.masks {
            features.extend(boxes::features(masks, source.episode.scenario.objects.len(), &result.id)?);
        }
    }
    features.extend(source.tracks.iter().map(|track| camera_poses(track, intervals.len())));
    features.push(flags("next.done", &intervals, |row, _| is_last(row)));
    features.push(flags("next.success", &intervals, |row, _| is_last(row) && result.success));

    let video = |track: &CameraTrack| VideoFeature {
        key: format!("observation.images.{}", track.camera.name),
        video: track.video.clone(),
        colors: track.colors.clone(),
    };
    let metadata = EpisodeMetadata::of(source, settings);
    Ok(EpisodeRows {
        frames: intervals.len(),
        steps: (0..intervals.len()).map(|row| metadata.steps.at(row * stride)).collect(),
        features,
        images: Vec::new(),
        videos: source.tracks.iter().map(video).collect(),
        metadata,
    })
}

fn intervals(frames: &[Frame], stride: usize) -> Vec<Interval<'_>> {
    let mut before = None;
    let mut intervals = Vec::with_capacity(frames.len().div_ceil(stride));
    for steps in frames.chunks(stride) {
        if let [now, ..] = steps
            && let Some(last) = steps.last()
        {
            intervals.push(Interval { before, now, steps, last });
            before = Some(last);
        }
    }
    intervals
}

/// The `action` column: each row leads from the command in force at its start (the robot's home in the first row) to
/// the last command of its interval.
fn actions(rows: &[Interval<'_>], robot: &RobotModel, home: &[f64], settings: &ExportSettings) -> Feature {
    let spec = settings.action;
    let joints: Vec<&str> = robot.arm_joints().map(|joint| joint.name.as_str()).collect();
    let duration_s = 1.0 / f64::from(settings.fps);
    // Rounded to single precision, as commands are.
    let in_force = |row: &Interval<'_>| -> Vec<f64> {
        match row.before {
            Some(frame) => frame.command.iter().take(joints.len()).map(|&target| f64::from(target)).collect(),
            None => home.iter().map(|&joint| f64::from(joint as f32)).collect(),
        }
    };
    let mut actions: Vec<Vec<f32>> =
        rows.iter().map(|row| spec.encode(robot, &row.last.command, &in_force(row), duration_s)).collect();
    if has_free_sign(&spec) {
        let home = spec.rotation.encode(robot.tcp_pose(home).rotation);
        make_sign_continuous(&home, actions.iter_mut().map(|action| &mut action[3..7]));
    }
    let names = spec.names(&joints);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    Feature::new("action", &names, Values::F32(actions.concat()))
}

/// True if the rotation is encoded as a quaternion whose sign is arbitrary. Rotation changes have w near 1, so their
/// sign is fixed.
fn has_free_sign(spec: &ActionSpec) -> bool {
    let is_quaternion = matches!(spec.rotation, RotationEncoding::QuatWxyz | RotationEncoding::QuatXyzw);
    spec.space == ActionSpace::EePose && is_quaternion
}

/// Tool orientation as quaternion, w first, with a continuous sign.
fn quaternions(key: &str, rows: &[Interval<'_>], home: DQuat) -> Feature {
    let encode = |rotation| RotationEncoding::QuatWxyz.encode(rotation);
    let mut values: Vec<f32> =
        rows.iter().flat_map(|row| encode(row.now.tcp.rotation)).map(|value| value as f32).collect();
    make_sign_continuous(&encode(home), values.chunks_exact_mut(4));
    Feature::new(key, RotationEncoding::QuatWxyz.names(), Values::F32(values))
}

/// Chooses the sign of each quaternion such that it is nearest to its predecessor; the first is compared with the tool
/// orientation at home, so that all episodes lie in the same hemisphere.
fn make_sign_continuous<'a>(home: &[f64], quaternions: impl Iterator<Item = &'a mut [f32]>) {
    let mut previous: Vec<f32> = home.iter().map(|&value| value as f32).collect();
    for quaternion in quaternions {
        let along: f32 = previous.iter().zip(quaternion.iter()).map(|(a, b)| a * b).sum();
        if along < 0.0 {
            quaternion.iter_mut().for_each(|value| *value = -*value);
        }
        previous.copy_from_slice(quaternion);
    }
}

/// True if the command does not change and no joint moves within the row.
fn is_idle(row: &Interval<'_>) -> bool {
    let command = row.before.map_or(&row.now.command, |before| &before.command);
    row.steps
        .iter()
        .all(|step| step.command == *command && step.joint_velocity.iter().all(|speed| speed.abs() < IDLE_RAD_PER_S))
}

fn check_dimensions(source: &Source, robot: &RobotModel) -> Result<(), DataError> {
    let dof = robot.arm_dof();
    let id = &source.episode.result.id;
    if source.episode.scenario.world.robot.name != robot.name {
        return Err(DataError::mismatch(
            format!("robot of episode {id}"),
            &robot.name,
            &source.episode.scenario.world.robot.name,
        ));
    }
    for (index, frame) in source.episode.frames.iter().enumerate() {
        let got = [
            frame.joint_position.len(),
            frame.joint_velocity.len(),
            frame.joint_torque.len(),
            frame.command.len().saturating_sub(1),
        ];
        if got.iter().any(|length| *length != dof) {
            let what = format!("arm joints (position, velocity, torque, command) in frame {index} of episode {id}");
            return Err(DataError::mismatch(what, dof, format!("{got:?}")));
        }
    }
    Ok(())
}

fn vectors(key: &str, names: &[&str], rows: &[Interval<'_>], value: impl Fn(&Interval<'_>) -> Vec<f32>) -> Feature {
    Feature::new(key, names, Values::F32(rows.iter().flat_map(value).collect()))
}

fn numbers(key: &str, rows: &[Interval<'_>], value: impl Fn(&Interval<'_>) -> f64) -> Feature {
    Feature::new(key, &[], Values::F32(rows.iter().map(|row| value(row) as f32).collect()))
}

fn flags(key: &str, rows: &[Interval<'_>], value: impl Fn(usize, &Interval<'_>) -> bool) -> Feature {
    Feature::new(key, &[], Values::Bool(rows.iter().enumerate().map(|(index, row)| value(index, row)).collect()))
}

/// Position (m), fixed-axis XYZ Euler angles (rad) and gripper opening (m) of the tool.
fn end_effector(world_from_tcp: &Pose, gripper_width: f64) -> Vec<f32> {
    let position = world_from_tcp.position.to_array();
    let rotation = world_from_tcp.to_fixed_xyz_euler();
    position.into_iter().chain(rotation).chain([gripper_width]).map(|value| value as f32).collect()
}

/// Tool pose at the commanded joint positions.
fn commanded_end_effector(robot: &RobotModel, command: &[f32]) -> Vec<f32> {
    let arm: Vec<f64> = command.iter().take(robot.arm_dof()).map(|value| f64::from(*value)).collect();
    let width = command.last().copied().map_or(0.0, f64::from);
    end_effector(&robot.tcp_pose(&arm), width)
}

fn largest(steps: &[Frame], value: impl Fn(&Frame) -> f64) -> f64 {
    steps.iter().map(value).fold(0.0, f64::max)
}

fn largest_torques(steps: &[Frame]) -> Vec<f32> {
    let joints = steps.first().map_or(0, |step| step.joint_torque.len());
    (0..joints).map(|joint| largest(steps, |step| step.joint_torque[joint].abs()) as f32).collect()
}

fn camera_poses(track: &CameraTrack, frames: usize) -> Feature {
    let poses = (0..frames).map(|frame| track.pose_at(frame).copied().unwrap_or_default());
    let key = format!("camera.{}.world_from_camera", track.camera.name);
    Feature::new(&key, &POSE, Values::F64(poses.flat_map(|pose| pose_to_row(&pose)).collect()))
}
