//! Whether the cameras see what matters: each task object large enough and not hidden in at least one of them.

use std::sync::Arc;

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Camera, Pose, RobotModel, World};
use genmanip_relations::{PosedObject, PosedScene};
use genmanip_render::{
    Channels, FrameBuffers, RenderAssets, RenderError, RenderVariation, Renderer, ViewJob, object_of_instance,
};

use crate::LayoutSettings;
use crate::rejection::{NamedObject, Rejection};

/// Height to which what is not to be drawn is sent, metres; chosen, far below every picture.
const AWAY_M: f64 = -50.0;

/// The prompt cameras on a scene of these objects.
pub(crate) struct Eye<'a> {
    world: &'a World,
    robot: &'a RobotModel,
    assets: Arc<RenderAssets>,
    renderer: Renderer,
}

impl<'a> Eye<'a> {
    /// # Errors
    /// When the scene cannot be drawn.
    pub fn new(scene: &PosedScene, world: &'a World, robot: &'a Arc<RobotModel>) -> Result<Self, RenderError> {
        let models: Vec<_> = scene.objects().map(|object| Arc::clone(&object.model)).collect();
        let assets = RenderAssets::new(Arc::clone(robot), &models, Some(world))?;
        let renderer = Renderer::new(Arc::clone(&assets), RenderVariation::default());
        Ok(Self { world, robot, assets, renderer })
    }

    /// Pixels of each object in each camera when everything is drawn, or only some objects without the robot.
    fn pixels(&mut self, scene: &PosedScene, only: Option<&[usize]>) -> Result<Vec<Vec<usize>>, RenderError> {
        let away = Pose::from_position(DVec3::Z * AWAY_M);
        let poses = scene.objects().enumerate().map(|(index, object)| {
            let shown = only.is_none_or(|only| only.contains(&index));
            (if shown { object.pose } else { away }, object.joint_positions.as_slice())
        });
        let mut state = self.assets.frame_state(&self.robot.home, self.robot.gripper.max_width, poses)?;
        if only.is_some() {
            state.body_poses[..self.robot.links.len()].fill(away);
        }
        let cameras = self.world.prompt_cameras();
        let jobs: Vec<ViewJob> =
            cameras.iter().map(|camera| ViewJob::new(&state, camera, Channels::GEOMETRY)).collect();
        let mut buffers = vec![FrameBuffers::default(); jobs.len()];
        self.renderer.render(&jobs, &mut buffers)?;
        let count = scene.objects().count();
        Ok(buffers.iter().map(|picture| pixels_per_object(picture, count)).collect())
    }

    /// Whether the objects around it alone hide an object from every camera.
    ///
    /// # Errors
    /// When a picture cannot be drawn.
    pub fn is_hidden_by(
        &mut self,
        around: &[usize],
        object: usize,
        scene: &PosedScene,
        settings: &LayoutSettings,
    ) -> Result<bool, RenderError> {
        let together = self.pixels(scene, Some(&[around, &[object]].concat()))?;
        if together.iter().all(|picture| picture[object] < settings.min_pixels) {
            return Ok(true);
        }
        let alone = self.pixels(scene, Some(&[object]))?;
        Ok(!is_seen(object, &together, &alone, settings))
    }
}

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
    let mut eye = Eye::new(scene, world, robot)?;
    let cameras = world.prompt_cameras();
    let together = eye.pixels(scene, None)?;
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
        let alone = eye.pixels(scene, Some(&[index]))?;
        if !is_seen(index, &together, &alone, settings) {
            return Ok(Some(Rejection::Unseen(NamedObject::of(object))));
        }
    }
    Ok(None)
}

/// Whether some camera sees enough of an object, given its pixels in each camera among others and alone.
fn is_seen(object: usize, together: &[Vec<usize>], alone: &[Vec<usize>], settings: &LayoutSettings) -> bool {
    together.iter().zip(alone).any(|(together, alone)| {
        let (visible, whole) = (together[object], alone[object]);
        visible >= settings.min_pixels && visible as f64 >= settings.min_visible_share * whole as f64
    })
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
