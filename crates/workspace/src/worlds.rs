//! World files and the cameras of worlds and scenarios: checking, showing, editing in place.

use crate::documents;
use std::path::Path;
use std::sync::Arc;

use genmanip_assets::{robots, worlds};
use genmanip_core::camera::CameraPreset;
use genmanip_core::glam::DVec3;
use genmanip_core::sensor::SensorPreset;
use genmanip_core::{
    Camera, CameraSensor, Distortion, Document, Intrinsics, Pose, RobotModel, Scenario, World, WorldFault, json, limits,
};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_sim::EngineSettings;

use crate::documents::read_text;
use crate::error::RunError;

/// Height of the camera of a view from above over the table, and how much more than the surfaces it sees; chosen.
const ABOVE_M: f64 = 3.0;
const AROUND: f64 = 1.15;

/// The world in a file, TOML or JSON; the one that comes with the program without.
///
/// # Errors
/// When the file cannot be read, or all faults of the world at once.
pub fn read_world(path: Option<&Path>) -> Result<World, RunError> {
    let Some(path) = path else { return Ok((*worlds::default_world()).clone()) };
    let faults = match worlds::read(&read_text(path, limits::WORLD)?) {
        Ok((world, _)) => match EngineSettings::read(&world.physics.engine) {
            Ok(_) => return Ok(world),
            Err(error) => vec![error.to_string()],
        },
        Err(faults) => faults.iter().map(ToString::to_string).collect(),
    };
    Err(RunError::input(format!("{} is no world: {}", path.display(), faults.join("; ")))
        .with_hint(format!("`genmanip world check {}` lists every fault", path.display())))
}

/// The world in a file or the default one, with another robot when one is named.
///
/// # Errors
/// As [`read_world`], and when there is no such robot.
pub fn read_world_with(path: Option<&Path>, robot: Option<&str>) -> Result<World, RunError> {
    let world = read_world(path)?;
    let Some(name) = robot else { return Ok(world) };
    worlds::with_robot(&world, name)
        .map_err(|error| RunError::input(format!("robot `{name}` cannot be used")).because(error))
}

/// Refuses a world whose robot is another than the one that was named.
///
/// # Errors
/// Names both robots.
pub fn check_robot(world: &World, named: Option<&str>) -> Result<(), RunError> {
    match named {
        Some(name) if name != world.robot.name => Err(RunError::input(format!(
            "the scenario was laid out for robot `{}`, not for `{name}`",
            world.robot.name
        ))
        .with_hint(format!("lay its task out again with --robot {name}"))),
        _ => Ok(()),
    }
}

/// Names of cameras, checked against those of a world.
///
/// # Errors
/// [`RunError::UnknownName`] with the cameras of the world.
pub fn cameras(world: &World, names: &[String]) -> Result<Vec<String>, RunError> {
    let known: Vec<&str> = world.cameras.iter().map(|camera| camera.name.as_str()).collect();
    match names.iter().find(|name| !known.contains(&name.as_str())) {
        Some(unknown) => Err(RunError::unknown("camera", "cameras", unknown, &known)),
        None => Ok(names.to_vec()),
    }
}

/// The robot of a world, starting where the world says.
///
/// # Errors
/// When there is no such robot, or it is not the one the world was made for.
pub fn robot(world: &World) -> Result<Arc<RobotModel>, RunError> {
    robots::of_world(world).map_err(|error| {
        RunError::input(format!("robot `{}` cannot be had", world.robot.name))
            .because(error)
            .with_hint("results of another version of a robot are replayed with the program that made them")
    })
}

/// The planner for the robot of a world.
///
/// # Errors
/// As [`robot`], and when the robot cannot be planned for.
pub fn planner(world: &World, settings: &PlannerSettings) -> Result<Arc<Planner>, RunError> {
    let planner = Planner::new(robot(world)?, settings.clone());
    Ok(Arc::new(planner.map_err(|error| RunError::broken("the robot cannot be planned for", error))?))
}

/// Everything that is wrong with a world file; empty for a sound one.
///
/// # Errors
/// When the file cannot be read.
pub fn check(path: &Path) -> Result<Vec<WorldFault>, RunError> {
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

/// What a file with cameras holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// A world.
    World(Box<World>),
    /// A scenario with its world.
    Scenario(Box<Scenario>),
}

impl Setting {
    /// Reads a world (TOML or JSON) or a scenario.
    ///
    /// # Errors
    /// When the file cannot be read or is neither.
    pub fn read(path: &Path) -> Result<Self, RunError> {
        let text = documents::read_text(path, limits::WORLD_OR_SCENARIO)?;
        let is_scenario = json::parse(&text)
            .is_ok_and(|value| value["schema"].as_str().is_some_and(|schema| schema.starts_with("genmanip.scenario/")));
        Ok(if is_scenario {
            Self::Scenario(Box::new(documents::read_document(path, limits::WORLD_OR_SCENARIO)?))
        } else {
            Self::World(Box::new(read_world(Some(path))?))
        })
    }

    /// The world.
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

    /// A camera by name.
    ///
    /// # Errors
    /// When there is none, naming those there are.
    pub fn camera(&self, name: &str) -> Result<&Camera, RunError> {
        let known: Vec<&str> = self.world().cameras.iter().map(|camera| camera.name.as_str()).collect();
        self.world().camera(name).ok_or_else(|| RunError::unknown("camera", "cameras", name, &known))
    }

    /// A camera that looks straight down on all support surfaces.
    pub fn from_above(&self) -> Camera {
        let bounds = self.world().surfaces.iter().map(genmanip_core::SupportSurface::bounds);
        let bounds = bounds.reduce(|all, bounds| all.union(&bounds)).unwrap_or(genmanip_core::Aabb::EMPTY);
        let (center, size) = (bounds.center(), bounds.size());
        let high = bounds.max.z.max(0.0) + ABOVE_M;
        // The picture's rows run along the world's y.
        let (width, height) = (720, 720);
        let fov = 2.0 * (AROUND * size.x.max(size.y) / 2.0 / ABOVE_M).atan();
        let (eye, target) = (DVec3::new(center.x, center.y, high), DVec3::new(center.x, center.y, 0.0));
        Camera::looking_at("above", eye, target, Intrinsics::from_vertical_fov(width, height, fov))
    }
}

/// What a user says about a camera; what is missing stays as it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraChange {
    /// Name of a preset, see [`genmanip_core::camera::PRESETS`].
    pub preset: Option<String>,
    /// Pixels per row and rows.
    pub size_px: Option<[u32; 2]>,
    /// Vertical field of view, rad.
    pub vertical_fov_rad: Option<f64>,
    /// Where it is and what it looks at, metres.
    pub view: Option<[DVec3; 2]>,
    /// On the hand, where the robot has its wrist camera.
    pub on_hand: bool,
    /// Name of its sensors, see [`genmanip_core::sensor::SENSORS`], or `none`.
    pub sensor: Option<String>,
    /// How long its shutter is open, s.
    pub shutter_s: Option<f64>,
    /// Its lens; all zeros for none.
    pub distortion: Option<Distortion>,
}

impl CameraChange {
    /// A camera with this said about it; `before` is the camera so far.
    fn applied(&self, name: &str, before: Option<&Camera>, robot: &RobotModel) -> Result<Camera, RunError> {
        let needs = |what: &str| RunError::input(format!("camera `{name}` needs {what}"));
        let known = CameraPreset::names();
        let preset = self.preset.as_ref().map(|preset| {
            CameraPreset::named(preset)
                .map(CameraPreset::intrinsics)
                .ok_or_else(|| RunError::unknown("preset", "presets", preset, &known))
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
            (Some([eye, target]), _, _) => (genmanip_core::CameraMount::World, Camera::pose_looking_at(eye, target)),
            (None, true, _) => {
                let wrist = robot.hand_from_wrist_camera;
                (genmanip_core::CameraMount::Hand, wrist.ok_or_else(|| needs("a robot that has a wrist camera"))?)
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
                    .ok_or_else(|| RunError::unknown("sensor", "sensors", sensor, &known))?
                    .sensor,
            ),
        };
        let sensor = self.shutter_s.map_or(sensor, |shutter_s| CameraSensor::with_shutter(sensor, shutter_s));
        let distortion = self.distortion.or(before.and_then(|camera| camera.distortion));
        let distortion = distortion.filter(|lens| *lens != Distortion::default());
        Ok(Camera { sensor, distortion, ..Camera::new(name, mount, pose, intrinsics) })
    }
}

/// What is done to the cameras of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraEdit {
    /// A new camera.
    Add(String, CameraChange),
    /// Another view or projection of one that is there.
    Set(String, CameraChange),
    /// One less.
    Remove(String),
}

/// Edits the cameras of a world or scenario file in place: written aside, flushed, renamed.
/// Comments of a TOML file stay, those within the camera's own entry apart.
///
/// # Errors
/// When the file cannot be read or written, the name does not fit, or the world would be faulty afterwards; the file is
/// unchanged then.
pub fn edit(path: &Path, edit: &CameraEdit) -> Result<Setting, RunError> {
    let text = documents::read_text(path, limits::WORLD_OR_SCENARIO)?;
    let mut setting = Setting::read(path)?;
    let robot = robot(setting.world())?;
    let at = |setting: &Setting, name: &str| {
        setting.camera(name)?;
        Ok::<_, RunError>(setting.world().cameras.iter().position(|camera| camera.name == name).unwrap_or_default())
    };
    match edit {
        CameraEdit::Add(name, change) => {
            if setting.world().camera(name).is_some() {
                return Err(RunError::input(format!("{} has a camera `{name}` already", path.display()))
                    .with_hint("change it with `genmanip camera set`"));
            }
            let camera = change.applied(name, None, &robot)?;
            setting.world_mut().cameras.push(camera);
        }
        CameraEdit::Set(name, change) => {
            let index = at(&setting, name)?;
            let before = setting.camera(name)?.clone();
            setting.world_mut().cameras[index] = change.applied(name, Some(&before), &robot)?;
        }
        CameraEdit::Remove(name) => {
            let index = at(&setting, name)?;
            setting.world_mut().cameras.remove(index);
        }
    }
    let faults: Vec<String> = setting.world().faults(&robot).iter().map(ToString::to_string).collect();
    if !faults.is_empty() {
        return Err(RunError::input(format!("{} would be faulty: {}", path.display(), faults.join("; "))));
    }
    let written = match &setting {
        Setting::Scenario(scenario) => scenario.to_json(),
        Setting::World(world) if text.trim_start().starts_with('{') => world.to_json(),
        Setting::World(world) => {
            let (CameraEdit::Add(name, _) | CameraEdit::Set(name, _) | CameraEdit::Remove(name)) = edit;
            let edited = edited_toml(&text, name, world.camera(name));
            // Believed only if it reads back as what was meant.
            if worlds::read(&edited).ok().map(|(read, _)| read) != Some((**world).clone()) {
                return Err(RunError::input(format!(
                    "the cameras of {} stand in no form of their own",
                    path.display()
                ))
                .with_hint("write each camera as a [[cameras]] table, or keep the world as JSON"));
            }
            edited
        }
    };
    documents::write_file(path, written.as_bytes())?;
    Ok(setting)
}

/// The text with the `[[cameras]]` table of that name replaced, taken out or added behind all others.
fn edited_toml(text: &str, name: &str, camera: Option<&Camera>) -> String {
    let lines: Vec<&str> = text.lines().collect();
    let is_header = |line: &str| line.trim_start().starts_with('[');
    let begins = (0..lines.len()).filter(|&index| lines[index].trim().starts_with("[[cameras]]"));
    let table = begins
        .map(|begin| {
            let rest = lines[begin + 1..].iter().position(|line| {
                is_header(line) && !line.trim_start().starts_with("[cameras.") || line.trim_start().starts_with('#')
            });
            (begin, rest.map_or(lines.len(), |rest| begin + 1 + rest))
        })
        .find(|&(begin, end)| {
            lines[begin..end].iter().any(|line| {
                let value = line.split_once('=').filter(|(key, _)| key.trim() == "name").map(|(_, value)| value.trim());
                value.is_some_and(|value| value.trim_matches(['"', '\'']).split('"').next() == Some(name))
            })
        });
    let entry = camera.map(table_of).unwrap_or_default();
    let (before, after) = match table {
        Some((begin, end)) => (&lines[..begin], &lines[end..]),
        None => (&lines[..], &[][..]),
    };
    let mut edited = before.join("\n").trim_end().to_owned() + "\n";
    if !entry.is_empty() {
        edited += &format!("\n{entry}");
    }
    if !after.is_empty() {
        edited += &format!("\n{}\n", after.join("\n").trim());
    }
    edited
}

/// A camera as a table of a world file.
fn table_of(camera: &Camera) -> String {
    let Pose { position, .. } = camera.mount_from_camera;
    let k = &camera.intrinsics;
    let mount = match camera.mount {
        genmanip_core::CameraMount::World => "world",
        genmanip_core::CameraMount::Hand => "hand",
    };
    let inline = |key: &str, value: Option<serde_json::Value>| {
        value.map_or_else(String::new, |value| format!("{key} = {}\n", inline_table(&value)))
    };
    let distortion = inline("distortion", camera.distortion.map(|lens| serde_json::json!(lens)));
    let sensor = inline("sensor", camera.sensor.map(|sensor| serde_json::json!(sensor)));
    format!(
        "[[cameras]]\nname = \"{}\"\nmount = \"{mount}\"\nmount_from_camera = {{ position_m = {:?}, orientation_wxyz = \
         {:?} }}\nintrinsics = {{ width = {}, height = {}, fx = {:?}, fy = {:?}, cx = {:?}, cy = {:?} }}\n{distortion}{sensor}",
        camera.name,
        position.to_array(),
        camera.mount_from_camera.to_wxyz_array(),
        k.width,
        k.height,
        k.fx,
        k.fy,
        k.cx,
        k.cy
    )
}

/// A value of JSON as TOML writes it on one line.
fn inline_table(value: &serde_json::Value) -> String {
    use serde_json::Value;
    match value {
        Value::Object(map) => {
            let fields: Vec<String> =
                map.iter().map(|(key, value)| format!("{key} = {}", inline_table(value))).collect();
            format!("{{ {} }}", fields.join(", "))
        }
        Value::Array(list) => format!("[{}]", list.iter().map(inline_table).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}
