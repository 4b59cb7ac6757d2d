//! Straight TCP motions: approach, lift, lower and retreat.

use genmanip_core::Pose;
use serde::{Deserialize, Serialize};

use super::{PlanError, PlanSettings, within_limits};
use crate::collision::{Checker, CollisionReport};
use crate::ik::InverseKinematics;
use crate::path::{Path, lerp};

/// Settings of straight TCP motions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StraightSettings {
    /// Maximum TCP distance between consecutive waypoints (m).
    pub step: f64,
    /// Maximum TCP rotation between consecutive waypoints (rad).
    pub turn: f64,
    /// Maximum change of a joint between consecutive waypoints (rad); a larger one indicates a singularity or a joint
    /// limit and fails the plan.
    pub max_joint_step: f64,
    /// Maximum angle (rad) by which an arm with fewer than six joints may turn the tool away from the orientation of
    /// the line. Such an arm points down at small heights only; it meets the position and turns where its limits
    /// require it.
    pub max_turn: f64,
}

impl Default for StraightSettings {
    fn default() -> Self {
        Self { step: 0.01, turn: 0.1, max_joint_step: 0.15, max_turn: 0.8 }
    }
}

/// Plans a straight TCP motion from `start` to `world_from_goal`.
///
/// Pairs of bodies closer than the padding at the start need not reach it, but must not come noticeably closer (see
/// [`Checker::relax`]); all other pairs keep the padding.
///
/// # Errors
/// If `start` is outside the joint limits or in collision, or the line is unreachable or blocked.
pub(crate) fn straight_line(
    checker: &mut Checker,
    ik: &InverseKinematics,
    settings: &StraightSettings,
    plan: &PlanSettings,
    start: &[f64],
    world_from_goal: &Pose,
) -> Result<Path, PlanError> {
    within_limits(checker, "start", start)?;
    if !(world_from_goal.position.is_finite() && world_from_goal.rotation.is_finite()) {
        return Err(PlanError::Unreachable { what: "the goal pose is not finite".into() });
    }
    let waypoints = follow(checker, ik, settings, start, world_from_goal)?;
    checker.relax(start, plan.contact_tolerance).map_err(PlanError::StartInCollision)?;
    let edges = waypoints.len().saturating_sub(1);
    for (index, edge) in waypoints.windows(2).enumerate() {
        if let Some((fraction, report)) = first_contact(checker, &edge[0], &edge[1], plan.final_spacing) {
            let fraction = (index as f64 + fraction) / edges as f64;
            return Err(PlanError::Blocked { fraction, report });
        }
    }
    let mut path = Path::polyline(waypoints);
    path.round_corners(plan.blend, plan.blend_halvings, |states| {
        states.windows(2).all(|edge| checker.edge_is_free(&edge[0], &edge[1], plan.final_spacing))
    });
    Ok(path)
}

fn follow(
    checker: &Checker,
    ik: &InverseKinematics,
    settings: &StraightSettings,
    start: &[f64],
    world_from_goal: &Pose,
) -> Result<Vec<Vec<f64>>, PlanError> {
    let world_from_start = checker.chain().tcp_pose(start);
    let length = world_from_start.position.distance(world_from_goal.position);
    let steps = (length / settings.step).max(world_from_start.angle_to(world_from_goal) / settings.turn).ceil();
    let steps = steps.clamp(1.0, 10_000.0) as usize;
    let mut waypoints = vec![start.to_vec()];
    for step in 1..=steps {
        let pose = world_from_start.interpolate(world_from_goal, step as f64 / steps as f64);
        let previous = &waypoints[step - 1];
        let Some(config) = ik.continue_line(&pose, previous, settings.max_joint_step, settings.max_turn) else {
            let what = format!(
                "the straight line of {:.0} mm ends after {:.0} %: joint limit or singularity",
                length * 1e3,
                100.0 * (step - 1) as f64 / steps as f64
            );
            return Err(PlanError::Unreachable { what });
        };
        waypoints.push(config);
    }
    Ok(waypoints)
}

/// First contact of an edge: its position as a share of the edge, and the pair; `None` if the edge is free.
fn first_contact(checker: &Checker, from: &[f64], to: &[f64], spacing: f64) -> Option<(f64, CollisionReport)> {
    let steps = checker.edge_steps(from, to, spacing);
    (1..=steps).find_map(|step| {
        let fraction = step as f64 / steps as f64;
        let config = lerp(from, to, fraction);
        let report = if checker.is_free(&config) { None } else { checker.check(&config) };
        report.map(|report| (fraction, report))
    })
}
