//! Grasp trials: objects on a table, a point cloud of them, the best grasp, and its physics simulation with the arm.
//!
//! The objects are instances outside the catalogue ([`genmanip_assets::variant`]), settled in simulation. The cloud is
//! sampled from their whole surface or rendered with noise; it is the sampler's only input. The arm starts at the
//! pregrasp pose, approaches, closes, lifts, shakes and holds; only friction carries the object. Ground truth is used
//! to build the scene, to segment the target, to start the arm out of collision, and to judge.

mod arm;
mod robustness;
mod table;
mod view;

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::{RobotModel, Seed, World};
use genmanip_motion::grasp::cloud::Features;
use genmanip_motion::{CloudError, CloudTarget, GeometryError, Planner};
use genmanip_sim::SimError;
use serde::{Deserialize, Serialize};

pub use arm::TrialEnding;
pub use robustness::{MAX_FAILED_GRASPS, RobustnessSettings, WANTED_GRASPS, robust_grasps, verified_grasps};
pub use table::Table;
pub use view::{Cloud, ViewSettings};

/// Kind of target and surroundings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrialClass {
    /// An object with a body or a rim to grasp, alone.
    Compact,
    /// An object with a handle or shaft, lying flat, alone.
    Utensils,
    /// A compact object among seven others.
    Clutter,
}

/// Observation of the objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrialView {
    /// The whole surface, without noise.
    Full,
    /// One of the three prompt cameras, chosen at random, with noise.
    One,
    /// The three prompt cameras, fused, with noise.
    Three,
}

/// Choice of the candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CandidateChoice {
    /// The best feasible candidate.
    Best,
    /// A random feasible candidate, to evaluate the scores.
    Any,
}

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

/// Result of one trial.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// Class of the trial.
    pub class: TrialClass,
    /// Name of the family's card.
    pub object: String,
    /// Number of objects on the table, including the target.
    pub things: usize,
    /// Number of points of the target.
    pub points: usize,
    /// Processor time of the sampler, measured by the caller's clock, s.
    pub sampler_cpu_s: f64,
    /// Number of candidates.
    pub candidates: usize,
    /// Ending of the trial.
    pub ending: TrialEnding,
    /// The executed grasp, if any.
    pub grasp: Option<ExecutedGrasp>,
}

/// A grasp that was executed.
#[derive(Clone, Debug, Serialize)]
pub struct ExecutedGrasp {
    /// Rank among the candidates, from 0.
    pub rank: usize,
    /// Predicted success probability.
    pub score: f64,
    /// Distance between the contacts, m.
    pub width: f64,
    /// Features of the score.
    pub features: Features,
    /// Gripper opening at the end, m.
    pub final_width: f64,
}

/// Reason why a trial could not be run.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// The physics engine rejected the scene or diverged.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// An object could not be built.
    #[error(transparent)]
    Asset(#[from] genmanip_assets::AssetError),
    /// Rendering failed.
    #[error("rendering a depth image of the table failed: {0}")]
    Render(#[from] genmanip_render::RenderError),
    /// The object's geometry was rejected.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The cloud was rejected.
    #[error(transparent)]
    Cloud(#[from] CloudError),
}

impl GraspTrials {
    /// Runs one trial; deterministic for a seed. `clock` measures processor time in seconds.
    ///
    /// # Errors
    /// If the scene, images or simulation fail; a rejected cloud counts as a trial without grasp.
    pub fn run(
        &self,
        class: TrialClass,
        view: TrialView,
        pick: CandidateChoice,
        seed: Seed,
        clock: &mut dyn FnMut() -> f64,
    ) -> Result<Trial, TrialError> {
        let table = Table::settled(self.catalogue, class, &self.world, seed.fork("table"))?;
        let cloud = view::observe(&table, &self.world, view, &self.view, seed.fork("view"))?;
        let target =
            CloudTarget { points: &cloud.points, cameras: &cloud.cameras, scene: &cloud.scene, table_height: 0.0 };
        let start = clock();
        let grasps = self.planner.cloud_grasps(&target);
        let sampler_cpu_s = clock() - start;
        let grasps = match grasps {
            Ok(grasps) => grasps,
            // Too few points are visible to find grasps.
            Err(CloudError::Empty | CloudError::TooFew { .. } | CloudError::NoExtent { .. }) => Vec::new(),
            Err(error) => return Err(error.into()),
        };
        let (ending, grasp) = arm::execute(self, &table, &cloud.scene, &grasps, pick, seed.fork("pick"))?;
        Ok(Trial {
            class,
            object: table.models[0].card.name.clone(),
            things: table.models.len(),
            points: cloud.points.len(),
            sampler_cpu_s,
            candidates: grasps.len(),
            ending,
            grasp,
        })
    }
}
