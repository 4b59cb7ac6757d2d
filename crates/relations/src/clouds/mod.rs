//! Reproduces the relations of two released evaluators on point clouds, for comparable benchmark numbers.
//!
//! These profiles differ from the project's own relations (the other modules of this crate): directions are seen from
//! the opposite side of the table (front is the smaller x, left the smaller y), a pair can have several labels, and an
//! object floating ten centimetres above another one is `on` it.
//!
//! Where an original raises an error (a cloud without an outline), the step that failed is omitted here.
//!
//! ```
//! use genmanip_relations::clouds::{Cloud, CloudLabel, Profile, labels};
//! let row = |y: f64| Cloud::new((0..50).map(|i| [0.001 * f64::from(i), y, 0.0]).collect()).unwrap();
//! assert_eq!(labels(Profile::GenManip09, &row(0.0), &row(0.12), None), [CloudLabel::Left]);
//! ```

pub mod cases;
mod contour;
mod inside;
mod judge;
pub mod npz;
#[cfg(test)]
mod tests;
mod tree;

use std::sync::OnceLock;

use contour::Contour;
use glam::DVec3;
use inside::Enclosure;
pub(crate) use inside::spread_directions;
pub use judge::{CloudGoal, Subgoal, articulation, goal_score, labels, subgoal};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tree::Tree;

/// A released evaluator whose verdicts are reproduced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Profile {
    /// Evaluator of GenManip V0.9.
    #[serde(rename = "genmanip-0.9")]
    GenManip09,
    /// Evaluator of GenManip Suite 0.2.3.
    #[serde(rename = "suite-0.2.3")]
    Suite023,
}

/// A label of the released evaluators.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
pub enum CloudLabel {
    /// Touching, and more than half (GenManip 0.9) or at least half (Suite 0.2.3) of the target's points lie in the
    /// anchor's convex hull.
    #[serde(rename = "in")]
    In,
    /// As `In` with the roles exchanged, and not `In`.
    #[serde(rename = "out of")]
    OutOf,
    /// A share of the target's horizontal bounds (70 % for GenManip 0.9, 40 % for Suite 0.2.3) lies over the anchor's,
    /// the bounds' area is not above 1.5 or 1.8 times the anchor's, and the target's lowest point is within 0.10 m of
    /// the anchor's highest.
    #[serde(rename = "on")]
    On,
    /// `On` with the roles exchanged.
    #[serde(rename = "below")]
    Below,
    /// Within 0.10 m; or within 0.15 m in the plane with bounds overlapping along x and y.
    #[serde(rename = "near")]
    Near,
    /// Target's bounds at smaller y than the anchor's, overlapping along x.
    #[serde(rename = "left")]
    Left,
    /// Target's bounds at larger y than the anchor's, overlapping along x.
    #[serde(rename = "right")]
    Right,
    /// Target's bounds at smaller x than the anchor's, overlapping along y.
    #[serde(rename = "front")]
    Front,
    /// Target's bounds at larger x than the anchor's, overlapping along y.
    #[serde(rename = "back")]
    Back,
    /// The directions from the first anchor to the target and from it to the second anchor differ by less than 45°.
    #[serde(rename = "between")]
    Between,
}

/// Reason why a cloud is invalid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CloudError {
    /// The cloud has no points.
    #[error("expected at least one point, got none")]
    Empty,
    /// A coordinate is not finite.
    #[error("expected finite coordinates, got something else in point {index}")]
    NotFinite {
        /// Index of the point.
        index: usize,
    },
    /// A coordinate is too large to compute lengths with.
    #[error("expected coordinates within {MAX_COORDINATE_M:.0} m, got more in point {index}")]
    TooFar {
        /// Index of the point.
        index: usize,
    },
}

/// Largest coordinate of a cloud, metres.
const MAX_COORDINATE_M: f64 = 1e6;

/// A point cloud; search structures are built on first use and kept.
#[derive(Debug)]
pub struct Cloud {
    pub(crate) points: Vec<DVec3>,
    pub(crate) min: DVec3,
    pub(crate) max: DVec3,
    pub(crate) mean: DVec3,
    tree: OnceLock<Tree>,
    enclosure: OnceLock<Enclosure>,
    contour: OnceLock<Option<Contour>>,
}

impl Cloud {
    /// A cloud of points in metres.
    ///
    /// # Errors
    /// If there are no points, or a coordinate is not finite or larger than 1,000 km.
    pub fn new(points: Vec<[f64; 3]>) -> Result<Self, CloudError> {
        if points.is_empty() {
            return Err(CloudError::Empty);
        }
        if let Some(index) = points.iter().position(|point| !point.iter().all(|value| value.is_finite())) {
            return Err(CloudError::NotFinite { index });
        }
        if let Some(index) = points.iter().position(|point| point.iter().any(|value| value.abs() > MAX_COORDINATE_M)) {
            return Err(CloudError::TooFar { index });
        }
        Ok(Self::from_finite(points.into_iter().map(DVec3::from_array).collect()))
    }

    /// Points of the cloud, metres.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    pub(crate) fn from_finite(points: Vec<DVec3>) -> Self {
        let min = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let max = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let mean = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
        let (tree, enclosure, contour) = (OnceLock::new(), OnceLock::new(), OnceLock::new());
        Self { points, min, max, mean, tree, enclosure, contour }
    }

    pub(crate) fn tree(&self) -> &Tree {
        self.tree.get_or_init(|| Tree::new(&self.points))
    }

    pub(crate) fn enclosure(&self) -> &Enclosure {
        self.enclosure.get_or_init(|| Enclosure::new(self.tree()))
    }

    pub(crate) fn contour(&self) -> Option<&Contour> {
        self.contour.get_or_init(|| Contour::new(&self.points)).as_ref()
    }
}
