//! `meta/info.json`, and `meta/genmanip.json`, which documents the columns.

use std::path::Path;

use genmanip_core::limits;
use serde_json::{Value, json};

use super::LerobotSettings;
use crate::export::describe_action;
use crate::{DataError, files};

/// LeRobot's file with the shape and types of a data set.
pub const INFO: &str = "meta/info.json";

/// LeRobot's limit of files per folder.
pub const FILES_PER_CHUNK: usize = 1000;

/// Numbers of a data set that `meta/info.json` states.
pub struct Totals {
    /// Number of episodes in the data set.
    pub episodes: usize,
    /// Number of rows of all episodes.
    pub frames: usize,
    /// Number of distinct instructions.
    pub tasks: usize,
}

/// Contents of `meta/info.json`.
pub fn info(robot: &str, totals: &Totals, fps: u32, features: Value, has_video: bool) -> Value {
    let video_path = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4";
    json!({
        "codebase_version": "v3.0",
        "robot_type": robot,
        "total_episodes": totals.episodes,
        "total_frames": totals.frames,
        "total_tasks": totals.tasks,
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": format!("0:{}", totals.episodes)},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": if has_video { Value::from(video_path) } else { Value::Null },
        "features": features,
    })
}

/// Reads `meta/info.json` of a v3.0 data set.
pub fn read(dataset: &Path) -> Result<Value, DataError> {
    let path = dataset.join(INFO);
    let info: Value = serde_json::from_slice(&files::read(&path, limits::SETTINGS)?)
        .map_err(|error| DataError::mismatch(path.display().to_string(), "JSON", error))?;
    if info["codebase_version"] == "v3.0" {
        return Ok(info);
    }
    let what = format!("codebase_version in {}", path.display());
    Err(DataError::mismatch(what, "v3.0 of LeRobotDataset", &info["codebase_version"]))
}

/// Contents of `meta/genmanip.json`: frames, units and conventions of the columns.
pub fn meaning(settings: &LerobotSettings) -> Value {
    json!({
        "schema": "genmanip.dataset/1",
        "genmanip_version": env!("CARGO_PKG_VERSION"),
        "frame": "world = robot base: +x away from the robot, +y to its left, +z up; metres, radians, seconds",
        "columns": {
            "observation.state": "arm joint positions (rad), opening between the gripper pads (m), at the time of the frame",
            "action": describe_action(&settings.export.action),
            "ee.state": "tool position (m) and rotation (rad), opening width (m)",
            "ee.action": "as ee.state, where the commanded joint positions would bring the tool",
            "ee.quaternion": "rotation of the tool (w, x, y, z), with the sign nearest to the row before",
            "ee.rotation_6d": "rotation of the tool, the first two columns of its matrix",
            "subtask_index": "the step of the episode that the row belongs to, by its request in meta/subtasks.parquet; \
                              a step ends when its thing is let go of for another",
            "is_idle": "the command stays what it was during the row, and no joint moves by 0.01 rad/s",
            "is_correction": "of runs with corrections: the expert has taken over from the policy that acted first and \
                              failed; rows before are that policy's",
            "sim.joint_velocity": "rad/s, simulator truth",
            "sim.joint_torque": "largest magnitude in the frame's interval, N·m, simulator truth",
            "sim.grip_force": "largest in the frame's interval, N, sum over both fingers, simulator truth",
            "sim.stray_contact_n": "largest contact force in the frame's interval between the robot and anything but the \
                                    grasped object, N, simulator truth",
            "sim.object_pose": "on request: position (m) and quaternion (w, x, y, z) of each object, in the order of \
                                `objects` of the episode; zeros where there is none; also sim.object_speed (m/s, rad/s), \
                                sim.object_joint_position (the first two joints) and sim.grasped_object (its place, or -1)",
            "sim.grasped": "both fingers touch one object, simulator truth",
            "camera.<name>.world_from_camera": "position (m) and quaternion (w, x, y, z) of the optical frame: x right, y \
                                                down, z forward",
            "sim.box.<name>": "on request: left, top, right, bottom (pixels; the last two are the first behind it) of what the \
                               camera's picture shows of each object, in the order of `objects`; zeros where it is not seen; \
                               also sim.visible_pixels.<name>",
            "observation.images.<name>_mask": "on request, depth data set: 16-bit ids, 0 = nothing, 1 = table, 2 = robot, 3 + i \
                                               = object i of `objects`",
            "observation.images.<name>_depth": "depth data set: millimetres along the optical axis, 0 = nothing hit",
        },
        "rotation": "fixed_xyz_euler: about the fixed x, y, z axes in this order, R = Rz·Ry·Rx",
        "gripper": "opening width in metres, 0 = closed",
        "tool": "midpoint between the pads, z = approach, y = closing direction",
        "colors": "H.264, BT.601 limited range",
        "action_contract": settings.export.action,
        "fps": settings.export.fps,
        "statistics": "numbers exact over all frames; colours on every fourth pixel of every fourth row; none for depth",
        "record": if settings.record { json!("extras/record, an episode store at 60 Hz") } else { Value::Null },
    })
}

/// `README.md` with a copy of `info.json` appended.
pub fn card_with_info(card: &str, info: &Value) -> String {
    let info = serde_json::to_string_pretty(info).unwrap_or_default();
    format!("{card}\n## Structure\n\n`meta/info.json`:\n\n```json\n{info}\n```\n")
}
