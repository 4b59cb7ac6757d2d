//! Grasp candidates from points alone: no model, no network.
//!
//! The hand comes straight in along one of a few approach directions; for each, and for each roll of the hand, the
//! points are seen as heights over a strip as wide as the pads.
//! Where the strip rises above the tips it must fit between the pads, and beside it the pads must find room: so bodies,
//! rims, walls and handles come out alike, and things that lie flat on the table are searched down to the table.
//! The contacts are where flat pads would meet the points on closing; their slope, offset, area and lever to the centre
//! give features, and a logistic model fitted to physics trials (`genmanip-lab grasp`) turns these into a chance.

mod filter;
mod points;
mod score;
mod strip;
#[cfg(test)]
mod tests;
mod unseen;

use genmanip_core::{Grasp, Pose};
use glam::DVec3;
use serde::{Deserialize, Serialize};

pub use score::{Features, Weights};

use super::{GraspSettings, Gripper, same};

/// Points of what is to be grasped, and what is known around it; world frame.
#[derive(Clone, Copy, Debug)]
pub struct CloudTarget<'a> {
    /// Points on the target, from one view, several fused ones, or its whole surface.
    pub points: &'a [DVec3],
    /// Where the cameras were; empty when the points cover the whole surface. With cameras, hidden sides are guessed.
    pub cameras: &'a [DVec3],
    /// Points of everything else that the hand must keep clear of; the table need not be among them.
    pub scene: &'a [DVec3],
    /// Height of the table's top (world z), m.
    pub table_height: f64,
}

/// A cloud that cannot be worked with.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CloudError {
    /// There are no points.
    #[error("the cloud of the target is empty")]
    Empty,
    /// There are too few points.
    #[error("the cloud of the target has {got} points, expected at least {least}")]
    TooFew {
        /// Number of points.
        got: usize,
        /// Number needed.
        least: usize,
    },
    /// A number is NaN or infinite.
    #[error("point {index} of the {what} is not finite")]
    NotFinite {
        /// Which input.
        what: &'static str,
        /// Index of the point.
        index: usize,
    },
    /// All points lie on a line or in one place.
    #[error("the cloud of the target has no extent: {extent_mm:.2} mm across, expected a surface")]
    NoExtent {
        /// Standard deviation along the second principal axis, mm.
        extent_mm: f64,
    },
}

/// How points become grasps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CloudSettings {
    /// Points are averaged in cells of this size, m.
    pub voxel: f64,
    /// Points of the target above which the cells are made larger: a thing with many is large, and needs no finer ones.
    pub most_points: usize,
    /// Share of a mirror image that must be hidden from all cameras for the image to be believed.
    pub hidden_share: f64,
    /// Rolls of the hand over half a turn, coming from above; two more are along the target's axes.
    pub rolls: usize,
    /// Angles from straight down of the other approaches, rad.
    pub tilts: Vec<f64>,
    /// How far below the top of a strip the tips are tried, m.
    pub depths: Vec<f64>,
    /// Height of the lowest point of the gripper above the table, m.
    pub table_clearance: f64,
    /// Room on either side between open pads and target, widest first, m.
    pub opening_clearances: Vec<f64>,
    /// Distance of the hand's body from everything, m.
    pub hand_clearance: f64,
    /// Difference between the gripper's largest opening and the widest grasp, m.
    pub width_clearance: f64,
    /// Candidates returned.
    pub max_candidates: usize,
    /// The model of the score.
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

/// A candidate with what its score was made of.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CloudGrasp {
    /// Pose of the tcp in the world, distance of the contacts, and the chance that the grasp holds.
    pub grasp: Grasp,
    /// Opening with which to approach, m.
    pub opening: f64,
    /// The terms of the score.
    pub features: Features,
}

/// Candidates in the world frame, best first, none equal to another up to half a turn about the approach axis.
///
/// Empty when nothing fits the hand.
///
/// # Errors
/// A cloud that is empty, not finite, too small or without extent.
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
        let fresh = |other: &CloudGrasp| !same(&other.grasp.pose, &grasp.grasp.pose, sameness);
        if kept.iter().all(fresh) && strip::hand_is_clear(&cloud, gripper, settings, &grasp.grasp.pose, &mut blocker) {
            kept.push(grasp);
        }
    }
    Ok(kept)
}

/// Approach directions, each with closing directions at a right angle to it.
fn approaches(cloud: &filter::Cloud, settings: &CloudSettings) -> Vec<(DVec3, Vec<DVec3>)> {
    let level = |angle: f64| DVec3::new(angle.cos(), angle.sin(), 0.0);
    let rolls = settings.rolls.max(1);
    let even = (0..rolls).map(|roll| level(std::f64::consts::PI * roll as f64 / rolls as f64));
    let long = points::long_axis(cloud.target.iter().map(|seen| seen.point), cloud.center);
    let down = [DVec3::new(-long.y, long.x, 0.0), long].into_iter().chain(even).collect();
    let mut all = vec![(DVec3::NEG_Z, down)];
    // From the side the hand closes along the table, as from above: the palm's long side stays level.
    let height = cloud.target.iter().map(|seen| seen.point.z).fold(f64::NEG_INFINITY, f64::max) - cloud.table_height;
    let ways = rolls / 2;
    for &tilt in settings.tilts.iter().filter(|&&tilt| height > 0.03 + 0.05 * tilt) {
        for way in 0..ways {
            let side = level(std::f64::consts::TAU * way as f64 / ways as f64);
            let approach = side * tilt.sin() - DVec3::Z * tilt.cos();
            all.push((approach, vec![side.cross(DVec3::Z)]));
        }
    }
    all
}

/// The tcp's pose from its axes: z = approach, y = closing.
fn tcp_pose(position: DVec3, approach: DVec3, closing: DVec3) -> Pose {
    Pose::from_axes(position, closing.cross(approach), closing, approach)
}
