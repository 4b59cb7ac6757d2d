//! From an episode to the rows of the main data set.

use genmanip_core::{Frame, Pose, RobotModel};

use super::episodes::EpisodeFacts;
use super::features::{Feature, Values, VideoFeature};
use super::writer::EpisodeRows;
use super::{LerobotSettings, Source, sampling};
use crate::frames::pose_to_row;
use crate::{CameraTrack, DataError};

const END_EFFECTOR: [&str; 7] = ["x", "y", "z", "rotation_x", "rotation_y", "rotation_z", "gripper_width"];
const POSE: [&str; 7] = ["x", "y", "z", "qw", "qx", "qy", "qz"];

/// The control steps that one row stands for; never empty.
struct Interval<'a> {
    /// The state at the row's time.
    now: &'a Frame,
    /// Every step until the next row.
    steps: &'a [Frame],
    /// The last of them, whose command is the row's action.
    last: &'a Frame,
}

/// State, action, end effector, simulator truth, camera poses and video.
pub(crate) fn color_rows(
    source: &Source,
    robot: &RobotModel,
    settings: &LerobotSettings,
) -> Result<EpisodeRows, DataError> {
    let result = &source.episode.result;
    let (_, stride) = sampling(source.episode.frames.len(), result.control_rate_hz, settings.fps)?;
    check_dimensions(source, robot)?;
    let intervals: Vec<Interval<'_>> = source.episode.frames.chunks(stride).filter_map(Interval::new).collect();
    let arm: Vec<&str> = robot.arm_joints().map(|joint| joint.name.as_str()).collect();
    let arm_and_gripper: Vec<&str> = arm.iter().copied().chain(["gripper_width"]).collect();
    let is_last = |row: usize| row + 1 == intervals.len();

    let mut features = vec![
        vectors("observation.state", &arm_and_gripper, &intervals, |row| {
            row.now.joint_position.iter().chain([&row.now.gripper_width]).map(|value| *value as f32).collect()
        }),
        vectors("action", &arm_and_gripper, &intervals, |row| row.last.command.clone()),
        vectors("ee.state", &END_EFFECTOR, &intervals, |row| end_effector(&row.now.tcp, row.now.gripper_width)),
        vectors("ee.action", &END_EFFECTOR, &intervals, |row| commanded_end_effector(robot, &row.last.command)),
        vectors("sim.joint_velocity", &arm, &intervals, |row| {
            row.now.joint_velocity.iter().map(|value| *value as f32).collect()
        }),
        vectors("sim.joint_torque", &arm, &intervals, |row| largest_torques(row.steps)),
        numbers("sim.grip_force", &intervals, |row| largest(row.steps, |step| step.grip_force)),
        numbers("sim.stray_contact_n", &intervals, |row| largest(row.steps, |step| step.stray_contact_n)),
        flags("sim.grasped", &intervals, |_, row| row.now.grasped.is_some()),
    ];
    features.extend(source.tracks.iter().map(|track| camera_poses(track, intervals.len())));
    features.push(flags("next.done", &intervals, |row, _| is_last(row)));
    features.push(flags("next.success", &intervals, |row, _| is_last(row) && result.success));

    let video = |track: &CameraTrack| VideoFeature {
        key: format!("observation.images.{}", track.camera.name),
        video: track.video.clone(),
        colors: track.colors.clone(),
    };
    Ok(EpisodeRows {
        frames: intervals.len(),
        features,
        images: Vec::new(),
        videos: source.tracks.iter().map(video).collect(),
        facts: EpisodeFacts::of(source, settings),
    })
}

impl<'a> Interval<'a> {
    fn new(steps: &'a [Frame]) -> Option<Self> {
        Some(Self { now: steps.first()?, steps, last: steps.last()? })
    }
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

/// Position, rotations about fixed x, y, z, opening width.
fn end_effector(world_from_tcp: &Pose, gripper_width: f64) -> Vec<f32> {
    let position = world_from_tcp.position.to_array();
    let rotation = world_from_tcp.to_fixed_xyz_euler();
    position.into_iter().chain(rotation).chain([gripper_width]).map(|value| value as f32).collect()
}

/// Where the commanded joint positions would bring the tool.
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
