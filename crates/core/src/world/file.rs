//! World files written by people: TOML or JSON, with shorthands that are resolved for the robot.

use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};

use super::check::check_parts;
use super::{PhysicsSettings, RelationSettings, Workspace, World, WorldFault, WorldRobot};
use crate::camera::CameraPreset;
use crate::json as strict;
use crate::names::near_misses;
use crate::sensor::SensorPreset;
use crate::{Camera, CameraMount, Document, DocumentError, Intrinsics, RobotModel};

/// A world file before its shorthands are resolved.
///
/// Shorthands: `robot` may omit hash and home position; a camera may give `eye_m` and `target_m` in its mount's frame
/// instead of a pose, a size with a field of view or a `preset` instead of intrinsics, a device name instead of
/// `sensor` parameters; a wrist camera may omit its pose to use the robot's default.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldFile {
    body: Map<String, Value>,
}

/// Top-level keys, in the order of the file.
const KEYS: [&str; 9] =
    ["surfaces", "floor_z_m", "workspace", "robot", "cameras", "physics", "relations", "look", "appearance"];

/// Keys of a camera in the file after [`read_camera`] has replaced the shorthands.
const CAMERA_KEYS: [&str; 6] = ["name", "mount", "mount_from_camera", "intrinsics", "distortion", "sensor"];
const CAMERA_SHORTHANDS: [&str; 6] =
    ["eye_m", "target_m", "size_px", "vertical_fov_deg", "horizontal_fov_deg", "preset"];

impl WorldFile {
    /// Reads JSON (a text that starts with `{`) or TOML, and checks the schema.
    ///
    /// # Errors
    /// The position of a syntax error, or an unexpected schema.
    pub fn from_text(text: &str) -> Result<Self, WorldFault> {
        let value: Value = if text.trim_start().starts_with('{') {
            strict::parse(text).map_err(|error| match error {
                DocumentError::NotJson { line, column, message, hint } => {
                    WorldFault::new(format!("line {line}, column {column}"), "JSON", message).hint(hint)
                }
                error => WorldFault::new("the file", "JSON", error),
            })?
        } else {
            toml::from_str(text).map_err(|error| {
                let line = error.span().map_or(1, |span| text[..span.start.min(text.len())].matches('\n').count() + 1);
                WorldFault::new(format!("line {line}"), "TOML", error.message())
            })?
        };
        let Value::Object(mut body) = value else {
            return Err(WorldFault::new("the file", "a table", "another value"));
        };
        match body.shift_remove("schema") {
            Some(Value::String(schema)) if schema == World::SCHEMA => Ok(Self { body }),
            other => {
                let got = other.map_or("none".into(), |schema| schema.to_string());
                Err(WorldFault::new("schema", format!("\"{}\"", World::SCHEMA), got)
                    .hint("`genmanip world init` writes a complete world to start from"))
            }
        }
    }

    /// Name of the robot in the file; `None` if it is missing.
    pub fn robot_name(&self) -> Option<&str> {
        self.body.get("robot")?.get("name")?.as_str()
    }

    /// Resolves every shorthand for a robot and validates the world.
    ///
    /// # Errors
    /// All faults found.
    pub fn resolve(mut self, robot: &RobotModel) -> Result<World, Vec<WorldFault>> {
        let mut faults = Vec::new();
        for key in self.body.keys().filter(|key| !KEYS.contains(&key.as_str())) {
            let near = KEYS.iter().find(|known| known.starts_with(&key[..key.len().min(3)]));
            let hint = near.map_or_else(|| format!("there are {}", KEYS.join(", ")), |near| format!("`{near}`?"));
            faults.push(WorldFault::new(key, "a known key", format!("`{key}`")).hint(hint));
        }
        if let Some(Value::Object(named)) = self.body.get_mut("robot") {
            named.entry("physics_hash").or_insert_with(|| robot.physics_hash().into());
            named.entry("home").or_insert_with(|| json!(robot.home));
        }
        let cameras = match self.body.shift_remove("cameras") {
            None => Vec::new(),
            Some(Value::Array(entries)) => entries
                .into_iter()
                .enumerate()
                .filter_map(|(index, entry)| {
                    let camera = read_camera(entry, robot, &format!("cameras[{index}]"));
                    camera.map_err(|fault| faults.push(fault)).ok()
                })
                .collect(),
            Some(other) => {
                faults.push(WorldFault::new("cameras", "a list", other));
                Vec::new()
            }
        };
        let surfaces = match self.body.shift_remove("surfaces") {
            Some(Value::Array(entries)) => entries
                .into_iter()
                .enumerate()
                .filter_map(|(index, entry)| {
                    parse(entry, &format!("surfaces[{index}]")).map_err(|fault| faults.push(fault)).ok()
                })
                .collect(),
            other => {
                faults.push(WorldFault::new("surfaces", "a list, the table first", other.unwrap_or_default()));
                Vec::new()
            }
        };
        let floor_z_m: Option<f64> = self.section("floor_z_m", &mut faults);
        let workspace: Option<Workspace> = self.section("workspace", &mut faults);
        let named: Option<WorldRobot> = self.section("robot", &mut faults);
        let physics: Option<PhysicsSettings> = self.section("physics", &mut faults);
        let relations: Option<RelationSettings> = self.section("relations", &mut faults);
        let look = self.body.contains_key("look").then(|| self.section("look", &mut faults)).flatten();
        let appearance =
            self.body.contains_key("appearance").then(|| self.section("appearance", &mut faults)).flatten();
        if floor_z_m.is_none() || workspace.is_none() || named.is_none() || physics.is_none() || relations.is_none() {
            // Validate the sections that could be read.
            check_parts(&cameras, physics.as_ref(), relations.as_ref(), &mut faults);
        }
        let (Some(floor_z_m), Some(workspace), Some(named), Some(physics), Some(relations)) =
            (floor_z_m, workspace, named, physics, relations)
        else {
            return Err(faults);
        };
        let world =
            World { surfaces, floor_z_m, workspace, robot: named, cameras, physics, relations, look, appearance };
        faults.extend(world.faults(robot));
        if faults.is_empty() { Ok(world) } else { Err(faults) }
    }

    fn section<T: DeserializeOwned>(&mut self, key: &str, faults: &mut Vec<WorldFault>) -> Option<T> {
        let Some(value) = self.body.shift_remove(key) else {
            faults.push(WorldFault::new(key, "a value", "none").hint("`genmanip world init` shows all sections"));
            return None;
        };
        parse(value, key).map_err(|fault| faults.push(fault)).ok()
    }
}

/// Reads a camera entry and resolves its shorthands for a robot.
///
/// # Errors
/// [`WorldFault`] with the field path of an invalid value.
pub fn read_camera(entry: Value, robot: &RobotModel, place: &str) -> Result<Camera, WorldFault> {
    let Value::Object(mut body) = entry else { return Err(WorldFault::new(place, "a table", entry)) };
    let mut take = |key: &str| body.shift_remove(key);
    let (eye, target) = (take("eye_m"), take("target_m"));
    let (size, vertical, horizontal) = (take("size_px"), take("vertical_fov_deg"), take("horizontal_fov_deg"));
    let preset = take("preset");
    let point =
        |value: Value, key: &str| -> Result<glam::DVec3, WorldFault> { parse(value, &format!("{place}.{key}")) };
    match (eye, target) {
        (Some(eye), Some(target)) => {
            let (eye, target) = (point(eye, "eye_m")?, point(target, "target_m")?);
            if !(eye - target).is_finite() || eye.distance(target) < 1e-6 {
                return Err(WorldFault::new(format!("{place}.target_m"), "another point than eye_m", target));
            }
            let mount = body.entry("mount").or_insert_with(|| "world".into()).clone();
            let mount: CameraMount = parse(mount, &format!("{place}.mount"))?;
            body.insert("mount_from_camera".into(), json!(mount.pose_looking_at(eye, target)));
        }
        (None, None) => {}
        _ => return Err(WorldFault::new(place, "eye_m and target_m together", "only one of them")),
    }
    let on_hand = body.get("mount").and_then(Value::as_str) == Some("hand");
    if on_hand && let (None, Some(pose)) = (body.get("mount_from_camera"), robot.hand_from_wrist_camera) {
        body.insert("mount_from_camera".into(), json!(pose));
    }
    let mut intrinsics = match preset {
        Some(preset) => {
            let name = preset.as_str().unwrap_or_default();
            let known = CameraPreset::names();
            let found = CameraPreset::named(name).map(CameraPreset::intrinsics).ok_or_else(|| {
                let fault = WorldFault::new(format!("{place}.preset"), format!("one of {}", known.join(", ")), &preset);
                match near_misses(name, &known).first() {
                    Some(near) => fault.hint(format!("did you mean `{near}`?")),
                    None => fault,
                }
            });
            Some(found?)
        }
        None => None,
    };
    if let Some(size) = size {
        let [width, height]: [u32; 2] = parse(size, &format!("{place}.size_px"))?;
        let angle = |value: Value, key: &str| -> Result<f64, WorldFault> {
            let degrees: f64 = parse(value, &format!("{place}.{key}"))?;
            let is_angle = degrees > 0.0 && degrees < 180.0;
            is_angle
                .then(|| degrees.to_radians())
                .ok_or_else(|| WorldFault::new(format!("{place}.{key}"), "an angle between 0 and 180 degrees", degrees))
        };
        intrinsics = Some(match (vertical, horizontal, intrinsics) {
            (Some(value), None, None) => {
                Intrinsics::from_vertical_fov(width, height, angle(value, "vertical_fov_deg")?)
            }
            (None, Some(value), None) => {
                Intrinsics::from_horizontal_fov(width, height, angle(value, "horizontal_fov_deg")?)
            }
            (None, None, Some(preset)) => preset.filling(width, height),
            _ => {
                let expected = "size_px with one of preset, vertical_fov_deg and horizontal_fov_deg";
                return Err(WorldFault::new(place, expected, "none or several of them"));
            }
        });
    }
    if let Some(intrinsics) = intrinsics {
        body.insert("intrinsics".into(), json!(intrinsics));
    }
    if let Some(name) = body.get("sensor").and_then(Value::as_str) {
        let known = SensorPreset::names();
        let Some(preset) = SensorPreset::named(name) else {
            let fault = WorldFault::new(format!("{place}.sensor"), format!("one of {}", known.join(", ")), name);
            return Err(fault.hint("or give the parameters of a sensor; see docs/formats/world.md"));
        };
        body.insert("sensor".into(), json!(preset.sensor));
    }
    if let Some(unknown) = body.keys().find(|key| !CAMERA_KEYS.contains(&key.as_str())) {
        let known = [CAMERA_KEYS.as_slice(), &CAMERA_SHORTHANDS].concat();
        let near = near_misses(unknown, &known).first().map(|near| format!("did you mean `{near}`?"));
        let hint = near.unwrap_or_else(|| format!("there are {}", known.join(", ")));
        return Err(WorldFault::new(format!("{place}.{unknown}"), "a known key", format!("`{unknown}`")).hint(hint));
    }
    parse(Value::Object(body), place)
}

fn parse<T: DeserializeOwned>(value: Value, place: &str) -> Result<T, WorldFault> {
    serde_path_to_error::deserialize(&value).map_err(|error| {
        let inside = error.path().to_string();
        let place = if inside == "." { place.to_owned() } else { format!("{place}.{inside}") };
        WorldFault::new(place, "a valid value", error.inner())
    })
}
