//! One pick and one placement planned from files: the implementation of `genmanip agent act`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_agent::ask::TranscriptRecorder;
use genmanip_agent::image::RgbImage;
use genmanip_agent::perception::camera_mistake;
use genmanip_agent::{ActQuestion, Acted, Agent, plan_pick_and_place};
use genmanip_core::limits::Limit;
use genmanip_core::{Intrinsics, Pose, RgbdImage, Seed, limits};
use genmanip_data::depth::decode_depth_png;
use genmanip_motion::Planner;
use serde::Deserialize;

use crate::{AgentChoice, keep};
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Maximum size of a colour or depth image file: 64 MiB.
const PICTURE: Limit = Limit { what: "a picture", bytes: 64 << 20 };

/// Input of `genmanip agent act`: files, robot state and instruction.
#[derive(Clone, Debug)]
pub struct ActFiles {
    /// Colour image: 8-bit PNG.
    pub rgb: PathBuf,
    /// Depth image: 16-bit grey PNG, millimetres along the optical axis, 0 for no measurement.
    pub depth: PathBuf,
    /// Camera: JSON with `intrinsics` (px) and `world_from_camera` (m, unit quaternion).
    pub camera: PathBuf,
    /// Joint positions of the arm, base to tool, rad.
    pub joints: Vec<f64>,
    /// Opening width of the gripper, m.
    pub gripper_width_m: f64,
    /// Instruction in natural language.
    pub instruction: String,
    /// Seed of grasp search and motion planning.
    pub seed: Seed,
    /// Output folder for the images of each stage, the transcript and the motions.
    pub out: PathBuf,
}

/// Contents of the camera file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    intrinsics: Intrinsics,
    world_from_camera: Pose,
}

/// Plans one pick and one placement from files and writes everything into `out`; no robot is moved.
///
/// # Errors
/// Invalid or inconsistent files, an agent that needs the simulator, a model that does not answer, and no plan.
pub fn act(choice: &AgentChoice, planner: &Arc<Planner>, files: &ActFiles) -> Result<Acted, WorkspaceError> {
    let image = read(files)?;
    let dof = planner.robot().arm_dof();
    if files.joints.len() != dof || !files.joints.iter().all(|joint| joint.is_finite()) {
        return Err(WorkspaceError::input(format!(
            "{} joint positions, and the arm has {dof} joints",
            files.joints.len()
        ))
        .with_hint("expected --joints with one number per joint, rad, separated by commas"));
    }
    let question = ActQuestion {
        image,
        joints: files.joints.clone(),
        gripper_width_m: files.gripper_width_m,
        instruction: files.instruction.clone(),
        seed: files.seed,
    };
    let (mut agent, transcribed): (Agent, TranscriptRecorder) = choice.for_one_image(planner)?;
    let acted = plan_pick_and_place(&mut agent, &transcribed, planner, &question);
    keep(&transcribed, 0, &files.out)?;
    let acted = acted.map_err(|error| WorkspaceError::broken("the agent cannot act on these files", error))?;
    let text = serde_json::to_string_pretty(&acted).map_err(|error| WorkspaceError::broken("cannot write", error))?;
    documents::write_file(&files.out.join("motions.json"), text.as_bytes())?;
    Ok(acted)
}

fn read(files: &ActFiles) -> Result<RgbdImage, WorkspaceError> {
    let text = documents::read_text(&files.camera, limits::CAMERAS)?;
    let camera: CameraFile = serde_json::from_str(&text).map_err(|error| {
        WorkspaceError::file("read", &files.camera, error)
            .with_hint("expected {\"intrinsics\": {…}, \"world_from_camera\": {\"position_m\", \"orientation_wxyz\"}}")
    })?;
    let Intrinsics { width, height, .. } = camera.intrinsics;
    let of_size = |path: &Path, found: (u32, u32)| match found == (width, height) {
        true => Ok(()),
        false => Err(WorkspaceError::input(format!("{} has {} x {} pixels", path.display(), found.0, found.1))
            .with_hint(format!("expected {width} x {height}, as the camera's intrinsics say"))),
    };
    let bytes = documents::read_bytes(&files.depth, PICTURE)?;
    let (columns, rows, depth_mm) =
        decode_depth_png(&bytes).map_err(|error| WorkspaceError::file("read", &files.depth, error))?;
    of_size(&files.depth, (columns, rows))?;
    let bytes = documents::read_bytes(&files.rgb, PICTURE)?;
    let picture = RgbImage::of_png(&bytes).map_err(|error| WorkspaceError::file("read", &files.rgb, error))?;
    of_size(&files.rgb, (picture.width, picture.height))?;
    let depth_m = depth_mm.into_iter().map(|depth| f32::from(depth) / 1000.0).collect();
    let image =
        RgbdImage { rgb: picture.rgb, ..RgbdImage::of_depth(camera.intrinsics, camera.world_from_camera, depth_m) };
    let Pose { position, rotation } = camera.world_from_camera;
    let is_pose = position.is_finite() && (rotation.length() - 1.0).abs() < 1e-3;
    let Intrinsics { fx, fy, cx, cy, .. } = camera.intrinsics;
    let is_projection = fx > 0.0 && fy > 0.0 && cx.is_finite() && cy.is_finite();
    if !(is_pose && is_projection) {
        return Err(WorkspaceError::input(format!("{} is no camera", files.camera.display()))
            .with_hint("expected a unit quaternion, finite numbers and positive focal lengths"));
    }
    if let Some(mistake) = camera_mistake(&image) {
        return Err(WorkspaceError::input(format!("{}: {mistake}", files.camera.display()))
            .with_hint("no model was asked; docs/guides/agent.md#a-real-camera-and-arm says what each file holds"));
    }
    Ok(image)
}
