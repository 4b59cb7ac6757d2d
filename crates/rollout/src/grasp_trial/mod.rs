//! Grasps tried out: things on a table, a cloud of them, the best grasp, and the real arm's physics to say whether it
//! holds.
//!
//! The things are instances that no catalogue holds ([`genmanip_assets::variant`]), settled in physics.
//! The cloud is sampled from their whole surface or rendered with noise; the sampler knows nothing else.
//! The arm starts behind the grasp, goes in, closes, lifts, shakes and holds; nothing but friction carries the thing.
//! Truth is used to build the scene, to colour the pixels of the target (its mask), to start the arm out of collision,
//! and to judge.

mod arm;
mod table;
mod tried;
mod view;

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::{RobotModel, Seed, World};
use genmanip_motion::grasp::cloud::Features;
use genmanip_motion::{CloudError, CloudTarget, GeometryError, Planner};
use genmanip_sim::SimError;
use serde::{Deserialize, Serialize};

pub use arm::Ending;
pub use table::Table;
pub use tried::{LOST, TryingSettings, WANTED, sound_grasps, tried_grasps};
pub use view::{Cloud, ViewSettings};

/// What is grasped, and among what.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// A thing with a body or a rim for the hand, alone.
    Compact,
    /// A thing with a handle or shaft, lying flat, alone.
    Utensils,
    /// A compact thing among seven others.
    Clutter,
}

/// What is seen of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum View {
    /// The whole surface, without noise.
    Full,
    /// One of the three prompt cameras, drawn by chance, with noise.
    One,
    /// The three prompt cameras, fused, with noise.
    Three,
}

/// Which of the candidates is carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pick {
    /// The best one that the arm can carry out.
    Best,
    /// One drawn by chance, for judging the scores.
    Any,
}

/// Everything that trials share.
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
    /// Cameras' noise and resolution.
    pub view: ViewSettings,
}

/// What came of one trial.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// Which class.
    pub class: Class,
    /// Name of the family's card.
    pub object: String,
    /// Things on the table, the target included.
    pub things: usize,
    /// Points of the target's cloud.
    pub points: usize,
    /// Processor time of the sampler as the caller's clock counts, s.
    pub sampler_cpu_s: f64,
    /// Number of candidates.
    pub candidates: usize,
    /// How it ended.
    pub ending: Ending,
    /// The grasp that was carried out, if one was.
    pub grasp: Option<Tried>,
}

/// A grasp that was carried out.
#[derive(Clone, Debug, Serialize)]
pub struct Tried {
    /// Its place in the ranking, from 0.
    pub rank: usize,
    /// Chance that it holds, as the sampler says.
    pub score: f64,
    /// Distance of the contacts, m.
    pub width: f64,
    /// What the score is made of.
    pub features: Features,
    /// Opening between the pads at the end, m.
    pub final_width: f64,
}

/// Why a trial could not be made.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// Physics refused or diverged.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// An object could not be built.
    #[error(transparent)]
    Asset(#[from] genmanip_assets::AssetError),
    /// A picture could not be made.
    #[error("a depth picture of the table failed: {0}")]
    Render(#[from] genmanip_render::RenderError),
    /// The object's geometry was refused.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The cloud was refused.
    #[error(transparent)]
    Cloud(#[from] CloudError),
}

impl GraspTrials {
    /// One trial; the same seed gives the same trial. `clock` counts processor time in seconds.
    ///
    /// # Errors
    /// A scene, picture or simulation that cannot be made; a cloud that is refused counts as a trial without grasp.
    pub fn run(
        &self,
        class: Class,
        view: View,
        pick: Pick,
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
            // So little is seen of it that nothing can be said.
            Err(CloudError::Empty | CloudError::TooFew { .. } | CloudError::NoExtent { .. }) => Vec::new(),
            Err(error) => return Err(error.into()),
        };
        let (ending, grasp) = arm::carry_out(self, &table, &cloud.scene, &grasps, pick, seed.fork("pick"))?;
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
