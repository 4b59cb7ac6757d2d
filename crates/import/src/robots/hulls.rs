//! Convex hulls of meshes with a bounded number of vertices.
//!
//! A hull with too many vertices is replaced by an enclosing polytope, which is refined where it is farthest from the
//! mesh (Kamenev's method of closest points): at each step, the farthest vertex is cut off by the supporting plane of
//! the mesh in the direction of that vertex. The time is linear in the size of the mesh.

use genmanip_core::{Aabb, glam::DVec3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SupportMap;

use crate::collision::hull::convex_hull;

/// Maximum number of vertices; larger hulls are simplified.
pub const MAX_CORNERS: usize = 256;
/// Distance between polytope and mesh at which refinement ends, m. Chosen by hand.
const TOLERANCE_M: f64 = 0.0005;
/// Number of points above which the exact hull is not computed but approximated at once. Chosen by hand: bounds the
/// time.
const MAX_EXACT: usize = 1500;
/// Number of directions along which the outermost points are found at first. Chosen by hand.
const DIRECTIONS: usize = 256;
/// Thickness given to flat meshes, m. Chosen by hand.
const THICKNESS_M: f64 = 0.001;
/// Distance below which vertices are merged, m.
const SAME_M: f64 = 1e-7;

/// A hull, and its error against the exact hull of the points.
#[derive(Debug)]
pub struct Hull {
    /// Vertices of the hull.
    pub corners: Vec<DVec3>,
    /// Maximum distance of a vertex from the exact hull, m; 0 if the hull is exact.
    pub error_m: f64,
    /// True if the points are coplanar and the hull was given a thickness.
    pub thickened: bool,
}

/// Convex hull of points, or an enclosing polytope with at most [`MAX_CORNERS`] vertices; `None` without points.
pub fn hull(mut points: Vec<DVec3>) -> Option<Hull> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    points.dedup();
    let directions = spread(DIRECTIONS);
    let size = Aabb::from_points(points.iter().copied()).size();
    if points.is_empty() || !size.is_finite() {
        return None;
    }
    let (mut points, thickened) = match is_flat(&points, &directions) {
        true => (thickened(&points), true),
        false => (points, false),
    };
    if points.len() > MAX_CORNERS {
        points = outermost(points, &directions);
    }
    if points.len() <= MAX_EXACT {
        points = convex_hull(&points).map_or(points, |(corners, _)| corners);
        if points.len() <= MAX_CORNERS {
            return Some(Hull { corners: points, error_m: 0.0, thickened });
        }
    }
    let (corners, error_m) = around(&points);
    Some(Hull { corners, error_m, thickened })
}

/// Unit vectors spread evenly over the sphere (Fibonacci lattice).
pub(super) fn spread(count: usize) -> Vec<DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let direction = |index: usize| {
        let z = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
        let (sin, cos) = (golden * index as f64).sin_cos();
        DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
    };
    (0..count).map(direction).collect()
}

/// True if the extent in the thinnest direction vanishes.
fn is_flat(points: &[DVec3], directions: &[DVec3]) -> bool {
    let mut normal = DVec3::ZERO;
    let Some(&first) = points.first() else { return true };
    let far = points.iter().copied().max_by(|a, b| a.distance(first).total_cmp(&b.distance(first))).unwrap_or(first);
    let along = (far - first).normalize_or_zero();
    for point in points {
        let cross = along.cross(*point - first);
        if cross.length() > normal.length() {
            normal = cross;
        }
    }
    let extent = |axis: DVec3| {
        let reach = |sign: f64| points.iter().map(|point| sign * axis.dot(*point)).fold(f64::NEG_INFINITY, f64::max);
        reach(1.0) + reach(-1.0)
    };
    let axes = normal.try_normalize().into_iter().chain(directions.iter().copied().take(1));
    points.len() < 4 || normal.length() < 1e-12 || axes.map(extent).fold(f64::INFINITY, f64::min) < 1e-6
}

fn thickened(points: &[DVec3]) -> Vec<DVec3> {
    let shifts = DVec3::AXES.map(|axis| axis * (THICKNESS_M / 2.0));
    points.iter().flat_map(|&point| shifts.iter().flat_map(move |&by| [point + by, point - by])).collect()
}

/// Points without those that are certainly inside the hull of the support points along the directions.
fn outermost(points: Vec<DVec3>, directions: &[DVec3]) -> Vec<DVec3> {
    let mut extremes: Vec<DVec3> = directions.iter().map(|along| farthest(&points, *along)).collect();
    extremes.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    extremes.dedup();
    let Some((corners, triangles)) = convex_hull(&extremes) else { return points };
    let planes: Vec<(DVec3, f64)> = triangles
        .iter()
        .filter_map(|triangle| {
            let [a, b, c] = triangle.map(|index| corners[index as usize]);
            let outward = (b - a).cross(c - a).try_normalize()?;
            Some((outward, outward.dot(a)))
        })
        .collect();
    // Only points strictly inside are removed: points in the face planes may be vertices.
    let is_inside = |point: &DVec3| planes.iter().all(|(outward, reach)| outward.dot(*point) < reach - 1e-9);
    points.into_iter().filter(|point| !is_inside(point)).collect()
}

/// Farthest of some points along a direction; the origin without points.
pub(super) fn farthest(points: &[DVec3], along: DVec3) -> DVec3 {
    let mut best = (f64::NEG_INFINITY, DVec3::ZERO);
    for &point in points {
        let reach = point.dot(along);
        if reach > best.0 {
            best = (reach, point);
        }
    }
    best.1
}

/// Convex hull of points, as a support mapping for GJK.
struct Cloud<'a>(&'a [DVec3]);

impl SupportMap for Cloud<'_> {
    fn local_support_point(&self, direction: Vector) -> Vector {
        Vector::from_array(farthest(self.0, DVec3::from_array(direction.to_array())).to_array())
    }
}

/// A single point at the origin of its frame, as a support mapping for GJK.
struct Origin;

impl SupportMap for Origin {
    fn local_support_point(&self, _direction: Vector) -> Vector {
        Vector::ZERO
    }
}

/// Vertex of the polytope, with direction and distance from the hull of the points.
struct Corner {
    at: DVec3,
    away: DVec3,
    distance_m: f64,
}

fn corner(points: &[DVec3], at: DVec3) -> Corner {
    let vector = |point: DVec3| Vector::from_array(point.to_array());
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(CsoPoint::new(vector(farthest(points, at)), vector(at)));
    let pose = Pose::translation(at.x, at.y, at.z);
    let found = gjk::closest_points(&pose, &Cloud(points), &Origin, f64::MAX, true, &mut simplex);
    let offset = match found {
        GJKResult::ClosestPoints(nearest, _, _) => at - DVec3::from_array(nearest.to_array()),
        // The vertex touches the hull, or is too close to measure its distance.
        GJKResult::Intersection | GJKResult::Proximity(_) | GJKResult::NoIntersection(_) => DVec3::ZERO,
    };
    Corner { at, away: offset.normalize_or_zero(), distance_m: offset.length() }
}

/// Polytope that encloses points, and the maximum distance of its vertices from their hull.
fn around(points: &[DVec3]) -> (Vec<DVec3>, f64) {
    let bounds = Aabb::from_points(points.iter().copied());
    let mut polytope = Polytope::cuboid(bounds.min, bounds.max);
    let mut corners: Vec<Corner> = polytope.corners().into_iter().map(|at| corner(points, at)).collect();
    // Every cut removes at least one vertex and adds some; refinement to the maximum size needs far fewer cuts.
    for _ in 0..4 * MAX_CORNERS {
        let worst = corners.iter().max_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        let Some(worst) = worst else { return (Vec::new(), 0.0) };
        let (away, error_m) = (worst.away, worst.distance_m);
        let finished = |corners: Vec<Corner>| (corners.into_iter().map(|corner| corner.at).collect(), error_m);
        if error_m < TOLERANCE_M || away == DVec3::ZERO {
            return finished(corners);
        }
        let mut cut = polytope.clone();
        cut.cut(away, farthest(points, away).dot(away) + 1e-9);
        let left = cut.corners();
        if left.len() > MAX_CORNERS || left.len() < 4 {
            return finished(corners);
        }
        polytope = cut;
        let mut known = std::mem::take(&mut corners);
        for at in left {
            match known.iter().position(|known| known.at == at) {
                Some(index) => corners.push(known.swap_remove(index)),
                None => corners.push(corner(points, at)),
            }
        }
        // If the cut has not removed its vertex, further cuts make no progress.
        if corners.iter().any(|corner| corner.distance_m >= error_m && corner.away == away) {
            return finished(corners);
        }
    }
    let error_m = corners.iter().map(|corner| corner.distance_m).fold(0.0, f64::max);
    (corners.into_iter().map(|corner| corner.at).collect(), error_m)
}

/// A convex polytope as its faces, each a convex polygon.
#[derive(Clone)]
struct Polytope {
    faces: Vec<Vec<DVec3>>,
}

impl Polytope {
    fn cuboid(min: DVec3, max: DVec3) -> Self {
        let at = |index: usize| {
            let pick = |axis: usize| if index >> axis & 1 == 1 { max[axis] } else { min[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        };
        let faces = [[0, 2, 6, 4], [1, 3, 7, 5], [0, 1, 5, 4], [2, 3, 7, 6], [0, 1, 3, 2], [4, 5, 7, 6]];
        Self { faces: faces.iter().map(|face| face.iter().map(|index| at(*index)).collect()).collect() }
    }

    /// Distinct vertices of all faces.
    fn corners(&self) -> Vec<DVec3> {
        let mut found: Vec<DVec3> = Vec::new();
        for &corner in self.faces.iter().flatten() {
            if found.iter().all(|known| known.distance_squared(corner) > SAME_M * SAME_M) {
                found.push(corner);
            }
        }
        found
    }

    /// Cuts off the part of the polytope beyond the plane `outward · x = reach`.
    fn cut(&mut self, outward: DVec3, reach: f64) {
        let beyond = |point: DVec3| outward.dot(point) - reach;
        let mut rim: Vec<DVec3> = Vec::new();
        for face in &mut self.faces {
            let mut kept = Vec::with_capacity(face.len() + 1);
            for (index, &here) in face.iter().enumerate() {
                let next = face[(index + 1) % face.len()];
                let (a, b) = (beyond(here), beyond(next));
                if a <= 0.0 {
                    kept.push(here);
                }
                if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                    // Interpolated from the inner end in both faces of the edge, so that both get exactly the same
                    // vertex.
                    let (inner, outer, s, t) = if a < 0.0 { (here, next, a, b) } else { (next, here, b, a) };
                    let crossing = inner + (outer - inner) * (s / (s - t));
                    kept.push(crossing);
                    rim.push(crossing);
                }
                if a == 0.0 {
                    rim.push(here);
                }
            }
            *face = kept;
        }
        self.faces.retain(|face| face.len() >= 3);
        let mut distinct: Vec<DVec3> = Vec::new();
        for point in rim {
            if distinct.iter().all(|known| known.distance_squared(point) > SAME_M * SAME_M) {
                distinct.push(point);
            }
        }
        let center = distinct.iter().sum::<DVec3>() / distinct.len().max(1) as f64;
        let (across, up) = outward.any_orthonormal_pair();
        let angle = |point: &DVec3| (*point - center).dot(up).atan2((*point - center).dot(across));
        distinct.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        if distinct.len() >= 3 {
            self.faces.push(distinct);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on the surface of an ellipsoid.
    fn cloud(count: usize, half: DVec3) -> Vec<DVec3> {
        let point = |index: usize| {
            let z = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
            let (sin, cos) = (2.4 * index as f64).sin_cos();
            DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z) * half
        };
        (0..count).map(point).collect()
    }

    /// Every point is inside the simplified hull, whose error is small for any number of points.
    #[test]
    fn simplified_hulls_contain_the_mesh() {
        for (count, half) in
            [(20_000, DVec3::splat(0.1)), (3000, DVec3::new(0.2, 0.05, 0.02)), (400, DVec3::splat(0.04))]
        {
            let points = cloud(count, half);
            let hull = hull(points.clone()).unwrap();
            assert!((4..=MAX_CORNERS).contains(&hull.corners.len()), "{}", hull.corners.len());
            assert!(hull.error_m < 0.04 * half.max_element(), "{} for {half}", hull.error_m);
            // The error is the distance by which vertices protrude from the ellipsoid, since its points are dense.
            let protrudes = hull
                .corners
                .iter()
                .map(|corner| points.iter().map(|point| point.distance(*corner)).fold(f64::INFINITY, f64::min));
            let protrudes = protrudes.fold(0.0, f64::max);
            assert!(hull.error_m <= protrudes + 1e-9, "{} {protrudes}", hull.error_m);
            assert!(count < 10_000 || hull.error_m > 0.3 * protrudes, "{} {protrudes}", hull.error_m);
            let (corners, triangles) = convex_hull(&hull.corners).unwrap();
            for triangle in triangles {
                let [a, b, c] = triangle.map(|index| corners[index as usize]);
                let Some(outward) = (b - a).cross(c - a).try_normalize() else { continue };
                let beyond = points.iter().map(|point| outward.dot(*point - a)).fold(f64::NEG_INFINITY, f64::max);
                assert!(beyond < 1e-6, "a point is {beyond} m outside");
            }
        }
    }

    #[test]
    fn small_hulls_are_exact_and_flat_ones_get_a_thickness() {
        let cube: Vec<DVec3> =
            (0..8_u32).map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2))).collect();
        let found = hull(cube.iter().copied().chain([DVec3::splat(0.5)]).collect()).unwrap();
        assert_eq!((found.corners.len(), found.error_m, found.thickened), (8, 0.0, false));
        let slanted: Vec<DVec3> =
            [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], [0.1, 0.1]].map(|[x, y]| DVec3::new(x, y, x)).to_vec();
        assert!(hull(slanted).unwrap().thickened);
        assert!(hull(vec![DVec3::ONE]).unwrap().thickened && hull(vec![]).is_none());
    }
}
