//! Recording layout of the original GenManip: one folder per episode, JPEG colour, 16-bit PNG depth in millimetres,
//! states and actions as NumPy arrays; JSON replaces the original's pickles.
//!
//! ```text
//! EPISODE/meta_info.json                              num_steps, language_instruction, task_data, seed, outcome
//! EPISODE/{arm_action,gripper_action,gripper_close,ee_pose_action,delta_arm_action}.npy
//! EPISODE/observation/robot/{qpos,qvel,ee_pose_state}.npy
//! EPISODE/observation/obj_pose/OBJECT/{position,orientation}.npy
//! EPISODE/observation/CAMERA/camera2env_pose.npy
//! EPISODE/observation/CAMERA/color_image/0000.jpg, depth_image/0000.png
//! ```
//!
//! Arrays have one row per image; orientations are quaternions, w first; metres and radians in the robot's frame.

use std::path::Path;

use genmanip_core::glam::DMat4;
use genmanip_core::{Document, Pose, RobotModel};
use jpeg_encoder::{ColorType, Encoder};
use serde_json::json;

use crate::atomic_write::AtomicFolder;
use crate::export::{EpisodeRows, ExportReport, ExportSettings, Exporter, Selection, Source, sampling};
use crate::frames::pose_to_row;
use crate::{DataError, EpisodeStore, video};

/// JPEG quality, 1 to 100; high because the images have already been compressed once.
const QUALITY: u8 = 95;

/// Exports the selected episodes to a folder at `target`, which must not exist.
///
/// Colour is decoded from the store's video. The layout fixes the actions; [`ExportSettings::action`] is not used.
///
/// # Errors
/// If no episode is selected, images are missing, the target exists, or writing fails.
pub fn export(
    store: &EpisodeStore,
    selection: &Selection,
    robot: &RobotModel,
    settings: &ExportSettings,
    target: &Path,
) -> Result<ExportReport, DataError> {
    let (exporter, staging) = Exporter::begin(store, selection, robot, settings, target)?;
    let report = exporter.each(target, |source, rows| {
        let folder = Folder { staging: &staging, name: &rows.metadata.result.id, rows: rows.frames };
        folder.numbers(source, robot, settings)?;
        folder.images(source, settings)?;
        folder.about(source, &rows, settings)
    })?;
    staging.publish()?;
    Ok(report)
}

/// Folder of one episode under construction.
struct Folder<'a> {
    staging: &'a AtomicFolder,
    name: &'a str,
    rows: usize,
}

impl Folder<'_> {
    fn write(&self, name: &str, bytes: &[u8]) -> Result<(), DataError> {
        self.staging.write(&format!("{}/{name}", self.name), bytes)
    }

    /// Writes a NumPy array whose first axis is the image and whose other axes are `inner`.
    fn array(&self, name: &str, inner: &[usize], values: impl IntoIterator<Item = f64>) -> Result<(), DataError> {
        let values: Vec<f64> = values.into_iter().collect();
        let expected = self.rows * inner.iter().product::<usize>();
        if values.len() != expected {
            return Err(DataError::mismatch(format!("numbers of {name} of {}", self.name), expected, values.len()));
        }
        let shape: Vec<usize> = [self.rows].iter().chain(inner).copied().collect();
        self.write(&format!("{name}.npy"), &npy(&shape, &values))
    }

    fn numbers(&self, source: &Source, robot: &RobotModel, settings: &ExportSettings) -> Result<(), DataError> {
        let (episode, dof) = (&source.episode, robot.arm_dof());
        let (_, stride) = sampling(episode.frames.len(), episode.result.control_rate_hz, settings.fps)?;
        let nows: Vec<_> = episode.frames.iter().step_by(stride).collect();
        let targets: Vec<Vec<f64>> = episode
            .frames
            .chunks(stride)
            .filter_map(<[_]>::last)
            .map(|last| last.command.iter().map(|target| f64::from(*target)).collect())
            .collect();
        let opening = |target: &Vec<f64>| target.last().copied().unwrap_or_default();
        let is_closed = |target: &Vec<f64>| opening(target) < 0.5 * robot.gripper.max_width;
        self.array("arm_action", &[dof], targets.iter().flat_map(|target| target[..dof].to_vec()))?;
        // Each finger's target is half the opening.
        self.array("gripper_action", &[2], targets.iter().flat_map(|target| [0.5 * opening(target); 2]))?;
        self.array("gripper_close", &[], targets.iter().map(|target| if is_closed(target) { 1.0 } else { -1.0 }))?;
        let poses = targets.iter().flat_map(|target| pose_to_row(&robot.tcp_pose(&target[..dof])));
        self.array("ee_pose_action", &[7], poses)?;
        let home = &episode.scenario.world.robot.home;
        let before = [home].into_iter().chain(&targets);
        let deltas = targets.iter().zip(before).flat_map(|(target, before)| {
            target[..dof].iter().zip(before).map(|(now, before)| now - before).collect::<Vec<f64>>()
        });
        self.array("delta_arm_action", &[dof], deltas)?;
        let fingers = |width: f64| [0.5 * width; 2];
        let positions = nows
            .iter()
            .flat_map(|now| now.joint_position.iter().copied().chain(fingers(now.gripper_width)).collect::<Vec<f64>>());
        self.array("observation/robot/qpos", &[dof + 2], positions)?;
        self.array("observation/robot/qvel", &[dof], nows.iter().flat_map(|now| now.joint_velocity.clone()))?;
        self.array("observation/robot/ee_pose_state", &[7], nows.iter().flat_map(|now| pose_to_row(&now.tcp)))?;
        for (place, object) in episode.scenario.objects.iter().enumerate() {
            let poses = || nows.iter().filter_map(|now| Some(pose_to_row(&now.objects.get(place)?.pose)));
            let folder = format!("observation/obj_pose/{}", object.id);
            self.array(&format!("{folder}/position"), &[3], poses().flat_map(|row| row[..3].to_vec()))?;
            self.array(&format!("{folder}/orientation"), &[4], poses().flat_map(|row| row[3..].to_vec()))?;
        }
        Ok(())
    }

    fn images(&self, source: &Source, settings: &ExportSettings) -> Result<(), DataError> {
        for track in &source.tracks {
            let folder = format!("observation/{}", track.camera.name);
            let poses = (0..self.rows).filter_map(|row| track.pose_at(row)).flat_map(matrix);
            self.array(&format!("{folder}/camera2env_pose"), &[4, 4], poses)?;
            let mut row = 0;
            video::decode(&track.video, &mut |rgb| {
                let name = format!("{folder}/color_image/{row:04}.jpg");
                row += 1;
                self.write(&name, &jpeg(rgb, track.video.width, track.video.height)?)
            })?;
            if settings.depth {
                let mut files = track.depth_png.iter().enumerate();
                files.try_for_each(|(row, png)| self.write(&format!("{folder}/depth_image/{row:04}.png"), png))?;
            }
        }
        Ok(())
    }

    fn about(&self, source: &Source, rows: &EpisodeRows, settings: &ExportSettings) -> Result<(), DataError> {
        let (scenario, result) = (&source.episode.scenario, &source.episode.result);
        let placed = scenario.objects.iter().map(|object| {
            let row = pose_to_row(&object.pose);
            (object.id.to_string(), json!({"position": row[..3], "orientation": row[3..], "asset": object.asset}))
        });
        let cameras = source.tracks.iter().map(|track| {
            let k = &track.camera.intrinsics;
            let matrix = [[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]];
            (track.camera.name.clone(), json!({"intrinsics_matrix": matrix, "resolution": [k.width, k.height]}))
        });
        let about = json!({
            "schema": "genmanip.paper_episode/1",
            "num_steps": rows.frames,
            "rate_hz": settings.fps,
            "language_instruction": rows.metadata.instruction,
            "task_data": {
                "goal": scenario.task.goal,
                "initial_layout": placed.collect::<serde_json::Map<_, _>>(),
                "camera_data": cameras.collect::<serde_json::Map<_, _>>(),
            },
            "depth_scale": 1000,
            "success": result.success,
            "failure": result.failure().map(|failure| failure.to_string()),
            "seed": result.seed,
            "policy": result.policy,
            "engine": result.engine,
            "genmanip_version": result.genmanip_version,
            "scenario": scenario.to_value(),
        });
        self.write("meta_info.json", format!("{about:#}\n").as_bytes())
    }
}

/// Homogeneous matrix of a pose, row-major.
fn matrix(pose: &Pose) -> [f64; 16] {
    DMat4::from_rotation_translation(pose.rotation, pose.position).transpose().to_cols_array()
}

/// A JPEG file of an RGB image.
///
/// # Errors
/// If a side is longer than 65535 pixels or the buffer does not match the size.
pub fn jpeg(rgb: &[u8], width: u32, height: u32) -> Result<Vec<u8>, DataError> {
    let side = |pixels: u32| u16::try_from(pixels).map_err(|_| DataError::mismatch("side of a JPEG", 65535, pixels));
    let mut file = Vec::new();
    let encoded = Encoder::new(&mut file, QUALITY).encode(rgb, side(width)?, side(height)?, ColorType::Rgb);
    encoded.map_err(|error| DataError::NotWritable { what: "a JPEG".into(), why: error.to_string() })?;
    Ok(file)
}

/// NumPy file, version 1.0, of `f64` values.
fn npy(shape: &[usize], values: &[f64]) -> Vec<u8> {
    let shape: String = shape.iter().map(|length| format!("{length}, ")).collect();
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}), }}", shape.trim_end());
    // The data must begin at a multiple of 64 bytes and the header end with a newline.
    let padding = (64 - (10 + header.len() + 1) % 64) % 64;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    let length = u16::try_from(header.len()).unwrap_or(u16::MAX);
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend(length.to_le_bytes());
    file.extend(header.as_bytes());
    file.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    file
}
