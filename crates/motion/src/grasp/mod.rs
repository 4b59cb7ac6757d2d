//! Grasp candidates from an object's exact geometry; nothing is learned.
//!
//! Pairs of opposite surface points (antipodal, after V.-D. Nguyen, *Constructing Force-Closure Grasps*, 1988) come
//! from lines through the convex pieces, so that widths are exact and walls, rims and handles are found as well as
//! whole bodies; flat things get lines along the table.
//! Each pair is tried from several directions; hand and fingers are tested exactly against object and table,
//! the fingers are closed until they touch, and what is left is scored.

mod assess;
pub mod cloud;
mod gripper;
mod propose;
mod reach;
mod solid;
#[cfg(test)]
mod tests;

use genmanip_core::{Grasp, Piece, Pose, Seed};
use glam::DVec3;
use serde::{Deserialize, Serialize};

pub use gripper::Gripper;
pub use reach::ReachableGrasp;

use crate::collision::GeometryError;

/// How candidates are found and ranked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GraspSettings {
    /// Surface points from which lines are shot through the object.
    pub surface_points: usize,
    /// Tilts of the approach about the closing direction, rad; each is tried to both sides.
    pub tilts: Vec<f64>,
    /// Largest angle between approach and straight down, rad.
    pub max_tilt: f64,
    /// The same for objects at least `tall_height` high, rad.
    pub max_tilt_tall: f64,
    /// Height from which an object may be held from the side, m.
    pub tall_height: f64,
    /// Friction coefficient for the antipodality test.
    pub friction: f64,
    /// Difference between the gripper's largest opening and the widest grasp, m.
    pub width_clearance: f64,
    /// Extra opening on either side while approaching, m.
    pub opening_clearance: f64,
    /// Distance of hand and open fingers from the object, m.
    pub object_clearance: f64,
    /// Height of the lowest point of the gripper above the table, m.
    pub table_clearance: f64,
    /// Objects lower than this are also searched with lines along the table, m.
    pub flat_height: f64,
    /// Proposals that are tested exactly before giving up.
    pub max_assessed: usize,
    /// Candidates returned.
    pub max_candidates: usize,
    /// Candidates nearer than this (m) and `same_angle` (rad) to a better one are dropped.
    pub same_distance: f64,
    /// See `same_distance`.
    pub same_angle: f64,
    /// Distance from the centre of mass at which the lever term reaches 0, m.
    pub longest_lever: f64,
    /// Weights of the score's terms.
    pub weights: GraspWeights,
}

/// Weights of the terms of a grasp's score; each term is 0-1, and so is the score: their weighted mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GraspWeights {
    /// How squarely the pads meet the surface.
    pub antipodality: f64,
    /// How much of the pads' length touches.
    pub contact_depth: f64,
    /// How far the width is below the largest opening.
    pub width_margin: f64,
    /// How near the closing line passes the centre of mass.
    pub lever: f64,
    /// How nearly straight down the approach is.
    pub downward: f64,
}

/// How candidates are tried in the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReachSettings {
    /// Length of the straight approach, m.
    pub approach: f64,
    /// Distance of the robot from obstacles at grasp and pre-grasp, m.
    pub padding: f64,
    /// Arm configurations tried per grasp.
    pub configurations: usize,
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

impl Default for ReachSettings {
    fn default() -> Self {
        Self { approach: 0.08, padding: 0.001, configurations: 6 }
    }
}

/// The object to be grasped, where it is.
#[derive(Clone, Copy, Debug)]
pub struct GraspTarget<'a> {
    /// Points on the surface with outward unit normals, object frame.
    pub surface: &'a [(DVec3, DVec3)],
    /// Exact convex pieces, object frame.
    pub pieces: &'a [Piece],
    /// Centre of mass, object frame.
    pub center_of_mass: DVec3,
    /// Where the object is.
    pub world_from_object: Pose,
    /// Height (world z) of the surface on which it rests.
    pub table_height: f64,
}

/// Candidates in the object's frame, best first, none equal to another up to half a turn about the approach axis.
///
/// Empty when no grasp fits, or when the target has no surface points.
///
/// # Errors
/// A piece that is not finite or has no volume.
pub fn candidates(
    target: &GraspTarget,
    gripper: &Gripper,
    settings: &GraspSettings,
    seed: Seed,
) -> Result<Vec<Grasp>, GeometryError> {
    let bench = assess::Bench::new(target, gripper, settings)?;
    let mut proposals = propose::proposals(target, gripper, settings, seed.fork("grasp"))?;
    proposals.sort_by(|a, b| b.promise.total_cmp(&a.promise));
    let mut kept: Vec<Grasp> = Vec::new();
    let mut assessed = 0;
    for proposal in &proposals {
        if kept.len() >= settings.max_candidates || assessed >= settings.max_assessed {
            break;
        }
        let fresh = |pose: &Pose, kept: &[Grasp]| !kept.iter().any(|other| same(&other.pose, pose, settings));
        if !fresh(&proposal.object_from_tcp, &kept) || bench.palm_is_blocked(proposal) {
            continue;
        }
        assessed += 1;
        if let Some(grasp) = bench.assess(proposal).filter(|grasp| fresh(&grasp.pose, &kept)) {
            kept.push(grasp);
        }
    }
    kept.sort_by(|a, b| b.score.total_cmp(&a.score));
    Ok(kept)
}

/// Those of known grasps (object frame) that fit where the object is, in their order: the hand comes steeply enough and
/// has room beside object and table.
///
/// # Errors
/// A piece that is not finite or has no size.
pub(crate) fn fitting<'a>(
    target: &GraspTarget,
    gripper: &Gripper,
    settings: &GraspSettings,
    known: impl Iterator<Item = &'a Grasp>,
) -> Result<Vec<Grasp>, GeometryError> {
    let bench = assess::Bench::new(target, gripper, settings)?;
    Ok(known.filter(|grasp| bench.is_upright(grasp) && bench.is_clear(grasp)).cloned().collect())
}

impl GraspSettings {
    /// Largest angle between approach and straight down for an object of some height, rad.
    fn largest_tilt(&self, height: f64) -> f64 {
        if height >= self.tall_height { self.max_tilt_tall } else { self.max_tilt }
    }
}

/// 1 when the pads meet the surface squarely, 0 at the edge of the friction cone; from the cosine of the larger angle.
fn squareness(cosine: f64, friction: f64) -> f64 {
    1.0 - cosine.clamp(-1.0, 1.0).acos() / friction.atan()
}

/// Whether two grasps are the same for all practical purposes, half a turn of the hand included.
fn same(a: &Pose, b: &Pose, settings: &GraspSettings) -> bool {
    if a.position.distance(b.position) > settings.same_distance {
        return false;
    }
    let half_turn = Pose { position: DVec3::ZERO, rotation: glam::DQuat::from_rotation_z(std::f64::consts::PI) };
    a.angle_to(b).min((*a * half_turn).angle_to(b)) <= settings.same_angle
}
