//! Settings of grasp sampling.

use serde::{Deserialize, Serialize};

/// Settings for sampling and ranking grasps on exact geometry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GraspSettings {
    /// Number of surface points from which lines are cast through the object.
    pub surface_points: usize,
    /// Approach tilts about the closing direction (rad); each is tried to both sides.
    pub tilts: Vec<f64>,
    /// Maximum angle between approach and vertical (rad).
    pub max_tilt: f64,
    /// Maximum angle between approach and vertical for objects at least `tall_height` high (rad).
    pub max_tilt_tall: f64,
    /// Minimum height of objects that may be grasped from the side (m).
    pub tall_height: f64,
    /// Friction coefficient of the antipodality check.
    pub friction: f64,
    /// Difference between the maximum opening and the widest grasp (m).
    pub width_clearance: f64,
    /// Additional opening on either side during the approach (m).
    pub opening_clearance: f64,
    /// Clearance of hand and open fingers to the object (m).
    pub object_clearance: f64,
    /// Minimum height of the gripper above the table (m).
    pub table_clearance: f64,
    /// Objects lower than this are also sampled with lines along the table (m).
    pub flat_height: f64,
    /// Maximum number of proposals that are assessed with exact geometry.
    pub max_assessed: usize,
    /// Maximum number of candidates returned.
    pub max_candidates: usize,
    /// Candidates closer than this (m) and `same_angle` (rad) to a better one are dropped.
    pub same_distance: f64,
    /// Maximum angle (rad) between a candidate and a better one at which it is dropped, see `same_distance`.
    pub same_angle: f64,
    /// Distance from the centre of mass at which the lever term reaches 0 (m).
    pub longest_lever: f64,
    /// Weights of the score's terms.
    pub weights: GraspWeights,
}

impl Default for GraspSettings {
    fn default() -> Self {
        Self {
            surface_points: 240,
            tilts: vec![0.0, 0.3, 0.6, 0.95, 1.25, 1.45],
            max_tilt: 1.05,
            max_tilt_tall: 1.5,
            tall_height: 0.1,
            friction: 0.5,
            width_clearance: 0.004,
            opening_clearance: 0.01,
            object_clearance: 0.001,
            table_clearance: 0.003,
            flat_height: 0.03,
            max_assessed: 1500,
            max_candidates: 64,
            same_distance: 0.012,
            same_angle: 0.3,
            longest_lever: 0.1,
            weights: GraspWeights::default(),
        }
    }
}

/// Weights of the score terms; each term, and the score as their weighted mean, is in [0, 1].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GraspWeights {
    /// Alignment of pads and surface normals.
    pub antipodality: f64,
    /// Contact length along the pads.
    pub contact_depth: f64,
    /// Margin between width and maximum opening.
    pub width_margin: f64,
    /// Proximity of the closing line to the centre of mass.
    pub lever: f64,
    /// Vertical alignment of the approach.
    pub downward: f64,
}

impl Default for GraspWeights {
    fn default() -> Self {
        Self { antipodality: 0.25, contact_depth: 0.15, width_margin: 0.1, lever: 0.3, downward: 0.2 }
    }
}
