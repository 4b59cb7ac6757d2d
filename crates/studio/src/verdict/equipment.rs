//! Equipment for verdicts: assets, planner, grasps and settings.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_assets::{AssetError, AssetSource, Catalogue, GraspLibrary};
use genmanip_core::{Scenario, World};
use genmanip_layout::{LayoutSettings, posed};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_relations::{PosedScene, ShapeCache};
use genmanip_workspace::{WorkspaceError, worlds};

use super::problem::Stage;

/// Assets, planner, verified grasps and settings for verdicts, shared by all scenarios with the same robot.
#[derive(Clone)]
pub struct Equipment {
    /// Source of object models.
    pub assets: &'static dyn AssetSource,
    /// Planner of the robot.
    pub planner: Arc<Planner>,
    /// Library of grasps that were verified in simulation.
    pub grasps: &'static GraspLibrary,
    /// Settings of the layout's checks.
    pub settings: LayoutSettings,
    shapes: Arc<Mutex<ShapeCache>>,
}

impl Equipment {
    /// Equipment for the robot of a world, with the program's assets and default settings.
    ///
    /// # Errors
    /// When the robot is unknown, or differs from the one that the world was made with.
    pub fn of_world(world: &World) -> Result<Self, WorkspaceError> {
        Ok(Self {
            assets: Catalogue::all(),
            planner: worlds::planner(world, &PlannerSettings::default())?,
            grasps: GraspLibrary::builtin(),
            settings: LayoutSettings::default(),
            shapes: Arc::default(),
        })
    }

    /// Posed scene of a scenario; collision shapes of objects are cached between calls.
    ///
    /// # Errors
    /// When an asset is missing, or differs from the one that the scenario was made with.
    pub fn scene(&self, scenario: &Scenario) -> Result<PosedScene, AssetError> {
        posed(scenario, self.assets, &mut self.shapes.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Equipment of the worlds that scenarios need, made once for each robot among the same support surfaces.
#[derive(Default)]
pub struct EquipmentCache {
    /// By the JSON of the world's robot and support surfaces.
    known: Mutex<BTreeMap<String, Arc<Equipment>>>,
}

impl EquipmentCache {
    /// Equipment for scenarios in this world.
    ///
    /// # Errors
    /// As [`Equipment::of_world`].
    pub fn get(&self, world: &World) -> Result<Arc<Equipment>, WorkspaceError> {
        let key = serde_json::to_string(&(&world.robot, &world.surfaces)).unwrap_or_default();
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(equipment) = known.get(&key) {
            return Ok(Arc::clone(equipment));
        }
        let equipment = Arc::new(Equipment::of_world(world)?);
        known.insert(key, Arc::clone(&equipment));
        Ok(equipment)
    }
}

/// Reason why a stage has no verdict: an error of the program or of its resources, never a problem of the scenario.
#[derive(Debug, thiserror::Error)]
#[error("stage `{}` of the verdict cannot run: {message}", stage.name())]
pub struct VerdictError {
    /// Stage that failed.
    pub stage: Stage,
    /// Description of the cause.
    pub message: String,
}

impl VerdictError {
    /// An error of this stage.
    pub(super) fn new(stage: Stage, error: impl std::fmt::Display) -> Self {
        Self { stage, message: error.to_string() }
    }
}
