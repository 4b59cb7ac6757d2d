//! Convex hulls with few vertices.

use genmanip_assets::solid::Moments;
use genmanip_core::{Piece, Shape};
use glam::DVec3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;

/// Minimum thickness of a hull, m; thinner hulls are replaced by boxes.
const MIN_THICKNESS_M: f64 = 0.0015;

/// Hull volumes below this are rounding errors, m³.
const MIN_VOLUME_M3: f64 = 1e-11;

/// Vertices and triangles of the convex hull; `None` for coplanar points.
pub fn convex_hull(points: &[DVec3]) -> Option<(Vec<DVec3>, Vec<[u32; 3]>)> {
    let mut input: Vec<Vector> = points.iter().map(|point| Vector::from_array(point.to_array())).collect();
    input.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    input.dedup();
    if input.len() < 4 {
        return None;
    }
    let (corners, triangles) = try_convex_hull(&input).ok()?;
    Some((corners.iter().map(|corner| DVec3::from_array(corner.to_array())).collect(), triangles))
}

/// Volume enclosed by a hull, m³.
pub fn volume(corners: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let origin = corners.first().copied().unwrap_or_default();
    let triangle = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|index| corners[index as usize] - origin);
        a.dot(b.cross(c)) / 6.0
    };
    triangles.iter().map(triangle).sum()
}

/// Convex hull of points as a piece with at most about `most` vertices: the support points of evenly spread directions.
/// `None` without volume.
pub fn piece(points: &[DVec3], most: usize) -> Option<Piece> {
    let bounds = genmanip_core::Aabb::from_points(points.iter().copied());
    if !bounds.size().is_finite() {
        return None;
    }
    if bounds.size().min_element() < MIN_THICKNESS_M {
        let half_extents = (bounds.size() / 2.0).max(DVec3::splat(MIN_THICKNESS_M / 2.0));
        return Some(Piece::at(bounds.center(), Shape::Box { half_extents }));
    }
    let corners = match convex_hull(points).filter(|(corners, triangles)| volume(corners, triangles) > MIN_VOLUME_M3) {
        Some((corners, _)) => corners,
        // A slanted plate has no volume: it is thickened to the minimum.
        None => {
            let shifts = DVec3::AXES.map(|axis| axis * (MIN_THICKNESS_M / 2.0));
            let thick = points.iter().flat_map(|&point| shifts.iter().flat_map(move |&by| [point + by, point - by]));
            convex_hull(&thick.collect::<Vec<_>>())?.0
        }
    };
    let (corners, triangles) = convex_hull(&fewer(corners, most))?;
    let loose: Vec<[DVec3; 3]> = triangles.iter().map(|t| t.map(|index| corners[index as usize])).collect();
    let moments = Moments::of_surface(&loose);
    if !moments.center.is_finite() || moments.volume <= 1e-12 {
        return None;
    }
    let points = corners.iter().map(|corner| *corner - moments.center).collect();
    Some(Piece::at(moments.center, Shape::Hull { points }))
}

/// Support points of directions that are spread evenly over the sphere (Fibonacci lattice), at most `most`.
fn fewer(corners: Vec<DVec3>, most: usize) -> Vec<DVec3> {
    if corners.len() <= most {
        return corners;
    }
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let directions = most;
    let mut kept: Vec<usize> = Vec::new();
    for index in 0..directions {
        let z = 1.0 - (2.0 * index as f64 + 1.0) / directions as f64;
        let (sin, cos) = (golden * index as f64).sin_cos();
        let direction = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
        let farthest =
            (0..corners.len()).max_by(|&a, &b| corners[a].dot(direction).total_cmp(&corners[b].dot(direction)));
        kept.extend(farthest.filter(|farthest| !kept.contains(farthest)));
    }
    kept.sort_unstable();
    kept.into_iter().map(|index| corners[index]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hulls_keep_size_with_few_corners() {
        let ball: Vec<DVec3> = (0..4000)
            .map(|i| {
                let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 4000.0;
                let (sin, cos) = (2.4 * f64::from(i)).sin_cos();
                DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z) * 0.05
            })
            .collect();
        let piece = piece(&ball, 48).unwrap();
        let Shape::Hull { points } = &piece.shape else { panic!("no hull") };
        assert!((24..=48).contains(&points.len()), "{}", points.len());
        let radius = points.iter().map(|p| p.length()).fold(f64::INFINITY, f64::min);
        assert!(radius > 0.048, "{radius}");
    }

    #[test]
    fn flat_objects_are_thickened() {
        let square = [DVec3::ZERO, DVec3::X * 0.1, DVec3::Y * 0.1, DVec3::new(0.1, 0.1, 0.0)];
        let piece = piece(&square, 48).unwrap();
        assert!(matches!(piece.shape, Shape::Box { half_extents } if half_extents.z == MIN_THICKNESS_M / 2.0));
        let slanted: Vec<DVec3> = square.iter().map(|p| DVec3::new(p.x, p.y, p.x)).collect();
        assert!(super::piece(&slanted, 48).is_some());
    }
}
