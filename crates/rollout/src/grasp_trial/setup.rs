//! Data shared by all trials.

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::{RobotModel, World};
use genmanip_motion::Planner;

use super::view::ViewSettings;

/// Data shared by all trials.
#[derive(Clone)]
pub struct GraspTrials {
    /// The objects' families.
    pub catalogue: &'static Catalogue,
    /// Kinematics and the sampler.
    pub planner: Arc<Planner>,
    /// The robot.
    pub robot: Arc<RobotModel>,
    /// Surfaces, physics and cameras.
    pub world: Arc<World>,
    /// Noise and resolution of the cameras.
    pub view: ViewSettings,
}
