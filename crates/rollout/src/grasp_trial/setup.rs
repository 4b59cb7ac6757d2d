//! Data shared by all trials.

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::{RobotModel, World};
use genmanip_motion::Planner;

use super::view::ViewSettings;
use crate::expert::GraspProposer;

/// Data shared by all trials.
#[derive(Clone)]
pub struct GraspTrials {
    /// The objects' families.
    pub catalogue: &'static Catalogue,
    /// Kinematics and the sampler.
    pub planner: Arc<Planner>,
    /// A detector to be tried instead of the sampler.
    pub detector: Option<Arc<dyn GraspProposer>>,
    /// The robot.
    pub robot: Arc<RobotModel>,
    /// Surfaces, physics and cameras.
    pub world: Arc<World>,
    /// Noise and resolution of the cameras.
    pub view: ViewSettings,
}
