//! Export of a scenario as a GLB file for modelling programs.

use std::sync::Arc;

use genmanip_assets::AssetSource;
use genmanip_core::{ObjectModel, Scenario};
use genmanip_workspace::{WorkspaceError, worlds};

use super::glb::scenario_glb;
use super::usd::{Stage, scenario_usd};

/// Binary glTF of a scenario at its start; see [`scenario_glb`].
///
/// # Errors
/// When the robot or objects differ from those that the scenario was made with, or a texture is broken.
pub fn scenario_file(scenario: &Scenario, assets: &dyn AssetSource) -> Result<Vec<u8>, WorkspaceError> {
    let robot = worlds::robot(&scenario.world)?;
    let models = models(scenario, assets)?;
    scenario_glb(scenario, &models, &robot)
        .map_err(|error| WorkspaceError::broken(format!("cannot write the meshes of {}", scenario.id), error))
}

/// OpenUSD text of a scenario at its start, with its textures for a folder of this name; see [`scenario_usd`].
///
/// # Errors
/// As [`scenario_file`].
pub fn scenario_stage(scenario: &Scenario, assets: &dyn AssetSource, textures: &str) -> Result<Stage, WorkspaceError> {
    let robot = worlds::robot(&scenario.world)?;
    let models = models(scenario, assets)?;
    scenario_usd(scenario, &models, &robot, textures)
        .map_err(|error| WorkspaceError::broken(format!("cannot write the textures of {}", scenario.id), error))
}

/// Models of a scenario's objects, in their order.
///
/// # Errors
/// When an object is unknown or has changed since the scenario was made.
pub fn models(scenario: &Scenario, assets: &dyn AssetSource) -> Result<Vec<Arc<ObjectModel>>, WorkspaceError> {
    let model = |placed| {
        assets.instance(placed).map_err(|error| {
            WorkspaceError::input(format!("object {} of scenario {} cannot be used", placed.id, scenario.id))
                .because(error)
                .with_hint(
                    "a scenario belongs to the objects it was made with; imported ones are in packs: see --packs",
                )
        })
    };
    scenario.objects.iter().map(model).collect()
}
