//! Scenarios from files: read, validated against robot and engine settings, and opened as a stage.

use std::path::Path;
use std::sync::Arc;

use genmanip_assets::{Catalogue, robots};
use genmanip_core::{Goal, Scenario, SceneGraph, Seed, Task, TaskKind, World, limits};
use genmanip_rollout::Stage;
use genmanip_sim::EngineSettings;

use crate::documents::{document, read_bytes};
use crate::error::{Cause, WorkspaceError};
use crate::worlds;

/// Reads a scenario; checks its robot and its engine settings.
///
/// # Errors
/// As [`crate::documents::read_document`], and when the robot differs from the one that the scenario was made with.
pub fn read_scenario(path: &Path) -> Result<Scenario, WorkspaceError> {
    parse_scenario(path, &read_bytes(path, limits::SCENARIO)?)
}

/// The scenario in the bytes of a file; checked as by [`read_scenario`].
///
/// # Errors
/// As [`read_scenario`].
pub fn parse_scenario(path: &Path, bytes: &[u8]) -> Result<Scenario, WorkspaceError> {
    let scenario: Scenario = document(path, bytes)?;
    robots::of_world(&scenario.world).map_err(|error| unsuited(path, error))?;
    EngineSettings::read(&scenario.world.physics.engine).map_err(|error| unsuited(path, error))?;
    Ok(scenario)
}

/// Reads a scenario and builds its stage: object models and the compiled physics model.
///
/// # Errors
/// As [`read_scenario`], and when the objects differ from those that the scenario was made with.
pub fn read_stage(path: &Path) -> Result<Stage, WorkspaceError> {
    let scenario = read_scenario(path)?;
    let robot = robots::of_world(&scenario.world).map_err(|error| unsuited(path, error))?;
    Stage::open(Arc::new(scenario), Catalogue::builtin(), &robot).map_err(|error| unsuited(path, error))
}

/// Stage of a world without objects, for motions of the arm alone.
///
/// # Errors
/// When the robot is unknown, or physics cannot simulate it.
pub fn empty_stage(world: World) -> Result<Stage, WorkspaceError> {
    let robot = worlds::robot(&world)?;
    let task = Task {
        id: EMPTY.into(),
        kind: TaskKind::PickAndPlace,
        instruction: String::new(),
        goal: Goal::default(),
        scene_graph: SceneGraph::default(),
        objects: Vec::new(),
        surfaces: Vec::new(),
        interchangeable: Vec::new(),
        source: EMPTY.into(),
    };
    let scenario = Scenario {
        id: EMPTY.into(),
        task,
        seed: Seed::new(0),
        objects: Vec::new(),
        world,
        other_request: None,
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
    };
    Stage::open(Arc::new(scenario), Catalogue::builtin(), &robot)
        .map_err(|error| WorkspaceError::input(format!("robot `{}` cannot be set up", robot.name)).because(error))
}

/// Id of the scenario without objects in [`empty_stage`].
const EMPTY: &str = "empty";

fn unsuited(path: &Path, error: impl Into<Cause>) -> WorkspaceError {
    WorkspaceError::input(format!("{} cannot be set up", path.display()))
        .because(error)
        .with_hint("a scenario belongs to the objects and robot it was made with; lay its task out again")
}
