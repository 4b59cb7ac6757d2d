//! Grasp sampling from exact object geometry; nothing is learned.
//!
//! Antipodal point pairs (after V.-D. Nguyen, *Constructing Force-Closure Grasps*, 1988) come from lines through the
//! convex pieces, so that widths are exact and walls, rims and handles are found as well as whole bodies; flat objects
//! are also sampled with lines along the table. Each pair is tried from several approach directions: gripper clearance
//! is checked exactly, the fingers are closed until contact, and the result is scored.

pub(crate) mod align;
mod assess;
pub mod cloud;
mod gripper;
mod propose;
mod settings;
mod solid;
mod target;
#[cfg(test)]
mod tests;

use genmanip_core::{Grasp, Pose, Seed};
use glam::DVec3;

pub use gripper::Gripper;
pub use settings::{GraspSettings, GraspWeights};
pub use target::GraspTarget;

use crate::collision::GeometryError;

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

/// True if two grasps are practically equal, up to half a turn of the gripper.
fn same(a: &Pose, b: &Pose, settings: &GraspSettings) -> bool {
    if a.position.distance(b.position) > settings.same_distance {
        return false;
    }
    let half_turn = Pose { position: DVec3::ZERO, rotation: glam::DQuat::from_rotation_z(std::f64::consts::PI) };
    a.angle_to(b).min((*a * half_turn).angle_to(b)) <= settings.same_angle
}
