//! The arm as it is, and the world it starts from.

use genmanip_core::{Observation, Piece, PolicyError, Pose, Shape};
use genmanip_motion::{Allowed, CollisionWorld, PlanningScene};
use glam::DVec3;

use crate::settings::AgentSettings;

/// Name of the table among the obstacles.
const TABLE: &str = "table";
/// Name of the thing among the obstacles.
pub(super) const THING: &str = "the thing";
/// Name of what the cameras see, among the obstacles.
const SEEN: &str = "what is seen";
/// Half of the table's size, m: more than an arm reaches.
const TABLE_HALF_M: DVec3 = DVec3::new(1.2, 1.2, 0.02);

/// Where the arm is and how far the fingers are open.
#[derive(Clone, Debug)]
pub(super) struct Hand {
    /// Joint positions, rad.
    pub arm: Vec<f64>,
    /// Opening, m.
    pub width_m: f64,
}

impl Hand {
    pub(super) fn of(observation: &Observation, dof: usize) -> Result<Self, PolicyError> {
        let unsuited = || PolicyError::Unsuited(format!("needs {dof} joint positions and the opening of the fingers"));
        let state = observation.state.get(Observation::STATE).filter(|state| state.len() == dof + 1);
        let (width, arm) = state.and_then(|state| state.split_last()).ok_or_else(unsuited)?;
        Ok(Self { arm: arm.to_vec(), width_m: *width })
    }
}

/// The table alone.
pub(super) fn table(settings: &AgentSettings) -> CollisionWorld {
    let mut world = CollisionWorld::new();
    let slab = Piece::at(DVec3::ZERO, Shape::Box { half_extents: TABLE_HALF_M });
    let below = DVec3::new(0.0, 0.0, settings.table_m - TABLE_HALF_M.z);
    // A box and a finite pose are always accepted.
    let _ = world.add(TABLE, &[slab], &Pose::from_position(below));
    world
}

/// The table with the points that cameras see above it.
pub(super) fn with_points(settings: &AgentSettings, points: &[DVec3], radius_m: f64) -> CollisionWorld {
    let mut world = table(settings);
    if !points.is_empty() {
        // The points come from measured depths, which are finite.
        let _ = world.add_points(SEEN, points, radius_m);
    }
    world
}

const NOTHING: &Allowed = &Allowed::NONE;

/// An empty hand in a world.
pub(super) fn empty(world: &CollisionWorld, width_m: f64) -> PlanningScene<'_> {
    PlanningScene { world, attached: None, allowed: NOTHING, gripper_width: width_m }
}
