//! Input of the grasp sampler: one object at its pose.

use genmanip_core::{Piece, Pose};
use glam::DVec3;

/// Object for which grasps are sampled, at its pose.
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

/// Alignment from the cosine of the larger contact angle: 1 if the pads are parallel to the surface, 0 at the friction
/// cone.
pub(super) fn squareness(cosine: f64, friction: f64) -> f64 {
    1.0 - cosine.clamp(-1.0, 1.0).acos() / friction.atan()
}
