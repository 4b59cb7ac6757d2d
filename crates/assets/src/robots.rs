//! Registry of robots: models by name.
//!
//! Built-in robots are the files in `data/robots`; [`register`] adds a user's robots at run time.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_core::names::near_misses;
use genmanip_core::{RobotModel, World};

use crate::AssetError;
pub use crate::robot::{PartFinder, PartKind, compose};

/// Kind, name and text of the files under `data/robots`.
static FILES: &[(PartKind, &str, &str)] = include!(concat!(env!("OUT_DIR"), "/robot_files.rs"));

/// Robots built or registered so far, by name.
static KNOWN: Mutex<BTreeMap<String, Arc<RobotModel>>> = Mutex::new(BTreeMap::new());

/// Names of all robots, built-in and registered.
pub fn names() -> Vec<String> {
    let mut names: Vec<String> = built_in(PartKind::Robot).map(str::to_owned).collect();
    names.extend(KNOWN.lock().unwrap_or_else(PoisonError::into_inner).keys().cloned());
    names.sort();
    names.dedup();
    names
}

/// Robot by name; the same `Arc` on every call.
///
/// # Errors
/// [`AssetError::UnknownRobot`] with near misses.
pub fn named(name: &str) -> Result<Arc<RobotModel>, AssetError> {
    if let Some(robot) = KNOWN.lock().unwrap_or_else(PoisonError::into_inner).get(name) {
        return Ok(Arc::clone(robot));
    }
    match built_in_text(PartKind::Robot, name) {
        Some(text) => {
            let robot = compose(&format!("robot {name}"), text, &find)?;
            let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
            Ok(Arc::clone(known.entry(name.to_owned()).or_insert_with(|| Arc::new(robot))))
        }
        None => {
            let known = names();
            let names: Vec<&str> = known.iter().map(String::as_str).collect();
            let near = near_misses(&name.to_lowercase(), &names);
            Err(AssetError::UnknownRobot { got: name.to_owned(), near, known })
        }
    }
}

/// Franka Emika Panda with its parallel gripper; the same `Arc` on every call.
///
/// # Panics
/// Never in a tested build: the data files are compiled in.
pub fn panda() -> Arc<RobotModel> {
    named("panda").expect("built-in data files are tested")
}

/// Registers a robot under its name until the process ends; `file` names it in errors.
///
/// # Errors
/// [`AssetError::Data`] if another robot with different physics has this name.
pub fn register(file: &str, robot: RobotModel) -> Result<Arc<RobotModel>, AssetError> {
    match named(&robot.name) {
        Err(AssetError::UnknownRobot { .. }) => {
            let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
            Ok(Arc::clone(known.entry(robot.name.clone()).or_insert_with(|| Arc::new(robot))))
        }
        Err(error) => Err(error),
        Ok(other) if other.physics_hash() == robot.physics_hash() => Ok(other),
        Ok(other) => {
            let message = format!("name: expected a unique name, got {:?}, the name of another robot", other.name);
            Err(AssetError::Data { file: file.to_owned(), message })
        }
    }
}

/// Text of a built-in arm or gripper file.
///
/// # Errors
/// [`AssetError::Data`] for an unknown name, with the known names.
pub fn find(kind: PartKind, name: &str) -> Result<String, AssetError> {
    built_in_text(kind, name).map(str::to_owned).ok_or_else(|| {
        let known: Vec<&str> = built_in(kind).collect();
        let message = format!("no {} is called {name:?}; known: {}", kind.word(), known.join(", "));
        AssetError::Data { file: format!("{} {name}", kind.word()), message }
    })
}

fn built_in(kind: PartKind) -> impl Iterator<Item = &'static str> {
    FILES.iter().filter(move |file| file.0 == kind).map(|file| file.1)
}

fn built_in_text(kind: PartKind, name: &str) -> Option<&'static str> {
    FILES.iter().find(|file| file.0 == kind && file.1 == name).map(|file| file.2)
}

/// Robot of a world, at the world's home configuration; the world must state the physics of the current robot.
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
