//! Current arm state and the collision world built from observations.

use genmanip_core::{Observation, Piece, PolicyError, Pose, Shape};
use genmanip_motion::{AllowedCollisions, CollisionWorld, PlanningScene};
use glam::DVec3;

use crate::settings::AgentSettings;

/// Obstacle name of the table.
const TABLE: &str = "table";
/// Obstacle name of the manipulated object.
pub(super) const OBJECT: &str = "the object";
/// Obstacle name of the observed points.
const OBSERVED_POINTS: &str = "the observed points";
/// Half extents of the table (m), larger than the arm's reach.
const TABLE_HALF_M: DVec3 = DVec3::new(1.2, 1.2, 0.02);

/// Arm joint positions and gripper opening.
#[derive(Clone, Debug)]
pub(super) struct ArmState {
    /// Arm joint positions (rad).
    pub arm: Vec<f64>,
    /// Gripper opening (m).
    pub width_m: f64,
}

impl ArmState {
    pub(super) fn of(observation: &Observation, dof: usize) -> Result<Self, PolicyError> {
        let unsuited = || PolicyError::Unsuited(format!("needs {dof} joint positions and the gripper opening"));
        let state = observation.state.get(Observation::STATE).filter(|state| state.len() == dof + 1);
        let (width, arm) = state.and_then(|state| state.split_last()).ok_or_else(unsuited)?;
        Ok(Self { arm: arm.to_vec(), width_m: *width })
    }
}

/// Collision world with the table only.
pub(super) fn table_world(settings: &AgentSettings) -> CollisionWorld {
    let mut world = CollisionWorld::new();
    let slab = Piece::at(DVec3::ZERO, Shape::Box { half_extents: TABLE_HALF_M });
    let below = DVec3::new(0.0, 0.0, settings.table_m - TABLE_HALF_M.z);
    // A box and a finite pose are always accepted.
    let _ = world.add(TABLE, &[slab], &Pose::from_position(below));
    world
}

/// Collision world with the table and the observed points, each a sphere of `radius_m`.
pub(super) fn world_with_points(settings: &AgentSettings, points: &[DVec3], radius_m: f64) -> CollisionWorld {
    let mut world = table_world(settings);
    if !points.is_empty() {
        // The points come from measured depths, which are finite.
        let _ = world.add_points(OBSERVED_POINTS, points, radius_m);
    }
    world
}

const NOTHING: &AllowedCollisions = &AllowedCollisions::NONE;

/// Planning scene with an empty gripper.
pub(super) fn empty_gripper(world: &CollisionWorld, width_m: f64) -> PlanningScene<'_> {
    PlanningScene { world, attached: None, allowed: NOTHING, gripper_width: width_m }
}
