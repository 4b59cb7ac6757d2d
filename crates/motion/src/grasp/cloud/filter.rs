//! From raw points to what the sampler sees: checked, thinned, and completed where the cameras saw nothing.

use glam::DVec3;

use super::unseen::Unseen;
use super::{CloudError, CloudSettings, CloudTarget};

/// A point of the target.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) point: DVec3,
    /// Whether it was put there by [`Unseen::complete`].
    pub(super) guessed: bool,
}

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

/// Points of a surface `cell` apart, or farther, so that about `most` are left.
fn thinned_to(points: &[DVec3], cell: f64, most: usize) -> Vec<DVec3> {
    let fine = thinned(points, cell);
    let excess = fine.len() as f64 / most.max(1) as f64;
    if excess > 1.0 { thinned(points, cell * excess.sqrt()) } else { fine }
}

/// Means of the points in each cell of a grid, in the order of the cells; averaging also takes noise away where views
/// overlap.
pub(super) fn thinned(points: &[DVec3], cell: f64) -> Vec<DVec3> {
    let key = |point: &DVec3| {
        let index = (*point / cell).floor();
        // 21 bits each cover kilometres; farther points merge, which is harmless.
        [index.x, index.y, index.z]
            .into_iter()
            .fold(0_u64, |key, i| key << 21 | ((i as i64 + (1 << 20)) as u64 & 0x1f_ffff))
    };
    let mut keyed: Vec<(u64, DVec3)> = points.iter().map(|point| (key(point), *point)).collect();
    keyed.sort_by_key(|(key, _)| *key);
    keyed
        .chunk_by(|a, b| a.0 == b.0)
        .map(|cell| cell.iter().map(|(_, point)| *point).sum::<DVec3>() / cell.len() as f64)
        .collect()
}

fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| (low.min(*point), high.max(*point)))
}

/// Level direction in which points spread most.
pub(super) fn long_axis(points: impl Iterator<Item = DVec3>, middle: DVec3) -> DVec3 {
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for point in points {
        let d = point - middle;
        (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    DVec3::new(angle.cos(), angle.sin(), 0.0)
}

/// Standard deviations along the principal axes, by the closed form for symmetric 3×3 matrices.
fn principal_extents(points: &[DVec3]) -> [f64; 3] {
    let mean = points.iter().sum::<DVec3>() / points.len() as f64;
    let mut c = [0.0; 6];
    for point in points {
        let d = *point - mean;
        for (sum, value) in c.iter_mut().zip([d.x * d.x, d.y * d.y, d.z * d.z, d.x * d.y, d.x * d.z, d.y * d.z]) {
            *sum += value / points.len() as f64;
        }
    }
    let [xx, yy, zz, xy, xz, yz] = c;
    let mean = (xx + yy + zz) / 3.0;
    let off = xy * xy + xz * xz + yz * yz;
    let spread = (((xx - mean).powi(2) + (yy - mean).powi(2) + (zz - mean).powi(2) + 2.0 * off) / 6.0).sqrt();
    if spread < 1e-15 {
        return [mean.max(0.0).sqrt(); 3];
    }
    let [a, b, d] = [xx - mean, yy - mean, zz - mean].map(|value| value / spread);
    let (e, f, g) = (xy / spread, xz / spread, yz / spread);
    let half = (a * (b * d - g * g) - e * (e * d - g * f) + f * (e * g - b * f)) / 2.0;
    let angle = half.clamp(-1.0, 1.0).acos() / 3.0;
    [0.0, 2.0, 4.0].map(|third| {
        let eigenvalue = mean + 2.0 * spread * (angle + third * std::f64::consts::PI / 3.0).cos();
        eigenvalue.max(0.0).sqrt()
    })
}
