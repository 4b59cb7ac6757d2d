//! Grasp sampling from exact object geometry; nothing is learned.
//!
//! Antipodal point pairs (after V.-D. Nguyen, *Constructing Force-Closure Grasps*, 1988) come from lines through the
//! convex pieces, so that widths are exact and walls, rims and handles are found as well as whole bodies; flat objects
//! are also sampled with lines along the table. Each pair is tried from several approach directions: gripper clearance
//! is checked exactly, the fingers are closed until contact, and the result is scored.

mod assess;
pub mod cloud;
mod gripper;
mod propose;
mod solid;
#[cfg(test)]
mod tests;

use genmanip_core::{Grasp, Piece, Pose, Seed};
use glam::DVec3;
use serde::{Deserialize, Serialize};

pub use gripper::Gripper;

use crate::collision::GeometryError;

/// Sampling and ranking settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GraspSettings {
    /// Number of surface points from which lines are cast through the object.
    pub surface_points: usize,
    /// Approach tilts about the closing direction (rad); each is tried to both sides.
    pub tilts: Vec<f64>,
    /// Maximum angle between approach and vertical (rad).
    pub max_tilt: f64,
    /// The same for objects at least `tall_height` high (rad).
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
    /// Maximum number of proposals checked exactly.
    pub max_assessed: usize,
    /// Maximum number of candidates.
    pub max_candidates: usize,
    /// Candidates closer than this (m) and `same_angle` (rad) to a better one are dropped.
    pub same_distance: f64,
    /// See `same_distance`.
    pub same_angle: f64,
    /// Distance from the centre of mass at which the lever term reaches 0 (m).
    pub longest_lever: f64,
    /// Weights of the score's terms.
    pub weights: GraspWeights,
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

impl Default for GraspWeights {
    fn default() -> Self {
        Self { antipodality: 0.25, contact_depth: 0.15, width_margin: 0.1, lever: 0.3, downward: 0.2 }
    }
}

/// The object to be grasped, at its pose.
#[derive(Clone, Copy, Debug)]
pub struct GraspTarget<'a> {
    /// Surface points with outward unit normals, object frame.
    pub surface: &'a [(DVec3, DVec3)],
    /// Convex collision pieces, object frame.
    pub pieces: &'a [Piece],
    /// Centre of mass, object frame.
    pub center_of_mass: DVec3,
    /// Object pose, world frame.
    pub world_from_object: Pose,
    /// Height of its support, world z (m).
    pub table_height: f64,
}

/// Grasp candidates, object frame, best first, distinct up to half a turn about the approach axis.
///
/// Empty if no grasp fits or the target has no surface points.
///
/// # Errors
/// Fails if a collision piece is not finite or has no volume.
pub fn candidates(
    target: &GraspTarget,
    gripper: &Gripper,
    settings: &GraspSettings,
    seed: Seed,
) -> Result<Vec<Grasp>, GeometryError> {
    let evaluator = assess::GraspEvaluator::new(target, gripper, settings)?;
    let mut proposals = propose::proposals(target, gripper, settings, seed.fork("grasp"))?;
    proposals.sort_by(|a, b| b.priority.total_cmp(&a.priority));
    let mut kept: Vec<Grasp> = Vec::new();
    let mut assessed = 0;
    for proposal in &proposals {
        if kept.len() >= settings.max_candidates || assessed >= settings.max_assessed {
            break;
        }
        let is_new = |pose: &Pose, kept: &[Grasp]| !kept.iter().any(|other| same(&other.pose, pose, settings));
        if !is_new(&proposal.object_from_tcp, &kept) || evaluator.palm_is_blocked(proposal) {
            continue;
        }
        assessed += 1;
        if let Some(grasp) = evaluator.assess(proposal).filter(|grasp| is_new(&grasp.pose, &kept)) {
            kept.push(grasp);
        }
    }
    kept.sort_by(|a, b| b.score.total_cmp(&a.score));
    Ok(kept)
}

/// Known grasps (object frame) that fit at the object's pose, in their order: allowed approach angle, and clearance to
/// object and table.
///
/// # Errors
/// Fails if a collision piece is not finite or has no size.
pub(crate) fn fitting<'a>(
    target: &GraspTarget,
    gripper: &Gripper,
    settings: &GraspSettings,
    known: impl Iterator<Item = &'a Grasp>,
) -> Result<Vec<Grasp>, GeometryError> {
    let evaluator = assess::GraspEvaluator::new(target, gripper, settings)?;
    Ok(known.filter(|grasp| evaluator.is_upright(grasp) && evaluator.is_clear(grasp)).cloned().collect())
}

impl GraspSettings {
    /// Maximum angle between approach and vertical for an object of this height (rad).
    fn largest_tilt(&self, height: f64) -> f64 {
        if height >= self.tall_height { self.max_tilt_tall } else { self.max_tilt }
    }
}

/// Alignment from the cosine of the larger contact angle: 1 if the pads are parallel to the surface, 0 at the friction
/// cone.
fn squareness(cosine: f64, friction: f64) -> f64 {
    1.0 - cosine.clamp(-1.0, 1.0).acos() / friction.atan()
}

/// True if two grasps are practically equal, up to half a turn of the gripper.
fn same(a: &Pose, b: &Pose, settings: &GraspSettings) -> bool {
    if a.position.distance(b.position) > settings.same_distance {
        return false;
    }
    let half_turn = Pose { position: DVec3::ZERO, rotation: glam::DQuat::from_rotation_z(std::f64::consts::PI) };
    a.angle_to(b).min((*a * half_turn).angle_to(b)) <= settings.same_angle
}
