//! Grasp trials: samples grasps from a point cloud of objects on a table, and simulates the best one with the arm.
//!
//! The objects are instances outside the catalogue ([`genmanip_assets::variant`]), settled in simulation. The cloud is
//! sampled from their whole surface or rendered with noise; the grasp sampler gets nothing else. The arm starts at the
//! pregrasp pose, approaches, closes, lifts, shakes and holds; only friction carries the object. Ground truth is used
//! to build the scene, to segment the target, to start the arm out of collision, and to judge.

mod arm;
mod robustness;
mod setup;
mod table;
mod trial;
mod view;

use genmanip_core::Seed;
use genmanip_motion::{CloudError, CloudTarget};
use serde::Serialize;

use crate::expert::ObservedObject;
use trial::Candidate;

pub use arm::TrialEnding;
pub use robustness::{MAX_FAILED_GRASPS, RobustnessSettings, WANTED_GRASPS, robust_grasps, verified_grasps};
pub use setup::GraspTrials;
pub use table::Table;
pub use trial::{CandidateChoice, ExecutedGrasp, TrialClass, TrialError, TrialView};
pub use view::{Cloud, ViewSettings};

/// Inputs and result of one grasp trial.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// Class of objects that the trial was made with.
    pub class: TrialClass,
    /// Name of the family's card.
    pub object: String,
    /// Number of objects on the table, including the target.
    pub things: usize,
    /// Number of points of the target in the cloud.
    pub points: usize,
    /// Processor time of the sampler, measured by the caller's clock, s.
    pub sampler_cpu_s: f64,
    /// Number of grasp candidates.
    pub candidates: usize,
    /// Success, or the phase in which the trial failed.
    pub ending: TrialEnding,
    /// Executed grasp; `None` if none was executed.
    pub grasp: Option<ExecutedGrasp>,
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
        let start = clock();
        let grasps = self.candidates(&cloud)?;
        let sampler_cpu_s = clock() - start;
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

    /// Candidates of the detector, or else of the sampler, best first; none if too few points are visible.
    fn candidates(&self, cloud: &Cloud) -> Result<Vec<Candidate>, TrialError> {
        let Cloud { points, scene, cameras, world_from_camera } = cloud;
        if let Some(detector) = &self.detector {
            let seen = ObservedObject {
                points: points.clone(),
                scene: scene.clone(),
                world_from_camera: *world_from_camera,
                camera_positions: cameras.clone(),
                table_height: 0.0,
            };
            let found = detector.grasps(&seen).map_err(TrialError::Detector)?;
            let candidate = |grasp| Candidate { opening: self.planner.opening(&grasp), grasp, features: None };
            return Ok(found.into_iter().map(candidate).collect());
        }
        let target = CloudTarget { points, cameras, scene, table_height: 0.0 };
        match self.planner.cloud_grasps(&target) {
            Ok(grasps) => Ok(grasps.into_iter().map(Candidate::from).collect()),
            Err(
                CloudError::Empty
                | CloudError::TooFew { .. }
                | CloudError::NoExtent { .. }
                | CloudError::TooLarge { .. },
            ) => Ok(Vec::new()),
            Err(error) => Err(error.into()),
        }
    }
}
