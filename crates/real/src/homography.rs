//! Homography between two planes from pairs of points (direct linear transform, normalised).

use genmanip_core::glam::{DMat3, DVec2};

use crate::linear::Square;

/// Homography from the first points to the second ones; `None` for fewer than four pairs, or collinear points.
pub fn homography(pairs: impl Iterator<Item = (DVec2, DVec2)> + Clone) -> Option<DMat3> {
    let (from, to) =
        (Normalised::of(pairs.clone().map(|pair| pair.0))?, Normalised::of(pairs.clone().map(|pair| pair.1))?);
    let mut sum = Square::zero(9);
    for (p, q) in pairs.map(|(p, q)| (from.of_point(p), to.of_point(q))) {
        sum.add_outer(&[p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x], 1.0);
        sum.add_outer(&[0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y], 1.0);
    }
    let found = sum.eigen();
    if found[1].0 < 1e-9 * found[8].0 {
        return None;
    }
    let h: [f64; 9] = found[0].1.as_slice().try_into().ok()?;
    let map = to.matrix().inverse() * DMat3::from_cols_array(&h).transpose() * from.matrix();
    map.is_finite().then_some(map)
}

/// Point mapped by a homography; `None` on or beyond its horizon line.
pub fn mapped(map: &DMat3, point: DVec2) -> Option<DVec2> {
    let image = *map * point.extend(1.0);
    let image = image.truncate() / image.z;
    image.is_finite().then_some(image)
}

/// Centroid of points, and their maximum distance from it (Hartley normalisation).
struct Normalised {
    center: DVec2,
    radius: f64,
}

impl Normalised {
    fn of(points: impl Iterator<Item = DVec2> + Clone) -> Option<Self> {
        let count = points.clone().count();
        let center = points.clone().sum::<DVec2>() / count as f64;
        let radius = points.map(|point| point.distance(center)).fold(0.0, f64::max).max(1e-12);
        (count >= 4).then_some(Self { center, radius })
    }

    fn of_point(&self, point: DVec2) -> DVec2 {
        (point - self.center) / self.radius
    }

    fn matrix(&self) -> DMat3 {
        DMat3::from_scale(DVec2::splat(1.0 / self.radius)) * DMat3::from_translation(-self.center)
    }
}
