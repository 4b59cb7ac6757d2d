//! Registry of built-in robots.

use std::sync::Arc;

use genmanip_core::{RobotModel, World};

use crate::{AssetError, panda, panda_2f85};

/// Names of the built-in robots.
pub const NAMES: [&str; 2] = ["panda", "panda_2f85"];

/// A robot by name; the same `Arc` on every call.
///
/// # Errors
/// [`AssetError::UnknownRobot`] with near misses.
pub fn named(name: &str) -> Result<Arc<RobotModel>, AssetError> {
    match name {
        "panda" => Ok(panda()),
        "panda_2f85" => Ok(panda_2f85()),
        _ => {
            let wanted = name.to_lowercase();
            let is_near = |known: &&&str| {
                let same = known.chars().zip(wanted.chars()).filter(|(a, b)| a == b).count();
                wanted.contains(**known) || known.contains(&wanted) || 2 * same > known.len()
            };
            Err(AssetError::UnknownRobot {
                got: name.to_owned(),
                near: NAMES.iter().filter(is_near).map(|known| (*known).to_owned()).collect(),
                known: NAMES.map(str::to_owned).to_vec(),
            })
        }
    }
}

/// The robot of a world with the world's home position, after checking that it is the one the world was made for.
///
/// # Errors
/// [`AssetError::UnknownRobot`], or [`AssetError::RobotMismatch`] with the field that differs.
pub fn of_world(world: &World) -> Result<Arc<RobotModel>, AssetError> {
    let robot = named(&world.robot.name)?;
    let mismatch = |field, expected: &dyn ToString, got: &dyn ToString| {
        Err(AssetError::RobotMismatch { field, expected: expected.to_string(), got: got.to_string() })
    };
    let hash = robot.physics_hash();
    if world.robot.physics_hash != hash {
        return mismatch("robot.physics_hash", &world.robot.physics_hash, &hash);
    }
    if world.robot.home.len() != robot.arm_dof() {
        return mismatch("robot.home (length)", &world.robot.home.len(), &robot.arm_dof());
    }
    if world.robot.start().len() != robot.arm_dof() {
        return mismatch("robot.start (length)", &world.robot.start().len(), &robot.arm_dof());
    }
    if world.robot.home == robot.home {
        return Ok(robot);
    }
    Ok(Arc::new(RobotModel { home: world.robot.home.clone(), ..(*robot).clone() }))
}
