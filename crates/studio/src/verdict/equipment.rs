//! Equipment of verdicts: assets, planner, grasps and settings.

use std::sync::Arc;

use genmanip_assets::{AssetSource, Catalogue, GraspLibrary};
use genmanip_core::World;
use genmanip_layout::LayoutSettings;
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_workspace::{WorkspaceError, worlds};

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
        })
    }
}

/// Reason why a stage gives no verdict: a shortage or a defect, never a problem of the scenario.
#[derive(Debug, thiserror::Error)]
#[error("stage {stage} of the verdict cannot run: {message}")]
pub struct VerdictError {
    /// Name of the stage.
    pub stage: &'static str,
    /// The cause.
    pub message: String,
}
