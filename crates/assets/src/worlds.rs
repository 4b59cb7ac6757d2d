//! Parsing of worlds, with their robots from the registry.

use std::sync::{Arc, OnceLock};

use genmanip_core::{CameraMount, RobotModel, World, WorldFault, WorldFile, WorldRobot};

use crate::{AssetError, robots};

/// Default world as a commented TOML file, which is also used as a template.
pub const DEFAULT_TEXT: &str = include_str!("../data/world.toml");

/// World parsed from [`DEFAULT_TEXT`]; the same `Arc` on every call.
///
/// # Panics
/// Never in a tested build: the text is compiled in.
pub fn default_world() -> Arc<World> {
    static DEFAULT: OnceLock<Arc<World>> = OnceLock::new();
    let read = || match read(DEFAULT_TEXT) {
        Ok((world, _)) => Arc::new(world),
        Err(faults) => panic!("the built-in world is tested: {faults:?}"),
    };
    Arc::clone(DEFAULT.get_or_init(read))
}

/// Default world for a robot as a commented TOML file: the workspace and the fixed cameras are scaled to a short reach
/// ([`RobotModel::reach_scale`]) about the robot's base, so that images show the workspace at the same size.
pub fn text_for(robot: &RobotModel) -> String {
    scaled_text(robot.reach_scale()).replace("name = \"panda\"", &format!("name = \"{}\"", robot.name))
}

/// Lengths of the default world that follow the robot's reach.
const SCALED_KEYS: [&str; 4] = ["x", "y", "eye_m", "target_m"];

fn scaled_text(scale: f64) -> String {
    if scale == 1.0 {
        return DEFAULT_TEXT.to_owned();
    }
    let scaled = |line: &str| {
        let (key, numbers) = line.split_once(" = [").filter(|(key, _)| SCALED_KEYS.contains(key))?;
        let metres = numbers.strip_suffix(']')?.split(", ").map(str::parse::<f64>);
        let metres: Vec<String> =
            metres.map(|number| Some(format!("{:.4}", number.ok()? * scale))).collect::<Option<_>>()?;
        Some(format!("{key} = [{}]", metres.join(", ")))
    };
    DEFAULT_TEXT.lines().map(|line| scaled(line).unwrap_or_else(|| line.to_owned()) + "\n").collect()
}

/// Default world for a robot, see [`text_for`]; one without a wrist camera keeps that of the default robot.
///
/// # Errors
/// [`AssetError::UnknownRobot`] with near misses; [`AssetError::Data`] if its reach does not suit the world.
pub fn for_robot(name: &str) -> Result<World, AssetError> {
    let (world, _) = read(&scaled_text(robots::named(name)?.reach_scale())).map_err(|faults| {
        let faults: Vec<String> = faults.iter().map(ToString::to_string).collect();
        AssetError::Data { file: format!("the default world for robot {name}"), message: faults.join("; ") }
    })?;
    with_robot(&world, name)
}

/// Parses a world from TOML or JSON text, with its robot from the registry.
///
/// # Errors
/// All faults of the text.
pub fn read(text: &str) -> Result<(World, Arc<RobotModel>), Vec<WorldFault>> {
    let file = WorldFile::from_text(text).map_err(|fault| vec![fault])?;
    let name = file.robot_name().unwrap_or_default();
    let robot = robots::named(name).map_err(|error| vec![WorldFault::new("robot.name", "a robot", error)])?;
    let world = file.resolve(&robot)?;
    let started = RobotModel { home: world.robot.home.clone(), ..(*robot).clone() };
    let robot = if started.home == robot.home { robot } else { Arc::new(started) };
    Ok((world, robot))
}

/// Same world with another robot at its home position; a wrist camera at the old robot's default pose moves to the new
/// robot's default pose.
///
/// # Errors
/// [`AssetError::UnknownRobot`] with near misses.
pub fn with_robot(world: &World, name: &str) -> Result<World, AssetError> {
    let robot = robots::named(name)?;
    let before = robots::named(&world.robot.name)?;
    let mut changed = world.clone();
    changed.robot = WorldRobot {
        name: robot.name.clone(),
        physics_hash: robot.physics_hash(),
        home: robot.home.clone(),
        start: None,
    };
    for camera in &mut changed.cameras {
        let sits_as_before = camera.mount == CameraMount::Hand
            && before.hand_from_wrist_camera.is_some_and(|pose| pose == camera.mount_from_camera);
        if let (true, Some(pose)) = (sits_as_before, robot.hand_from_wrist_camera) {
            camera.mount_from_camera = pose;
        }
    }
    Ok(changed)
}
