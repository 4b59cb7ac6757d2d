//! Camera images, rendered as for datasets, with the visible share of each object.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, Frame, InstanceId, Intrinsics, ObjectModel, Pose, RobotModel, Scenario, World};
use genmanip_render::encode::jpeg_rgb;
use genmanip_render::{
    Channels, FrameBuffers, FrameState, RenderAssets, RenderVariation, Renderer, ViewJob, object_of_instance, sensor,
};
use genmanip_workspace::WorkspaceError;

/// Width and height of the images, pixels.
pub const SIZE_PX: [u32; 2] = [512, 288];
/// Quality of the JPEG files, 1-100. Chosen by hand.
const QUALITY: u8 = 88;
/// Maximum number of scenes whose renderers are kept.
const MAX_SCENES: usize = 4;
/// Maximum number of silhouette sizes that a renderer remembers.
const MAX_OUTLINES: usize = 512;
/// Height to which objects are moved that an image must not show, m: far below the view of every camera.
const AWAY_M: f64 = -50.0;

/// An image of one camera.
#[derive(Clone, Debug)]
pub struct CameraImage {
    /// JPEG file.
    pub jpeg: Vec<u8>,
    /// Visible share of each object's silhouette, 0 to 1, by id; objects outside the image are absent.
    pub visible_shares: BTreeMap<InstanceId, f64>,
}

/// Renderers of the most recently rendered scenes; each reuses its last image of every camera.
#[derive(Debug, Default)]
pub struct Painters {
    kept: Mutex<Vec<(String, Arc<Mutex<Painter>>)>>,
}

/// Renderer of one scene.
#[derive(Debug)]
struct Painter {
    models: Vec<Arc<ObjectModel>>,
    world: World,
    robot: Arc<RobotModel>,
    assets: Arc<RenderAssets>,
    renderer: Renderer,
    /// Number of pixels of an object without occlusion, by everything that it depends on, as text.
    outlines: BTreeMap<String, usize>,
}

/// A scene to draw.
#[derive(Clone, Copy, Debug)]
pub struct Drawn<'a> {
    /// Identity of the scene; images of the same key reuse one renderer.
    pub key: &'a str,
    /// Scenario whose world, cameras and initial state are drawn.
    pub scenario: &'a Scenario,
    /// Models of the scenario's objects, in their order.
    pub models: &'a [Arc<ObjectModel>],
    /// Robot of the scenario's world.
    pub robot: &'a Arc<RobotModel>,
}

impl Painters {
    /// Image of the initial state of a scene.
    ///
    /// # Errors
    /// When the camera does not exist, or the image cannot be rendered.
    pub fn draw(&self, scene: Drawn, camera: &str) -> Result<CameraImage, WorkspaceError> {
        self.with_painter(scene, |painter| painter.draw(scene.scenario, camera))
    }

    /// JPEG of a recorded state of an episode in a scene.
    ///
    /// # Errors
    /// As [`Painters::draw`].
    pub fn draw_state(&self, scene: Drawn, camera: &str, frame: &Frame) -> Result<Vec<u8>, WorkspaceError> {
        self.with_painter(scene, |painter| painter.draw_state(scene.scenario, camera, frame))
    }

    fn with_painter<T>(
        &self,
        scene: Drawn,
        draw: impl FnOnce(&mut Painter) -> Result<T, WorkspaceError>,
    ) -> Result<T, WorkspaceError> {
        let painter = self.painter(scene)?;
        let mut painter = painter.lock().unwrap_or_else(PoisonError::into_inner);
        if !painter.fits(scene) {
            *painter = Painter::new(scene)?;
        }
        draw(&mut painter)
    }

    fn painter(&self, scene: Drawn) -> Result<Arc<Mutex<Painter>>, WorkspaceError> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let painter = match kept.iter().position(|(known, _)| known == scene.key) {
            Some(place) => kept.remove(place).1,
            None => Arc::new(Mutex::new(Painter::new(scene)?)),
        };
        kept.push((scene.key.to_owned(), Arc::clone(&painter)));
        if kept.len() > MAX_SCENES {
            kept.remove(0);
        }
        Ok(painter)
    }
}

impl Painter {
    fn new(Drawn { key: _, scenario, models, robot }: Drawn) -> Result<Self, WorkspaceError> {
        let world = &scenario.world;
        let assets = RenderAssets::new(Arc::clone(robot), models, Some(world)).map_err(not_drawn)?;
        let variation = RenderVariation::of_world(world).map_err(not_drawn)?;
        Ok(Self {
            models: models.to_vec(),
            world: world.clone(),
            robot: Arc::clone(robot),
            renderer: Renderer::new(Arc::clone(&assets), variation),
            assets,
            outlines: BTreeMap::new(),
        })
    }

    /// True if the renderer can be reused: only poses and cameras have changed.
    fn fits(&self, Drawn { scenario, models, .. }: Drawn) -> bool {
        let (old, new) = (&self.world, &scenario.world);
        let same_models =
            self.models.len() == models.len() && self.models.iter().zip(models).all(|(old, new)| Arc::ptr_eq(old, new));
        same_models
            && (&old.surfaces, &old.look, &old.appearance, &old.robot, old.floor_z_m)
                == (&new.surfaces, &new.look, &new.appearance, &new.robot, new.floor_z_m)
    }

    fn draw(&mut self, scenario: &Scenario, name: &str) -> Result<CameraImage, WorkspaceError> {
        let camera = small_camera(scenario, name)?;
        let pinhole = sensor::pinhole(&camera).map_err(not_drawn)?;
        let whole = self.state(scenario, None)?;
        let wanted = Channels { instance: true, ..Channels::RGB };
        let image = self.render(&whole, &pinhole, sensor::needed(&camera, wanted))?;
        let visible = pixels(&image, self.models.len());
        let mut visible_shares = BTreeMap::new();
        for (index, placed) in scenario.objects.iter().enumerate() {
            let outline = self.outline(scenario, index, &pinhole)?;
            if outline > 0 {
                visible_shares.insert(placed.id.clone(), (visible[index] as f64 / outline as f64).min(1.0));
            }
        }
        let jpeg = self.developed(scenario, &camera, wanted, image)?;
        Ok(CameraImage { jpeg, visible_shares })
    }

    fn draw_state(&mut self, scenario: &Scenario, name: &str, frame: &Frame) -> Result<Vec<u8>, WorkspaceError> {
        let camera = small_camera(scenario, name)?;
        let pinhole = sensor::pinhole(&camera).map_err(not_drawn)?;
        let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let state = self.assets.frame_state(&frame.joint_position, frame.gripper_width, objects).map_err(not_drawn)?;
        let image = self.render(&state, &pinhole, sensor::needed(&camera, Channels::RGB))?;
        self.developed(scenario, &camera, Channels::RGB, image)
    }

    /// JPEG of a rendered image as the camera's lens and sensor would give it.
    fn developed(
        &self,
        scenario: &Scenario,
        camera: &Camera,
        wanted: Channels,
        image: FrameBuffers,
    ) -> Result<Vec<u8>, WorkspaceError> {
        let developed = sensor::developed(&self.renderer, camera, wanted, image, scenario.seed).map_err(not_drawn)?;
        jpeg_rgb(developed.width, developed.height, &developed.rgb, QUALITY).map_err(|error| {
            WorkspaceError::broken(format!("cannot encode the image of camera {}", camera.name), error)
        })
    }

    /// Number of pixels of an object rendered without the other objects and the robot.
    fn outline(&mut self, scenario: &Scenario, index: usize, camera: &Camera) -> Result<usize, WorkspaceError> {
        let placed = &scenario.objects[index];
        let Camera { name: _, mount, mount_from_camera, intrinsics, distortion: _, sensor: _ } = camera;
        let Intrinsics { width, height, fx, fy, cx, cy } = intrinsics;
        let seen = (mount_from_camera.to_row(), placed.pose.to_row(), &placed.joint_positions);
        let key = format!("{index} {mount:?} {width} {height} {fx} {fy} {cx} {cy} {seen:?}");
        if let Some(&known) = self.outlines.get(&key) {
            return Ok(known);
        }
        let state = self.state(scenario, Some(index))?;
        let image = self.render(&state, camera, Channels::GEOMETRY)?;
        let outline = pixels(&image, self.models.len())[index];
        if self.outlines.len() >= MAX_OUTLINES {
            self.outlines.clear();
        }
        self.outlines.insert(key, outline);
        Ok(outline)
    }

    /// Initial poses of everything, or with all objects but one out of view. The hand remains, since cameras are
    /// mounted on it.
    fn state(&self, scenario: &Scenario, only: Option<usize>) -> Result<FrameState, WorkspaceError> {
        let away = Pose::from_position(DVec3::Z * AWAY_M);
        let poses = scenario.objects.iter().enumerate().map(|(index, placed)| {
            let is_drawn = only.is_none_or(|only| only == index);
            (if is_drawn { placed.pose } else { away }, placed.joint_positions.as_slice())
        });
        let (start, width) = (scenario.world.robot.start(), self.robot.gripper.max_width);
        let mut state = self.assets.frame_state(start, width, poses).map_err(not_drawn)?;
        if only.is_some() {
            for link in (0..self.robot.links.len()).filter(|&link| link != self.robot.hand) {
                state.body_poses[link] = away;
            }
        }
        Ok(state)
    }

    fn render(
        &mut self,
        state: &FrameState,
        camera: &Camera,
        channels: Channels,
    ) -> Result<FrameBuffers, WorkspaceError> {
        let mut images = [FrameBuffers::default()];
        self.renderer.render(&[ViewJob::new(state, camera, channels)], &mut images).map_err(not_drawn)?;
        let [image] = images;
        Ok(image)
    }
}

/// A camera of a scenario with images of [`SIZE_PX`].
fn small_camera(scenario: &Scenario, name: &str) -> Result<Camera, WorkspaceError> {
    let Some(camera) = scenario.world.camera(name) else {
        let known: Vec<&str> = scenario.world.cameras.iter().map(|camera| camera.name.as_str()).collect();
        return Err(WorkspaceError::unknown("camera", "cameras", name, &known));
    };
    let [width, height] = SIZE_PX;
    Ok(Camera { intrinsics: camera.intrinsics.filling(width, height), ..camera.clone() })
}

fn pixels(image: &FrameBuffers, objects: usize) -> Vec<usize> {
    let mut pixels = vec![0; objects];
    for object in image.instance.iter().filter_map(|&id| object_of_instance(id)) {
        pixels[object] += 1;
    }
    pixels
}

fn not_drawn(error: genmanip_render::RenderError) -> WorkspaceError {
    WorkspaceError::broken("the camera gives no image", error)
}
