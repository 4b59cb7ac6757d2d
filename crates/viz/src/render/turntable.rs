//! Turntable: images from all around a scenario.

use std::f64::consts::TAU;
use std::path::Path;

use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, ImageChannels, Intrinsics};
use genmanip_render::RenderVariation;
use genmanip_rollout::Stage;
use genmanip_rollout::images::{Exposure, StageRenderer, sensor_seed};

use super::files::Writer;
use super::moment::Moment;
use super::options::{RenderOptions, reference};
use super::overlay::Overlays;
use crate::scene_images::not_drawn;
use genmanip_workspace::WorkspaceError;

/// Name of the turntable's camera, and of its video file.
pub(super) const NAME: &str = "turntable";
/// Default size of the images, pixels.
const SIZE_PX: [u32; 2] = [1280, 720];
/// Distance (m) from the camera to the target point; with this field of view, objects and arm are never cropped.
const DISTANCE_M: f64 = 2.0;
/// Elevation angle of the camera, rad. Chosen by hand: 30 degrees look over the far edge of a box and under the
/// gripper.
const ELEVATION: f64 = 0.52;
/// Vertical field of view, rad: that of a 35 mm lens on full frame, about 38 degrees.
const VERTICAL_FOV: f64 = 0.66;
/// Height of the target point above the table, m: between the objects and the gripper at home.
const MIDDLE_M: f64 = 0.22;

/// Cameras at `count` equal steps around the workspace, the first one facing the robot, counter-clockwise seen from
/// above.
pub(super) fn cameras(stage: &Stage, count: u32, options: &RenderOptions) -> Vec<Camera> {
    let workspace = &stage.scenario.world.workspace;
    let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
    let target = DVec3::new(middle(workspace.x), middle(workspace.y), MIDDLE_M);
    let [width, height] = options.size_px.unwrap_or(SIZE_PX);
    let intrinsics = Intrinsics::from_vertical_fov(width, height, VERTICAL_FOV);
    let camera = |index: u32| {
        let (sin, cos) = (TAU * f64::from(index) / f64::from(count)).sin_cos();
        let way = DVec3::new(cos * ELEVATION.cos(), sin * ELEVATION.cos(), ELEVATION.sin());
        let camera = Camera::looking_at(NAME, target + way * DISTANCE_M, target, intrinsics);
        Camera { sensor: options.sensor_of(None), distortion: options.distortion, ..camera }
    };
    (0..count).map(camera).collect()
}

/// Renders a turn into `turntable.mp4`, and its first image into `turntable.png`; returns the camera of each image.
pub(super) fn draw(
    stage: &Stage,
    count: u32,
    folder: &Path,
    variation: RenderVariation,
    options: &RenderOptions,
    threads: usize,
) -> Result<Vec<Camera>, WorkspaceError> {
    let scenario = &stage.scenario;
    let cameras = cameras(stage, count, options);
    let faults = genmanip_core::world::camera_faults(&cameras[..1]);
    if let Some(fault) = faults.first() {
        return Err(WorkspaceError::input(format!("--turntable of {}: {fault}", scenario.id)));
    }
    let mut overlays = Overlays::new(stage, None, &options.overlays, options.captions)?;
    let mut writer = Writer::new(folder, &cameras[0], ImageChannels::RGB, Some(options.fps))?;
    let broken = |error| not_drawn(&scenario.id, error);
    let painter = StageRenderer::with_appearance(stage, variation).map_err(broken)?;
    let mut painter = painter.tracing(reference(scenario.seed, options, threads));
    let channels = overlays.channels(ImageChannels::RGB);
    for (index, camera) in cameras.iter().enumerate() {
        let moment = Moment::start(stage, index);
        let still = Exposure::still(sensor_seed(scenario.seed, index));
        let drawn = painter.render_state(&moment.arm, moment.width, moment.placed(), &[(camera, channels)], still);
        let mut images = drawn.map_err(broken)?;
        overlays.draw(&moment, std::slice::from_ref(camera), &mut images)?;
        if index == 0 {
            writer.write_still(&images[0])?;
        }
        writer.push(index, &images[0])?;
    }
    writer.finish()?;
    Ok(cameras)
}
