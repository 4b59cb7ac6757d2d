//! Preprocessing of raw points: validation, downsampling, and completion of hidden sides.

use glam::DVec3;

use super::occlusion::Occlusion;
use super::points::{Seen, bounds, principal_extents, thinned, thinned_to};
use super::{CloudError, CloudSettings, CloudTarget, MAX_EXTENT_M};

/// Preprocessed input of the sampler, world frame.
#[derive(Debug)]
pub(super) struct Cloud {
    pub(super) target: Vec<Seen>,
    pub(super) scene: Vec<DVec3>,
    /// All points downsampled to cells of three voxels, for the hand.
    pub(super) coarse: Vec<DVec3>,
    /// Estimate of the centre of mass: mean of the completed surface.
    pub(super) center: DVec3,
    /// Root mean square distance of the target's points from `center` (m).
    pub(super) spread: f64,
    pub(super) table_height: f64,
    /// Model of what the cameras cannot see: depth buffers and a height grid.
    pub(super) occlusion: Occlusion,
}

/// Minimum number of target points for sampling. Chosen by hand.
const MIN_POINTS: usize = 12;
/// Minimum second principal extent of a surface (m).
const MIN_EXTENT_M: f64 = 0.001;

pub(super) fn prepare(target: &CloudTarget, reach: f64, settings: &CloudSettings) -> Result<Cloud, CloudError> {
    if target.points.is_empty() {
        return Err(CloudError::Empty);
    }
    let clouds = [("target", target.points), ("scene", target.scene), ("cameras", target.cameras)];
    for (what, points) in clouds {
        if let Some(index) = points.iter().position(|point| !point.is_finite()) {
            return Err(CloudError::NotFinite { what, index });
        }
    }
    if !target.table_height.is_finite() {
        return Err(CloudError::NotFinite { what: "table height", index: 0 });
    }
    if target.points.len() < MIN_POINTS {
        return Err(CloudError::TooFew { got: target.points.len(), least: MIN_POINTS });
    }
    let (low, high) = bounds(target.points);
    let extent_m = (high - low).max_element();
    if extent_m > MAX_EXTENT_M {
        return Err(CloudError::TooLarge { extent_m });
    }
    let points = thinned_to(target.points, settings.voxel, settings.most_points);
    let (low, high) = bounds(&points);
    let mut extents = principal_extents(&points);
    extents.sort_by(f64::total_cmp);
    if points.len() < MIN_POINTS || extents[1] < MIN_EXTENT_M {
        return Err(CloudError::NoExtent { extent_mm: extents[1] * 1e3 });
    }
    let near = |point: &DVec3| {
        point.z > target.table_height + settings.table_clearance + 0.002
            && (*point - low).min_element() > -reach
            && (high - *point).min_element() > -reach
    };
    let scene: Vec<DVec3> = target.scene.iter().copied().filter(near).collect();
    let scene = thinned(&scene, 2.0 * settings.voxel);
    let mut occlusion = Occlusion::new(&points, target.scene, target.cameras);
    let mut seen: Vec<Seen> = points.iter().map(|&point| Seen { point, guessed: false }).collect();
    let guessed = occlusion.complete(&points, settings.hidden_share);
    occlusion.add_estimated(&guessed);
    seen.extend(guessed);
    let all: Vec<DVec3> = seen.iter().map(|seen| seen.point).chain(scene.iter().copied()).collect();
    let coarse = thinned(&all, 3.0 * settings.voxel);
    let center = seen.iter().map(|seen| seen.point).sum::<DVec3>() / seen.len() as f64;
    let spread = (seen.iter().map(|seen| seen.point.distance_squared(center)).sum::<f64>() / seen.len() as f64).sqrt();
    Ok(Cloud { target: seen, scene, coarse, center, spread, table_height: target.table_height, occlusion })
}
