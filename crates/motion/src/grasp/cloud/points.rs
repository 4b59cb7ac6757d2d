//! Point types of the sampler, downsampling, extents and principal axes.

use glam::DVec3;

/// A point of the target, world frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) point: DVec3,
    /// True if estimated by [`super::occlusion::Occlusion::complete`].
    pub(super) guessed: bool,
}

/// A point in gripper coordinates: along closing, across, along approach (m); in 32 bits for memory bandwidth.
#[derive(Clone, Copy, Default)]
pub(super) struct Local {
    pub(super) c: f32,
    pub(super) h: f32,
    pub(super) a: f32,
    /// 1 if estimated, 0 if observed.
    pub(super) guessed: f32,
}

/// Downsamples a surface to about `most` points at least `cell` apart.
pub(super) fn thinned_to(points: &[DVec3], cell: f64, most: usize) -> Vec<DVec3> {
    let fine = thinned(points, cell);
    let excess = fine.len() as f64 / most.max(1) as f64;
    if excess > 1.0 { thinned(points, cell * excess.sqrt()) } else { fine }
}

/// Voxel-grid downsampling: mean of the points in each cell, in cell order; averages noise of overlapping views.
pub(super) fn thinned(points: &[DVec3], cell: f64) -> Vec<DVec3> {
    let key = |point: &DVec3| {
        let index = (*point / cell).floor();
        // 21 bits per axis cover kilometres; farther points wrap around, which at most merges voxels.
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

/// Lower and upper corner of the axis-aligned bounding box (m).
pub(super) fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| (low.min(*point), high.max(*point)))
}

/// Horizontal direction of largest variance about `middle`, a unit vector.
pub(super) fn long_axis(points: impl Iterator<Item = DVec3>, middle: DVec3) -> DVec3 {
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for point in points {
        let d = point - middle;
        (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    DVec3::new(angle.cos(), angle.sin(), 0.0)
}

/// Standard deviations along the principal axes (m), by the closed form for symmetric 3×3 matrices.
pub(super) fn principal_extents(points: &[DVec3]) -> [f64; 3] {
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
