//! Classes and results of grasp trials.

use genmanip_core::{Grasp, PolicyError};
use genmanip_motion::grasp::cloud::Features;
use genmanip_motion::{CloudError, CloudGrasp, GeometryError};
use genmanip_sim::SimError;
use serde::{Deserialize, Serialize};

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

/// Viewpoints from which the point cloud is made.
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

/// Choice of the candidate that is executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CandidateChoice {
    /// The best feasible candidate.
    Best,
    /// A random feasible candidate, to evaluate the scores.
    Any,
}

/// A candidate of the sampler or of a detector, world frame.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    pub grasp: Grasp,
    /// Gripper opening for the approach, m.
    pub opening: f64,
    /// Features of the sampler's score. `None` for a detector's candidate.
    pub features: Option<Features>,
}

impl From<CloudGrasp> for Candidate {
    fn from(CloudGrasp { grasp, opening, features }: CloudGrasp) -> Self {
        Self { grasp, opening, features: Some(features) }
    }
}

/// A grasp that was executed.
#[derive(Clone, Debug, Serialize)]
pub struct ExecutedGrasp {
    /// Rank among the candidates, from 0.
    pub rank: usize,
    /// Predicted success probability, or the detector's score.
    pub score: f64,
    /// Distance between the contacts, m.
    pub width: f64,
    /// Features of the sampler's score. `None` for a detector's candidate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub features: Option<Features>,
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
    /// The depth image could not be rendered.
    #[error("rendering a depth image of the table failed: {0}")]
    Render(#[from] genmanip_render::RenderError),
    /// The object's geometry was rejected.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The grasp sampler rejected the point cloud.
    #[error(transparent)]
    Cloud(#[from] CloudError),
    /// The detector did not answer.
    #[error("the grasp detector: {0}")]
    Detector(PolicyError),
}
