//! Scenarios from files: read, validated against robot and engine settings, and opened as a stage.

use std::path::Path;
use std::sync::Arc;

use genmanip_assets::{Catalogue, robots};
use genmanip_core::{Scenario, limits};
use genmanip_rollout::Stage;
use genmanip_sim::EngineSettings;

use crate::documents::read_document;
use crate::error::{Cause, WorkspaceError};

/// Reads a scenario; checks its robot and its engine settings.
///
/// # Errors
/// As [`read_document`], and when the robot differs from the one that the scenario was made with.
pub fn read_scenario(path: &Path) -> Result<Scenario, WorkspaceError> {
    let scenario: Scenario = read_document(path, limits::SCENARIO)?;
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

fn unsuited(path: &Path, error: impl Into<Cause>) -> WorkspaceError {
    WorkspaceError::input(format!("{} cannot be set up", path.display()))
        .because(error)
        .with_hint("a scenario belongs to the objects and robot it was made with; lay its task out again")
}
