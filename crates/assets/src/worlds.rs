//! Worlds from text, their robots found in the registry.

use std::sync::{Arc, OnceLock};

use genmanip_core::{RobotModel, World, WorldFault, WorldFile};

use crate::robots;

/// The world that is used when nobody names one, as a commented TOML file to start from.
pub const DEFAULT_TEXT: &str = include_str!("../data/world.toml");

/// The world of [`DEFAULT_TEXT`]; the same `Arc` every time.
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

/// A world and its robot from TOML or JSON text.
///
/// # Errors
/// All faults that can be found at once.
pub fn read(text: &str) -> Result<(World, Arc<RobotModel>), Vec<WorldFault>> {
    let file = WorldFile::from_text(text).map_err(|fault| vec![fault])?;
    let name = file.robot_name().unwrap_or_default();
    let robot = robots::named(name).map_err(|error| vec![WorldFault::new("robot.name", "a robot", error)])?;
    let world = file.resolve(&robot)?;
    let started = RobotModel { home: world.robot.home.clone(), ..(*robot).clone() };
    let robot = if started.home == robot.home { robot } else { Arc::new(started) };
    Ok((world, robot))
}
