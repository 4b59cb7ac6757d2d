//! Equipment of verdicts: assets, planner, grasps and settings.

use std::sync::{Arc, Mutex, PoisonError};

use genmanip_assets::{AssetError, AssetSource, Catalogue, GraspLibrary};
use genmanip_core::{Scenario, World};
use genmanip_layout::{LayoutSettings, posed};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_relations::{PosedScene, ShapeCache};
use genmanip_workspace::{WorkspaceError, worlds};

use super::problem::Stage;

/// Assets, planner, known grasps and settings of verdicts; shared by all scenarios of one robot.
#[derive(Clone)]
pub struct Equipment {
    /// Source of the models.
    pub assets: &'static dyn AssetSource,
    /// Planner of the robot.
    pub planner: Arc<Planner>,
    /// Grasps tried beforehand.
    pub grasps: &'static GraspLibrary,
    /// Settings of layouts.
    pub settings: LayoutSettings,
    shapes: Arc<Mutex<ShapeCache>>,
}

impl Equipment {
    /// The equipment of the program for a world's robot, with default settings.
    ///
    /// # Errors
    /// When the robot is unknown or was changed.
    pub fn of_world(world: &World) -> Result<Self, WorkspaceError> {
        Ok(Self {
            assets: Catalogue::all(),
            planner: worlds::planner(world, &PlannerSettings::default())?,
            grasps: GraspLibrary::builtin(),
            settings: LayoutSettings::default(),
            shapes: Arc::default(),
        })
    }

    /// The scene of a scenario; shapes of objects are kept from one call to the next.
    ///
    /// # Errors
    /// When an asset is missing or was changed.
    pub fn scene(&self, scenario: &Scenario) -> Result<PosedScene, AssetError> {
        posed(scenario, self.assets, &mut self.shapes.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Reason why a stage gives no verdict: a shortage or a defect, never a problem of the scenario.
#[derive(Debug, thiserror::Error)]
#[error("stage `{}` of the verdict cannot run: {message}", stage.name())]
pub struct VerdictError {
    /// The stage.
    pub stage: Stage,
    /// The cause.
    pub message: String,
}

impl VerdictError {
    /// A stage's error.
    pub(super) fn new(stage: Stage, error: impl std::fmt::Display) -> Self {
        Self { stage, message: error.to_string() }
    }
}
