//! Whether the cameras see what matters: each task object large enough and not hidden in at least one of them.

use std::sync::Arc;

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Camera, Pose, RobotModel, World};
use genmanip_render::{
    Channels, FrameBuffers, RenderAssets, RenderError, RenderVariation, Renderer, ViewJob, object_of_instance,
};
use genmanip_scene::relations::{PosedObject, PosedScene};

use crate::LayoutSettings;
use crate::rejection::{NamedObject, Rejection};

/// Height to which what is not to be drawn is sent, metres; chosen, far below every picture.
const AWAY_M: f64 = -50.0;

/// The reason when some object is too small or too hidden in every prompt camera.
///
/// # Errors
/// When a picture cannot be drawn: what nobody can see does not count as seen.
pub(crate) fn hidden(
    scene: &PosedScene,
    world: &World,
    task_objects: usize,
    robot: &Arc<RobotModel>,
    settings: &LayoutSettings,
) -> Result<Option<Rejection>, RenderError> {
    let models: Vec<_> = scene.objects().map(|object| Arc::clone(&object.model)).collect();
    let assets = RenderAssets::new(Arc::clone(robot), &models, Some(world))?;
    let mut renderer = Renderer::new(Arc::clone(&assets), RenderVariation::default());
    let cameras = world.prompt_cameras();
    let away = Pose::from_position(DVec3::Z * AWAY_M);
    // Everything, or one object alone on the table with the robot out of the way.
    let mut ids = |alone: Option<usize>| -> Result<Vec<FrameBuffers>, RenderError> {
        let poses = scene.objects().enumerate().map(|(index, object)| {
            let shown = alone.is_none_or(|alone| alone == index);
            (if shown { object.pose } else { away }, object.joint_positions.as_slice())
        });
        let mut state = assets.frame_state(&robot.home, robot.gripper.max_width, poses)?;
        if alone.is_some() {
            state.body_poses[..robot.links.len()].fill(away);
        }
        let jobs: Vec<ViewJob> =
            cameras.iter().map(|camera| ViewJob::new(&state, camera, Channels::GEOMETRY)).collect();
        let mut buffers = vec![FrameBuffers::default(); jobs.len()];
        renderer.render(&jobs, &mut buffers)?;
        Ok(buffers)
    };
    let counts = |pictures: &[FrameBuffers]| -> Vec<Vec<usize>> {
        pictures.iter().map(|picture| pixels_per_object(picture, models.len())).collect()
    };
    let together = counts(&ids(None)?);
    for (index, object) in scene.objects().take(task_objects).enumerate() {
        // The outline of an object is never smaller than the object, so this settles nearly all cases at once.
        let plainly_seen = together.iter().zip(&cameras).any(|(picture, camera)| {
            let visible = picture[index];
            visible >= settings.min_pixels
                && visible as f64 >= settings.min_visible_share * outline_pixels(object, camera)
        });
        if plainly_seen {
            continue;
        }
        let alone = counts(&ids(Some(index))?);
        let seen = together.iter().zip(&alone).any(|(together, alone)| {
            let (visible, whole) = (together[index], alone[index]);
            visible >= settings.min_pixels && visible as f64 >= settings.min_visible_share * whole as f64
        });
        if !seen {
            return Ok(Some(Rejection::Unseen(NamedObject::of(object))));
        }
    }
    Ok(None)
}

fn pixels_per_object(picture: &FrameBuffers, objects: usize) -> Vec<usize> {
    let mut pixels = vec![0; objects];
    for object in picture.instance.iter().filter_map(|&id| object_of_instance(id)) {
        pixels[object] += 1;
    }
    pixels
}

/// Pixels in the bounds of what an object would cover if nothing hid it; infinite when a corner is behind the camera.
fn outline_pixels(object: &PosedObject, camera: &Camera) -> f64 {
    let camera_from_world = camera.mount_from_camera.inverse();
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let links = object.model.links.iter().zip(object.model.link_poses(&object.joint_positions));
    for (link, object_from_link) in links {
        for part in &link.visual {
            let camera_from_part = camera_from_world * object.pose * object_from_link * part.link_from_part;
            for corner in &part.mesh.positions {
                let point = camera_from_part.transform_point(corner.as_dvec3());
                let Some(pixel) = camera.intrinsics.project(point) else { return f64::INFINITY };
                (low, high) = (low.min(pixel), high.max(pixel));
            }
        }
    }
    let size = (high - low).max(DVec2::ZERO);
    size.x * size.y
}
