//! Lossless table of an episode's frames.
//!
//! One row per control step. Columns of `frames.parquet`, in order:
//!
//! | column | type | meaning |
//! |---|---|---|
//! | `time_s` | f64 | time since the start of the episode |
//! | `command` | `list<f32>` | arm joint targets (rad), then gripper width (m), in force during the interval |
//! | `joint_position`, `joint_velocity`, `joint_torque` | `list<f64>` | arm joints, base to hand; rad, rad/s, N·m |
//! | `gripper_width` | f64 | opening between the pads, m |
//! | `grip_force` | f64 | N, sum over both fingers |
//! | `tcp` | `list<f64>`\[7\] | `world_from_tcp`: x, y, z, then quaternion w, x, y, z |
//! | `grasped` | i32 or null | index of the object that both fingers touch |
//! | `stray_contact_n` | f64 | largest contact force between the robot and anything but the grasped object, N |
//! | `object_<i>_pose` | `list<f64>`\[7\] | `world_from_object` of the scenario's object i, as `tcp` |
//! | `object_<i>_joint_positions` | `list<f64>` | joints of an articulated object |
//! | `object_<i>_speed`, `object_<i>_angular_speed` | f64 | m/s, rad/s |

use std::path::Path;

use arrow_array::types::{Float32Type, Float64Type};
use arrow_array::{Array, Float64Array, Int32Array};
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Frame, ObjectState, Pose};

use crate::DataError;
use crate::table::{self, Columns, Purpose};

/// Encodes `frames.parquet`; every frame must hold `objects` objects.
pub fn to_bytes(frames: &[Frame], objects: usize) -> Result<Vec<u8>, DataError> {
    for (index, frame) in frames.iter().enumerate() {
        if frame.objects.len() != objects {
            return Err(DataError::mismatch(format!("objects in frame {index}"), objects, frame.objects.len()));
        }
    }
    let each = |value: fn(&Frame) -> f64| frames.iter().map(value);
    let mut columns = Columns::default();
    columns.f64("time_s", each(|frame| frame.time_s));
    columns.lists::<Float32Type>("command", &rows(frames, |frame| &frame.command));
    columns.lists::<Float64Type>("joint_position", &rows(frames, |frame| &frame.joint_position));
    columns.lists::<Float64Type>("joint_velocity", &rows(frames, |frame| &frame.joint_velocity));
    columns.lists::<Float64Type>("joint_torque", &rows(frames, |frame| &frame.joint_torque));
    columns.f64("gripper_width", each(|frame| frame.gripper_width));
    columns.f64("grip_force", each(|frame| frame.grip_force));
    pose_column(&mut columns, "tcp", frames.iter().map(|frame| &frame.tcp));
    columns.optional_i32(
        "grasped",
        frames.iter().map(|frame| frame.grasped.and_then(|object| i32::try_from(object).ok())),
    );
    columns.f64("stray_contact_n", each(|frame| frame.stray_contact_n));
    for object in 0..objects {
        let states: Vec<&ObjectState> = frames.iter().filter_map(|frame| frame.objects.get(object)).collect();
        pose_column(&mut columns, &format!("object_{object}_pose"), states.iter().map(|state| &state.pose));
        let joints: Vec<&[f64]> = states.iter().map(|state| state.joint_positions.as_slice()).collect();
        columns.lists::<Float64Type>(&format!("object_{object}_joint_positions"), &joints);
        columns.f64(&format!("object_{object}_speed"), states.iter().map(|state| state.speed));
        columns.f64(&format!("object_{object}_angular_speed"), states.iter().map(|state| state.angular_speed));
    }
    table::to_parquet(Path::new("frames.parquet"), columns, Purpose::Record, None)
}

/// Decodes `frames.parquet`, which must have `rows` rows and the columns of `objects` objects.
pub fn from_bytes(path: &Path, bytes: Vec<u8>, objects: usize, rows: usize) -> Result<Vec<Frame>, DataError> {
    let batch = table::from_parquet(path, bytes, rows)?;
    let numbers = |name: &str| -> Result<Vec<f64>, DataError> {
        Ok(table::column::<Float64Array>(path, &batch, name)?.values().to_vec())
    };
    let lists = |name: &str| table::list_column::<Float64Type>(path, &batch, name);
    let poses = |name: &str| -> Result<Vec<Pose>, DataError> {
        lists(name)?.iter().map(|row| pose_from_row(path, name, row)).collect()
    };

    let time_s = numbers("time_s")?;
    let mut command = table::list_column::<Float32Type>(path, &batch, "command")?.into_iter();
    let mut joint_position = lists("joint_position")?.into_iter();
    let mut joint_velocity = lists("joint_velocity")?.into_iter();
    let mut joint_torque = lists("joint_torque")?.into_iter();
    let gripper_width = numbers("gripper_width")?;
    let grip_force = numbers("grip_force")?;
    let tcp = poses("tcp")?;
    let grasped: &Int32Array = table::column(path, &batch, "grasped")?;
    let stray_contact_n = numbers("stray_contact_n")?;
    let mut frames: Vec<Frame> = (0..batch.num_rows())
        .map(|row| Frame {
            time_s: time_s[row],
            command: command.next().unwrap_or_default(),
            joint_position: joint_position.next().unwrap_or_default(),
            joint_velocity: joint_velocity.next().unwrap_or_default(),
            joint_torque: joint_torque.next().unwrap_or_default(),
            gripper_width: gripper_width[row],
            grip_force: grip_force[row],
            tcp: tcp[row],
            objects: Vec::with_capacity(objects),
            grasped: grasped.is_valid(row).then(|| usize::try_from(grasped.value(row)).unwrap_or(0)),
            stray_contact_n: stray_contact_n[row],
        })
        .collect();
    for object in 0..objects {
        let poses = poses(&format!("object_{object}_pose"))?;
        let joints = lists(&format!("object_{object}_joint_positions"))?;
        let speed = numbers(&format!("object_{object}_speed"))?;
        let angular_speed = numbers(&format!("object_{object}_angular_speed"))?;
        for (row, (frame, joint_positions)) in frames.iter_mut().zip(joints).enumerate() {
            frame.objects.push(ObjectState {
                pose: poses[row],
                joint_positions,
                speed: speed[row],
                angular_speed: angular_speed[row],
            });
        }
    }
    Ok(frames)
}

/// Encodes `f64` values as little-endian bytes.
pub fn state_to_bytes(state: &[f64]) -> Vec<u8> {
    state.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Decodes little-endian bytes as `f64` values.
pub fn state_from_bytes(path: &Path, bytes: &[u8]) -> Result<Vec<f64>, DataError> {
    let (values, rest) = bytes.as_chunks::<8>();
    if !rest.is_empty() {
        let what = format!("length of {}", path.display());
        return Err(DataError::mismatch(what, "a multiple of 8 bytes", bytes.len()));
    }
    Ok(values.iter().map(|value| f64::from_le_bytes(*value)).collect())
}

/// Position x, y, z, then quaternion w, x, y, z.
pub fn pose_to_row(pose: &Pose) -> [f64; 7] {
    let [x, y, z] = pose.position.to_array();
    let [qw, qx, qy, qz] = pose.to_wxyz_array();
    [x, y, z, qw, qx, qy, qz]
}

fn pose_from_row(path: &Path, name: &str, row: &[f64]) -> Result<Pose, DataError> {
    let &[x, y, z, qw, qx, qy, qz] = row else {
        return Err(DataError::table(path, format!("column `{name}`: expected 7 numbers, got {}", row.len())));
    };
    // Not `Pose::new`: normalising again would change the last bits.
    Ok(Pose { position: DVec3::new(x, y, z), rotation: DQuat::from_xyzw(qx, qy, qz, qw) })
}

fn pose_column<'a>(columns: &mut Columns, name: &str, poses: impl Iterator<Item = &'a Pose>) {
    let rows: Vec<[f64; 7]> = poses.map(pose_to_row).collect();
    let rows: Vec<&[f64]> = rows.iter().map(<[f64; 7]>::as_slice).collect();
    columns.lists::<Float64Type>(name, &rows);
}

fn rows<T>(frames: &[Frame], list: fn(&Frame) -> &Vec<T>) -> Vec<&[T]> {
    frames.iter().map(|frame| list(frame).as_slice()).collect()
}
