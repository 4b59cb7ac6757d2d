//! Scenes for segmentation: laid out from designed tasks, rendered by the data cameras, with ground truth.

use std::sync::Arc;

use genmanip_agent::segmentation::{Mask, RobotSilhouette};
use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_core::{Aabb, Camera, Pose, RgbdImage, Scenario, Seed, Task, World};
use genmanip_layout::{LayoutSettings, lay_out, posed};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_relations::{Label, PosedObject, PosedScene, ShapeCache, label_pair};
use genmanip_render::{
    Channels, FIRST_OBJECT, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob, object_of_instance,
};
use genmanip_workspace::worlds;
use serde::Serialize;

use crate::LabError;

/// Minimum and maximum number of objects in a scene.
const OBJECTS: [usize; 2] = [5, 12];
/// Maximum number of layouts tried per scene.
const LAYOUTS: u64 = 4;
/// Maximum second largest extent of a thin object, m.
const THIN_M: f64 = 0.045;
/// Minimum ratio of a thin object's largest extent to the second largest.
const THIN_RATIO: f64 = 2.5;

/// Category of an object; exactly one applies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stratum {
    /// Touches and hides no other object in the image.
    Free,
    /// Touches or occludes another object in the image.
    Touching,
    /// Lies in or on another one, or another one in or on it.
    InOrOn,
    /// Long and at most 45 mm wide in its second largest extent, wherever it lies. Takes precedence.
    Thin,
}

/// One camera's image with ground truth.
pub struct SegmentView {
    /// Number of the scene, id of the task, and name of the camera.
    pub name: String,
    /// Colour, depth and instance ids.
    pub image: RgbdImage,
    /// True for the pixels of the robot at its joint positions, row by row.
    pub ignore: Vec<bool>,
    /// Ground truth of the objects.
    pub objects: Vec<TrueObject>,
}

/// An object with at least one visible pixel.
pub struct TrueObject {
    /// Name on the object's card.
    pub name: String,
    /// Mask of the object's visible pixels.
    pub mask: Mask,
    /// Category of the object.
    pub stratum: Stratum,
    /// Axis-aligned bounds of the posed object, world frame.
    pub bounds: Aabb,
    /// True if the object's card has a handle.
    pub has_handle: bool,
}

/// Generator of rendered scenes.
pub struct Scenes {
    world: Arc<World>,
    planner: Arc<Planner>,
    silhouette: RobotSilhouette,
    shapes: ShapeCache,
    seed: Seed,
    cameras: &'static [&'static str],
}

impl Scenes {
    pub fn new(world: &Arc<World>, seed: Seed, cameras: &'static [&'static str]) -> Result<Self, LabError> {
        let planner = worlds::planner(world, &PlannerSettings::default())?;
        let silhouette = RobotSilhouette::new(planner.robot())
            .map_err(|error| LabError::broken("the robot cannot be drawn", error))?;
        Ok(Self { world: Arc::clone(world), planner, silhouette, shapes: ShapeCache::default(), seed, cameras })
    }

    /// Views of a task laid out with additional objects, one per camera; `None` without a layout of enough objects.
    pub fn draw(&mut self, index: usize, task: &Task) -> Result<Option<Vec<SegmentView>>, LabError> {
        let seed = self.seed.fork("segment scenes").fork_index(index as u64);
        let [least, most] = OBJECTS;
        let wanted = least + (seed.fork("objects").value() % (most - least + 1) as u64) as usize;
        let distractors = wanted.saturating_sub(task.scene_graph.nodes.len());
        let settings = LayoutSettings { distractors, ..LayoutSettings::default() };
        for attempt in 0..LAYOUTS {
            let seed = seed.fork_index(attempt);
            let (catalogue, grasps) = (Catalogue::builtin(), GraspLibrary::builtin());
            match lay_out(task, catalogue, &self.world, &self.planner, grasps, seed, &settings) {
                Ok(scenario) if scenario.objects.len() < least => {}
                Ok(scenario) => return self.views(index, &scenario).map(Some),
                Err(error) if error.is_defect() => {
                    return Err(LabError::broken(format!("laying out {} stopped", task.id), error));
                }
                Err(_) => {}
            }
        }
        Ok(None)
    }

    fn views(&mut self, index: usize, scenario: &Scenario) -> Result<Vec<SegmentView>, LabError> {
        let scene = posed(scenario, Catalogue::builtin(), &mut self.shapes)
            .map_err(|error| LabError::broken(format!("cannot build the objects of {}", scenario.id), error))?;
        let images = self.images(&scene)?;
        let names = images.iter().map(|(camera, _)| format!("{index} {} {camera}", scenario.task.id));
        let names: Vec<String> = names.collect();
        let view = |(name, (_, image)): (String, (&str, RgbdImage))| {
            let robot = self.planner.robot();
            let ignore = self.silhouette.pixels(&robot.home, robot.gripper.max_width, &image);
            let objects = self.truth(&scene, &image);
            SegmentView { name, image, ignore, objects }
        };
        Ok(names.into_iter().zip(images).map(view).collect())
    }

    fn images(&self, scene: &PosedScene) -> Result<Vec<(&'static str, RgbdImage)>, LabError> {
        let drawn = |error| LabError::broken("cannot render the scene", error);
        let models: Vec<_> = scene.objects().map(|object| Arc::clone(&object.model)).collect();
        let robot = self.planner.robot();
        let assets = RenderAssets::new(Arc::clone(robot), &models, Some(&self.world)).map_err(drawn)?;
        let poses = scene.objects().map(|object| (object.pose, object.joint_positions.as_slice()));
        let state = assets.frame_state(&robot.home, robot.gripper.max_width, poses).map_err(drawn)?;
        let cameras: Vec<(&str, &Camera)> =
            self.cameras.iter().filter_map(|name| Some((*name, self.world.camera(name)?))).collect();
        let channels = Channels { normal: false, ..Channels::ALL };
        let jobs: Vec<ViewJob> = cameras.iter().map(|(_, camera)| ViewJob::new(&state, camera, channels)).collect();
        let mut pictures = vec![FrameBuffers::default(); jobs.len()];
        Renderer::new(assets, RenderVariation::default()).render(&jobs, &mut pictures).map_err(drawn)?;
        let image = |((name, camera), picture): ((&'static str, &Camera), FrameBuffers)| {
            (name, picture.into_image(camera, camera.world_from_camera(&Pose::IDENTITY)))
        };
        Ok(cameras.into_iter().zip(pictures).map(image).collect())
    }

    fn truth(&self, scene: &PosedScene, image: &RgbdImage) -> Vec<TrueObject> {
        let mut found = Vec::new();
        for (index, object) in scene.objects().enumerate() {
            let id = FIRST_OBJECT + index as u16;
            let mask = Mask::of_label(image.width(), image.height(), &image.ids, &id);
            if mask.area() > 0 {
                let stratum = if is_thin(object) {
                    Stratum::Thin
                } else if self.is_in_or_on(scene, index) {
                    Stratum::InOrOn
                } else if borders_another(image, id) {
                    Stratum::Touching
                } else {
                    Stratum::Free
                };
                let bounds = object.model.world_bounds(&object.pose, &object.joint_positions);
                let card = &object.model.card;
                let has_handle = card.shape.contains("handle");
                found.push(TrueObject { name: card.name.clone(), mask, stratum, bounds, has_handle });
            }
        }
        found
    }

    /// True if the object lies in or on another one, or another one in or on it.
    fn is_in_or_on(&self, scene: &PosedScene, index: usize) -> bool {
        let holds = |one: usize, other: usize| {
            let verdict = label_pair(scene, one, other, &self.world.relations);
            matches!(verdict.and_then(|pair| pair.a_to_b), Some(Label::In | Label::On))
        };
        (0..scene.objects().len()).any(|other| other != index && (holds(index, other) || holds(other, index)))
    }
}

/// True if the object is long and thin, see [`THIN_M`] and [`THIN_RATIO`].
fn is_thin(object: &PosedObject) -> bool {
    let mut extents = object.model.card.size_m.to_array();
    extents.sort_by(f64::total_cmp);
    extents[1] <= THIN_M && extents[2] >= THIN_RATIO * extents[1]
}

/// True if pixels of the object border on those of another object in the image.
fn borders_another(image: &RgbdImage, id: u16) -> bool {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let differs = |one: u16, other: u16| {
        one != other && (one == id || other == id) && [one, other].iter().all(|id| object_of_instance(*id).is_some())
    };
    (0..height).any(|y| {
        (0..width).any(|x| {
            let here = image.ids[y * width + x];
            (x + 1 < width && differs(here, image.ids[y * width + x + 1]))
                || (y + 1 < height && differs(here, image.ids[(y + 1) * width + x]))
        })
    })
}
