//! World files, and the cameras of worlds and scenarios: reading, checking, editing in place.

use crate::documents;
use std::path::Path;
use std::sync::Arc;

use genmanip_assets::world_text::WorldText;
use genmanip_assets::{robots, worlds};
use genmanip_core::camera::CameraPreset;
use genmanip_core::glam::DVec3;
use genmanip_core::sensor::SensorPreset;
use genmanip_core::{
    Camera, CameraMount, CameraSensor, Distortion, Document, Intrinsics, RobotModel, Scenario, World, WorldFault, json,
    limits,
};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_sim::EngineSettings;

use crate::documents::read_text;
use crate::error::WorkspaceError;

/// Height of the top-down camera above the highest surface (m), and (`AROUND`) ratio of its view's width to that of the
/// surfaces. Chosen by hand.
const ABOVE_M: f64 = 3.0;
const AROUND: f64 = 1.15;

/// World in a TOML or JSON file; the built-in default world without a path.
///
/// # Errors
/// When the file cannot be read; lists all faults of the world.
pub fn read_world(path: Option<&Path>) -> Result<World, WorkspaceError> {
    let Some(path) = path else { return Ok((*worlds::default_world()).clone()) };
    let faults = match worlds::read(&read_text(path, limits::WORLD)?) {
        Ok((world, _)) => match EngineSettings::read(&world.physics.engine) {
            Ok(_) => return Ok(world),
            Err(error) => vec![error.to_string()],
        },
        Err(faults) => faults.iter().map(ToString::to_string).collect(),
    };
    Err(WorkspaceError::input(format!("{} is no world: {}", path.display(), faults.join("; ")))
        .with_hint(format!("`genmanip world check {}` lists every fault", path.display())))
}

/// World in a file, or the default one, optionally with another robot, whose reach the default one then suits
/// ([`worlds::text_for`]).
///
/// # Errors
/// As [`read_world`], and when the robot is unknown.
pub fn read_world_with(path: Option<&Path>, robot: Option<&str>) -> Result<World, WorkspaceError> {
    let world = match (path, robot) {
        (_, None) => return read_world(path),
        (None, Some(name)) => worlds::for_robot(name),
        (Some(_), Some(name)) => worlds::with_robot(&read_world(path)?, name),
    };
    let name = robot.unwrap_or_default();
    world.map_err(|error| WorkspaceError::input(format!("robot `{name}` cannot be used")).because(error))
}

/// Rejects a world whose robot differs from the named one.
///
/// # Errors
/// When they differ, with both names.
pub fn check_robot(world: &World, named: Option<&str>) -> Result<(), WorkspaceError> {
    match named {
        Some(name) if name != world.robot.name => Err(WorkspaceError::input(format!(
            "the scenario was laid out for robot `{}`, not for `{name}`",
            world.robot.name
        ))
        .with_hint(format!("lay its task out again with --robot {name}"))),
        _ => Ok(()),
    }
}

/// Checks that a world has all named cameras; returns the names.
///
/// # Errors
/// [`WorkspaceError::UnknownName`] with the cameras of the world.
pub fn cameras(world: &World, names: &[String]) -> Result<Vec<String>, WorkspaceError> {
    let known: Vec<&str> = world.cameras.iter().map(|camera| camera.name.as_str()).collect();
    match names.iter().find(|name| !known.contains(&name.as_str())) {
        Some(unknown) => Err(WorkspaceError::unknown("camera", "cameras", unknown, &known)),
        None => Ok(names.to_vec()),
    }
}

/// Robot of a world, with the world's home configuration.
///
/// # Errors
/// When the robot is unknown, or differs from the one that the world was made with.
pub fn robot(world: &World) -> Result<Arc<RobotModel>, WorkspaceError> {
    robots::of_world(world).map_err(|error| {
        WorkspaceError::input(format!("robot `{}` cannot be had", world.robot.name))
            .because(error)
            .with_hint("results of another version of a robot are replayed with the program that made them")
    })
}

/// Planner for the robot of a world.
///
/// # Errors
/// As [`robot`], and when the planner does not support the robot.
pub fn planner(world: &World, settings: &PlannerSettings) -> Result<Arc<Planner>, WorkspaceError> {
    let planner = Planner::new(robot(world)?, settings.clone());
    Ok(Arc::new(planner.map_err(|error| WorkspaceError::broken("the robot cannot be planned for", error))?))
}

/// All faults of a world file; empty if it is valid. Also compiles the physics model.
///
/// # Errors
/// When the file cannot be read.
pub fn check(path: &Path) -> Result<Vec<WorldFault>, WorkspaceError> {
    let (world, robot) = match worlds::read(&documents::read_text(path, limits::WORLD)?) {
        Ok(read) => read,
        Err(faults) => return Ok(faults),
    };
    let mut faults = Vec::new();
    if let Err(error) = EngineSettings::read(&world.physics.engine) {
        faults.push(WorldFault::new("physics.engine", "the knobs of the engine", error));
    } else if let Err(error) = genmanip_sim::Model::compile(&world, &robot, &[]) {
        faults.push(WorldFault::new("the whole", "a world that physics can compile", error));
    }
    Ok(faults)
}

/// File with cameras: a world or a scenario.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraFile {
    /// A world file.
    World(Box<World>),
    /// A scenario with its world.
    Scenario(Box<Scenario>),
}

impl CameraFile {
    /// Reads a world (TOML or JSON) or a scenario.
    ///
    /// # Errors
    /// When the file cannot be read or is neither.
    pub fn read(path: &Path) -> Result<Self, WorkspaceError> {
        let text = documents::read_text(path, limits::WORLD_OR_SCENARIO)?;
        let is_scenario = json::parse(&text)
            .is_ok_and(|value| value["schema"].as_str().is_some_and(|schema| schema.starts_with("genmanip.scenario/")));
        Ok(if is_scenario {
            Self::Scenario(Box::new(documents::read_document(path, limits::WORLD_OR_SCENARIO)?))
        } else {
            Self::World(Box::new(read_world(Some(path))?))
        })
    }

    /// World, or world of the scenario.
    pub fn world(&self) -> &World {
        match self {
            Self::World(world) => world,
            Self::Scenario(scenario) => &scenario.world,
        }
    }

    fn world_mut(&mut self) -> &mut World {
        match self {
            Self::World(world) => world,
            Self::Scenario(scenario) => &mut scenario.world,
        }
    }

    /// Camera by name.
    ///
    /// # Errors
    /// [`WorkspaceError::UnknownName`] with the cameras of the world.
    pub fn camera(&self, name: &str) -> Result<&Camera, WorkspaceError> {
        let known: Vec<&str> = self.world().cameras.iter().map(|camera| camera.name.as_str()).collect();
        self.world().camera(name).ok_or_else(|| WorkspaceError::unknown("camera", "cameras", name, &known))
    }

    /// Top-down camera that sees all support surfaces.
    pub fn from_above(&self) -> Camera {
        let bounds = self.world().surfaces.iter().map(genmanip_core::SupportSurface::bounds);
        let bounds = bounds.reduce(|all, bounds| all.union(&bounds)).unwrap_or(genmanip_core::Aabb::EMPTY);
        let (center, size) = (bounds.center(), bounds.size());
        let high = bounds.max.z.max(0.0) + ABOVE_M;
        // Image rows are parallel to the world's y axis.
        let (width, height) = (720, 720);
        let fov = 2.0 * (AROUND * size.x.max(size.y) / 2.0 / ABOVE_M).atan();
        let (eye, target) = (DVec3::new(center.x, center.y, high), DVec3::new(center.x, center.y, 0.0));
        Camera::looking_at("above", eye, target, Intrinsics::from_vertical_fov(width, height, fov))
    }
}

/// Requested change of a camera; fields that are `None` stay unchanged.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraChange {
    /// Name of a preset, see [`genmanip_core::camera::PRESETS`].
    pub preset: Option<String>,
    /// Image width and height, pixels.
    pub size_px: Option<[u32; 2]>,
    /// Vertical field of view, rad.
    pub vertical_fov_rad: Option<f64>,
    /// Position of the camera and the point at the centre of its image, in the frame of its mount, m.
    pub view: Option<[DVec3; 2]>,
    /// True to mount the camera on the hand; without `view`, at the pose of the robot's wrist camera.
    pub on_hand: bool,
    /// Name of a sensor preset, see [`genmanip_core::sensor::SENSORS`], or `none`.
    pub sensor: Option<String>,
    /// Exposure time in the camera's sensor model, s.
    pub shutter_s: Option<f64>,
    /// Lens distortion; all zeros for none.
    pub distortion: Option<Distortion>,
}

impl CameraChange {
    /// The camera with this change applied; `before` is the current camera, `None` for a new one.
    fn applied(&self, name: &str, before: Option<&Camera>, robot: &RobotModel) -> Result<Camera, WorkspaceError> {
        let needs = |what: &str| WorkspaceError::input(format!("camera `{name}` needs {what}"));
        let known = CameraPreset::names();
        let preset = self.preset.as_ref().map(|preset| {
            CameraPreset::named(preset)
                .map(CameraPreset::intrinsics)
                .ok_or_else(|| WorkspaceError::unknown("preset", "presets", preset, &known))
        });
        let base = preset.transpose()?.or(before.map(|camera| camera.intrinsics));
        let intrinsics = match (base, self.size_px, self.vertical_fov_rad) {
            (Some(base), size, Some(fov)) => {
                let [width, height] = size.unwrap_or([base.width, base.height]);
                Intrinsics::from_vertical_fov(width, height, fov)
            }
            (None, Some([width, height]), Some(fov)) => Intrinsics::from_vertical_fov(width, height, fov),
            (Some(base), Some([width, height]), None) => base.filling(width, height),
            (Some(base), None, None) => base,
            (None, _, _) => return Err(needs("--preset, or --size and --fov-deg")),
        };
        let (mount, pose) = match (self.view, self.on_hand, before) {
            (Some([eye, target]), _, _) if (eye - target).length() < 1e-6 => {
                return Err(needs("a --target that is another point than --eye"));
            }
            (Some([eye, target]), on_hand, before) => {
                let kept = before.map_or(CameraMount::World, |camera| camera.mount);
                let mount = if on_hand { CameraMount::Hand } else { kept };
                (mount, mount.pose_looking_at(eye, target))
            }
            (None, true, _) => {
                let wrist = robot.hand_from_wrist_camera;
                (
                    CameraMount::Hand,
                    wrist.ok_or_else(|| needs("a robot that has a wrist camera, or --eye and --target"))?,
                )
            }
            (None, false, Some(before)) => (before.mount, before.mount_from_camera),
            (None, false, None) => return Err(needs("--eye and --target, or --hand")),
        };
        let known = SensorPreset::names();
        let sensor = match self.sensor.as_deref() {
            None => before.and_then(|camera| camera.sensor),
            Some("none") => None,
            Some(sensor) => Some(
                SensorPreset::named(sensor)
                    .ok_or_else(|| WorkspaceError::unknown("sensor", "sensors", sensor, &known))?
                    .sensor,
            ),
        };
        let sensor = self.shutter_s.map_or(sensor, |shutter_s| CameraSensor::with_shutter(sensor, shutter_s));
        let distortion = self.distortion.or(before.and_then(|camera| camera.distortion));
        let distortion = distortion.filter(|lens| *lens != Distortion::default());
        Ok(Camera { sensor, distortion, ..Camera::new(name, mount, pose, intrinsics) })
    }
}

/// Edit of the cameras of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraEdit {
    /// Adds a camera of this name, which must be new.
    Add(String, CameraChange),
    /// Changes the existing camera of this name.
    Set(String, CameraChange),
    /// Replaces the camera of the same name by a calibrated one but keeps its sensor model, or adds the calibrated
    /// camera.
    Put(Box<Camera>),
    /// Removes the camera of this name.
    Remove(String),
}

/// Edits the cameras of a world or scenario file in place with an atomic write. Comments of a TOML file are kept,
/// except within the camera's own entry.
///
/// # Errors
/// When the file cannot be read or written, the name is unknown or already in use, or the edited world would be
/// invalid; the file is then unchanged.
pub fn edit(path: &Path, edit: &CameraEdit) -> Result<CameraFile, WorkspaceError> {
    let text = documents::read_text(path, limits::WORLD_OR_SCENARIO)?;
    let mut setting = CameraFile::read(path)?;
    let robot = robot(setting.world())?;
    let at = |setting: &CameraFile, name: &str| {
        setting.camera(name)?;
        Ok::<_, WorkspaceError>(
            setting.world().cameras.iter().position(|camera| camera.name == name).unwrap_or_default(),
        )
    };
    let index = match edit {
        CameraEdit::Add(name, change) => {
            if setting.world().camera(name).is_some() {
                return Err(WorkspaceError::input(format!("{} has a camera `{name}` already", path.display()))
                    .with_hint("change it with `genmanip camera set`"));
            }
            let camera = change.applied(name, None, &robot)?;
            let cameras = &mut setting.world_mut().cameras;
            cameras.push(camera);
            cameras.len() - 1
        }
        CameraEdit::Set(name, change) => {
            let index = at(&setting, name)?;
            let before = setting.camera(name)?.clone();
            setting.world_mut().cameras[index] = change.applied(name, Some(&before), &robot)?;
            index
        }
        CameraEdit::Put(camera) => {
            let cameras = &mut setting.world_mut().cameras;
            let index = cameras.iter().position(|old| old.name == camera.name).unwrap_or(cameras.len());
            match cameras.get_mut(index) {
                Some(old) => *old = Camera { sensor: old.sensor, ..(**camera).clone() },
                None => cameras.push((**camera).clone()),
            }
            index
        }
        CameraEdit::Remove(name) => {
            let index = at(&setting, name)?;
            setting.world_mut().cameras.remove(index);
            index
        }
    };
    let faults: Vec<String> = setting.world().faults(&robot).iter().map(ToString::to_string).collect();
    if !faults.is_empty() {
        return Err(WorkspaceError::input(format!("{} would be faulty: {}", path.display(), faults.join("; "))));
    }
    let written = match &setting {
        CameraFile::Scenario(scenario) => scenario.to_json(),
        CameraFile::World(world) if text.trim_start().starts_with('{') => world.to_json(),
        CameraFile::World(world) => {
            let edited = WorldText::read(&text).and_then(|mut text| {
                match edit {
                    CameraEdit::Remove(_) => text.remove_camera(index)?,
                    _ => text.put_camera(index, &world.cameras[index])?,
                }
                Ok(text.to_string())
            });
            edited.map_err(|error| {
                WorkspaceError::input(format!("the cameras of {} cannot be edited", path.display())).because(error)
            })?
        }
    };
    documents::write_file(path, written.as_bytes())?;
    Ok(setting)
}
