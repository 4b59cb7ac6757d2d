//! From raw points to what the sampler sees: checked, thinned, and completed where the cameras saw nothing.

use glam::DVec3;

use super::points::{Seen, bounds, principal_extents, thinned, thinned_to};
use super::unseen::Unseen;
use super::{CloudError, CloudSettings, CloudTarget};

/// What the sampler works on, world frame.
#[derive(Debug)]
pub(super) struct Cloud {
    pub(super) target: Vec<Seen>,
    pub(super) scene: Vec<DVec3>,
    /// All of it in cells of three voxels, for the hand's body.
    pub(super) coarse: Vec<DVec3>,
    /// Stand-in for the centre of mass: the mean of the completed surface.
    pub(super) center: DVec3,
    /// Root mean square distance of the target's points from `center`, m.
    pub(super) spread: f64,
    pub(super) table_height: f64,
    /// What no camera saw.
    pub(super) unseen: Unseen,
}

/// Fewest points that say anything about a shape.
const FEWEST_POINTS: usize = 12;
/// A cloud that is narrower than this in two directions is a line or a point, m.
const NO_EXTENT_M: f64 = 0.001;

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
    if target.points.len() < FEWEST_POINTS {
        return Err(CloudError::TooFew { got: target.points.len(), least: FEWEST_POINTS });
    }
    let points = thinned_to(target.points, settings.voxel, settings.most_points);
    let (low, high) = bounds(&points);
    let mut extents = principal_extents(&points);
    extents.sort_by(f64::total_cmp);
    if points.len() < FEWEST_POINTS || extents[1] < NO_EXTENT_M {
        return Err(CloudError::NoExtent { extent_mm: extents[1] * 1e3 });
    }
    let near = |point: &DVec3| {
        point.z > target.table_height + settings.table_clearance + 0.002
            && (*point - low).min_element() > -reach
            && (high - *point).min_element() > -reach
    };
    let scene: Vec<DVec3> = target.scene.iter().copied().filter(near).collect();
    let scene = thinned(&scene, 2.0 * settings.voxel);
    let mut unseen = Unseen::new(&points, target.scene, target.cameras);
    let mut seen: Vec<Seen> = points.iter().map(|&point| Seen { point, guessed: false }).collect();
    let guessed = unseen.complete(&points, settings.hidden_share);
    unseen.raise(&guessed);
    seen.extend(guessed);
    let all: Vec<DVec3> = seen.iter().map(|seen| seen.point).chain(scene.iter().copied()).collect();
    let coarse = thinned(&all, 3.0 * settings.voxel);
    let center = seen.iter().map(|seen| seen.point).sum::<DVec3>() / seen.len() as f64;
    let spread = (seen.iter().map(|seen| seen.point.distance_squared(center)).sum::<f64>() / seen.len() as f64).sqrt();
    Ok(Cloud { target: seen, scene, coarse, center, spread, table_height: target.table_height, unseen })
}
