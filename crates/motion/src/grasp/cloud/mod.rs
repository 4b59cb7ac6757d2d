//! Grasp sampling from point clouds: no object model, no network.
//!
//! The gripper approaches straight along one of a few directions; for each direction and roll, the points form a height
//! profile over a strip of pad width. Parts of the strip above the tips must fit between the pads, with space for the
//! pads beside them. This covers bodies, rims, walls and handles alike; flat objects are searched down to the table.
//! Contacts are where flat pads would touch the points on closing; their slope, offset, area and lever to the centre
//! are features of a logistic regression fitted to physics trials (`genmanip-lab grasp`) that predicts the success
//! probability.

mod filter;
mod occlusion;
mod points;
mod score;
mod strip;
#[cfg(test)]
mod tests;

use genmanip_core::{Grasp, Pose};
use glam::DVec3;
use serde::{Deserialize, Serialize};

pub use score::{Features, Weights};

use super::{GraspSettings, Gripper, same};

/// Target and scene points, world frame.
#[derive(Clone, Copy, Debug)]
pub struct CloudTarget<'a> {
    /// Target points from one view, from several fused views, or of the whole surface.
    pub points: &'a [DVec3],
    /// Camera positions; empty if the points cover the whole surface. With cameras, hidden sides are estimated.
    pub cameras: &'a [DVec3],
    /// Points of obstacles; the table may be omitted.
    pub scene: &'a [DVec3],
    /// Height of the table, world z (m).
    pub table_height: f64,
}

/// Error in a point cloud.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CloudError {
    /// There are no points.
    #[error("the cloud of the target is empty")]
    Empty,
    /// There are too few points.
    #[error("the cloud of the target has {got} points, expected at least {least}")]
    TooFew {
        /// Number of points given.
        got: usize,
        /// Minimum number of points.
        least: usize,
    },
    /// A number is NaN or infinite.
    #[error("point {index} of the {what} is not finite")]
    NotFinite {
        /// Name of the input that contains the number.
        what: &'static str,
        /// Index of the point.
        index: usize,
    },
    /// All points are collinear or coincide.
    #[error("the cloud of the target has no extent: {extent_mm:.2} mm across, expected a surface")]
    NoExtent {
        /// Standard deviation along the second principal axis, mm.
        extent_mm: f64,
    },
    /// The points are too far apart for one object, because of stray points or another unit than metres.
    #[error(
        "the cloud of the target is {extent_m:.3e} m wide, expected at most {MAX_EXTENT_M} m: are its points metres?"
    )]
    TooLarge {
        /// Longest side of the bounds, m.
        extent_m: f64,
    },
}

/// Largest side of the bounds of a target, m; bounds the height fields of the search.
const MAX_EXTENT_M: f64 = 5.0;

/// Settings of grasp sampling from point clouds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CloudSettings {
    /// Voxel size for downsampling target and scene (m).
    pub voxel: f64,
    /// Maximum number of target points; above it, voxels are enlarged, since large objects need less detail.
    pub most_points: usize,
    /// Share of a mirror image that must be hidden from all cameras to be accepted.
    pub hidden_share: f64,
    /// Number of rolls over half a turn when approaching from above; two more follow the target's axes.
    pub rolls: usize,
    /// Tilts of the other approaches from vertical (rad).
    pub tilts: Vec<f64>,
    /// Tip depths below the top of a strip to try (m).
    pub depths: Vec<f64>,
    /// Minimum height of the gripper above the table (m).
    pub table_clearance: f64,
    /// Clearance on either side between open pads and target, widest first (m).
    pub opening_clearances: Vec<f64>,
    /// Clearance of the hand to everything (m).
    pub hand_clearance: f64,
    /// Difference between the maximum opening and the widest grasp (m).
    pub width_clearance: f64,
    /// Maximum number of candidates returned.
    pub max_candidates: usize,
    /// Weights of the success model.
    pub weights: Weights,
}

impl Default for CloudSettings {
    fn default() -> Self {
        Self {
            voxel: 0.0025,
            most_points: 2000,
            hidden_share: 0.97,
            rolls: 12,
            tilts: vec![0.6, 1.25],
            depths: vec![0.008, 0.014, 0.02, 0.028, 0.038],
            table_clearance: 0.0015,
            opening_clearances: vec![0.008, 0.004, 0.002],
            hand_clearance: 0.005,
            width_clearance: 0.003,
            max_candidates: 48,
            weights: Weights::default(),
        }
    }
}

/// A grasp candidate with its features.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CloudGrasp {
    /// TCP pose in the world frame, contact distance, and success probability.
    pub grasp: Grasp,
    /// Gripper opening for the approach (m).
    pub opening: f64,
    /// Features of the success model.
    pub features: Features,
}

/// Grasp candidates, world frame, best first, distinct up to half a turn about the approach axis.
///
/// Empty if nothing fits the gripper.
///
/// # Errors
/// Fails if the cloud is empty, not finite, too small, too large or without extent.
pub fn cloud_grasps(
    target: &CloudTarget,
    gripper: &Gripper,
    sameness: &GraspSettings,
    settings: &CloudSettings,
) -> Result<Vec<CloudGrasp>, CloudError> {
    let cloud = filter::prepare(target, gripper.hand_bounds.max.y + gripper.max_width / 2.0, settings)?;
    let mut found = Vec::new();
    for (approach, rolls) in approaches(&cloud, settings) {
        for roll in rolls {
            strip::search(&cloud, gripper, settings, approach, roll, &mut found);
        }
    }
    found.sort_by(|a, b| b.grasp.score.total_cmp(&a.grasp.score));
    let mut kept: Vec<CloudGrasp> = Vec::new();
    let mut blocker = 0;
    for grasp in found {
        if kept.len() >= settings.max_candidates {
            break;
        }
        let is_new = |other: &CloudGrasp| !same(&other.grasp.pose, &grasp.grasp.pose, sameness);
        if kept.iter().all(is_new) && strip::hand_is_clear(&cloud, gripper, settings, &grasp.grasp.pose, &mut blocker) {
            kept.push(grasp);
        }
    }
    Ok(kept)
}

/// Approach directions, each with perpendicular closing directions.
fn approaches(cloud: &filter::Cloud, settings: &CloudSettings) -> Vec<(DVec3, Vec<DVec3>)> {
    let horizontal = |angle: f64| DVec3::new(angle.cos(), angle.sin(), 0.0);
    let rolls = settings.rolls.max(1);
    let even = (0..rolls).map(|roll| horizontal(std::f64::consts::PI * roll as f64 / rolls as f64));
    let long = points::long_axis(cloud.target.iter().map(|seen| seen.point), cloud.center);
    let down = [DVec3::new(-long.y, long.x, 0.0), long].into_iter().chain(even).collect();
    let mut all = vec![(DVec3::NEG_Z, down)];
    // From the side, too, the gripper closes horizontally, so that the palm's long side stays horizontal.
    let height = cloud.target.iter().map(|seen| seen.point.z).fold(f64::NEG_INFINITY, f64::max) - cloud.table_height;
    let directions = rolls / 2;
    for &tilt in settings.tilts.iter().filter(|&&tilt| height > 0.03 + 0.05 * tilt) {
        for direction in 0..directions {
            let side = horizontal(std::f64::consts::TAU * direction as f64 / directions as f64);
            let approach = side * tilt.sin() - DVec3::Z * tilt.cos();
            all.push((approach, vec![side.cross(DVec3::Z)]));
        }
    }
    all
}

/// TCP pose from its axes: z = approach, y = closing.
fn tcp_pose(position: DVec3, approach: DVec3, closing: DVec3) -> Pose {
    Pose::from_axes(position, closing.cross(approach), closing, approach)
}
