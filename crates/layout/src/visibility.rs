//! Visibility check: each task object must be large enough and not occluded in at least one camera.

use std::sync::Arc;

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Camera, Pose, RobotModel, World};
use genmanip_relations::{PosedObject, PosedScene};
use genmanip_render::{
    Channels, FrameBuffers, RenderAssets, RenderError, RenderVariation, Renderer, ViewJob, object_of_instance,
};

use crate::LayoutSettings;
use crate::rejection::{NamedObject, Rejection};

/// z position to which objects are moved to exclude them from a rendering (m), far below the view of every camera.
const AWAY_M: f64 = -50.0;

/// Renders the prompt cameras of a scene to count visible pixels.
pub(crate) struct VisibilityCheck<'a> {
    world: &'a World,
    robot: &'a RobotModel,
    assets: Arc<RenderAssets>,
    renderer: Renderer,
}

impl<'a> VisibilityCheck<'a> {
    /// # Errors
    /// Fails if the scene cannot be rendered.
    pub fn new(scene: &PosedScene, world: &'a World, robot: &'a Arc<RobotModel>) -> Result<Self, RenderError> {
        let models: Vec<_> = scene.objects().map(|object| Arc::clone(&object.model)).collect();
        let assets = RenderAssets::new(Arc::clone(robot), &models, Some(world))?;
        let renderer = Renderer::new(Arc::clone(&assets), RenderVariation::default());
        Ok(Self { world, robot, assets, renderer })
    }

    /// Pixels of each object in each camera, with everything rendered or only some objects without the robot.
    fn pixels(&mut self, scene: &PosedScene, only: Option<&[usize]>) -> Result<Vec<Vec<usize>>, RenderError> {
        let away = Pose::from_position(DVec3::Z * AWAY_M);
        let poses = scene.objects().enumerate().map(|(index, object)| {
            let is_rendered = only.is_none_or(|only| only.contains(&index));
            (if is_rendered { object.pose } else { away }, object.joint_positions.as_slice())
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
        Ok(buffers.iter().map(|image| pixels_per_object(image, count)).collect())
    }

    /// True if the objects `around` alone hide an object from every camera.
    ///
    /// # Errors
    /// Fails if an image cannot be rendered.
    pub fn is_hidden_by(
        &mut self,
        around: &[usize],
        object: usize,
        scene: &PosedScene,
        settings: &LayoutSettings,
    ) -> Result<bool, RenderError> {
        let with_others = self.pixels(scene, Some(&[around, &[object]].concat()))?;
        if with_others.iter().all(|image| image[object] < settings.min_pixels) {
            return Ok(true);
        }
        let alone = self.pixels(scene, Some(&[object]))?;
        Ok(!is_visible(object, &with_others, &alone, settings))
    }
}

/// First task object that is too small or too occluded in every prompt camera.
///
/// # Errors
/// Fails if an image cannot be rendered.
pub(crate) fn first_hidden(
    scene: &PosedScene,
    world: &World,
    task_objects: usize,
    robot: &Arc<RobotModel>,
    settings: &LayoutSettings,
) -> Result<Option<Rejection>, RenderError> {
    let first = hidden(scene, world, task_objects, 1, robot, settings)?.into_iter().next();
    Ok(first.and_then(|hidden| Some(Rejection::Unseen(NamedObject::of(scene.objects().nth(hidden.object)?)))))
}

/// An object that no prompt camera sees sufficiently.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hidden {
    /// Index of the object in the scene.
    pub object: usize,
    /// Number of visible pixels of the object in the camera that shows the largest share of it.
    pub pixels: usize,
    /// Visible pixels in that camera as a share of the object's pixels without occlusion.
    pub share: f64,
}

/// Up to `most` of the first `task_objects` objects that are too small or too occluded in every prompt camera.
///
/// # Errors
/// Fails if an image cannot be rendered.
pub fn hidden(
    scene: &PosedScene,
    world: &World,
    task_objects: usize,
    most: usize,
    robot: &Arc<RobotModel>,
    settings: &LayoutSettings,
) -> Result<Vec<Hidden>, RenderError> {
    let mut check = VisibilityCheck::new(scene, world, robot)?;
    let cameras = world.prompt_cameras();
    let with_others = check.pixels(scene, None)?;
    let mut found = Vec::new();
    for (index, object) in scene.objects().take(task_objects).enumerate() {
        // The bounding rectangle is never smaller than the object, which settles nearly all cases without rendering it
        // alone.
        let clearly_visible = with_others.iter().zip(&cameras).any(|(image, camera)| {
            let visible = image[index];
            visible >= settings.min_pixels
                && visible as f64 >= settings.min_visible_share * outline_pixels(object, camera)
        });
        if clearly_visible {
            continue;
        }
        let alone = check.pixels(scene, Some(&[index]))?;
        if !is_visible(index, &with_others, &alone, settings) {
            let share = |&(visible, whole): &(usize, usize)| visible as f64 / whole.max(1) as f64;
            let seen = with_others.iter().zip(&alone).map(|(others, alone)| (others[index], alone[index]));
            let best = seen.max_by(|one, other| share(one).total_cmp(&share(other))).unwrap_or_default();
            found.push(Hidden { object: index, pixels: best.0, share: share(&best) });
            if found.len() >= most {
                break;
            }
        }
    }
    Ok(found)
}

/// True if some camera sees enough of an object, given its pixel counts with the others and alone.
fn is_visible(object: usize, with_others: &[Vec<usize>], alone: &[Vec<usize>], settings: &LayoutSettings) -> bool {
    with_others.iter().zip(alone).any(|(with_others, alone)| {
        let (visible, whole) = (with_others[object], alone[object]);
        visible >= settings.min_pixels && visible as f64 >= settings.min_visible_share * whole as f64
    })
}

fn pixels_per_object(image: &FrameBuffers, objects: usize) -> Vec<usize> {
    let mut pixels = vec![0; objects];
    for object in image.instance.iter().filter_map(|&id| object_of_instance(id)) {
        pixels[object] += 1;
    }
    pixels
}

/// Area of an object's bounding rectangle in the image (px); infinite if a vertex is behind the camera.
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
