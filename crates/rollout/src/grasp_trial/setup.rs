//! Data shared by all grasp trials.

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::{RobotModel, World};
use genmanip_motion::Planner;

use super::view::ViewSettings;
use crate::expert::GraspProposer;

/// Immutable data shared by all grasp trials.
#[derive(Clone)]
pub struct GraspTrials {
    /// Catalogue whose families the objects are instances of.
    pub catalogue: &'static Catalogue,
    /// Planner: kinematics of the robot and the grasp sampler.
    pub planner: Arc<Planner>,
    /// Grasp detector used instead of the sampler; `None` for the sampler.
    pub detector: Option<Arc<dyn GraspProposer>>,
    /// Robot that executes the grasps.
    pub robot: Arc<RobotModel>,
    /// World that defines surfaces, physics and cameras.
    pub world: Arc<World>,
    /// Noise and resolution of the depth cameras.
    pub view: ViewSettings,
}
