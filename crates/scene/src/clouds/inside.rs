//! How many points of one cloud lie in the convex hull of another.
//!
//! The hull of thousands of points is rarely needed: a polytope of supporting planes holds the hull, the hull of the
//! extreme points along the same directions is held by it, and mostly the two agree on which side of one half the count is.

use std::sync::OnceLock;

use glam::DVec3;

use crate::hull::Hull;

/// Tolerance of the half-space tests, metres: points on the surface count.
const TOLERANCE: f64 = 1e-12;

/// Convex bounds of a cloud from outside and inside, and the hull itself when it has been needed.
#[derive(Debug)]
pub(crate) struct Enclosure {
    /// Supporting planes.
    outer: Vec<(DVec3, f64)>,
    /// Faces of the hull of the extreme points; empty when they lie in a plane.
    inner: Vec<(DVec3, f64)>,
    exact: OnceLock<Vec<(DVec3, f64)>>,
}

impl Enclosure {
    pub fn new(points: &[DVec3]) -> Self {
        let mut outer = Vec::new();
        let mut extremes = Vec::new();
        for direction in directions() {
            let mut best = (f64::NEG_INFINITY, DVec3::ZERO);
            for &point in points {
                let along = direction.dot(point);
                if along > best.0 {
                    best = (along, point);
                }
            }
            outer.push((direction, best.0 + TOLERANCE));
            extremes.push(best.1);
        }
        Self { outer, inner: Hull::of(&extremes).planes(TOLERANCE), exact: OnceLock::new() }
    }

    /// Whether at least `needed` of the points lie in the hull of `own`, the cloud this was made from.
    pub fn holds(&self, points: &[DVec3], own: &[DVec3], needed: usize) -> bool {
        if self.inner.is_empty() && is_flat(own) {
            return false;
        }
        let (mut sure, mut open) = (0, Vec::new());
        for (seen, &point) in points.iter().enumerate() {
            if sure + open.len() + (points.len() - seen) < needed {
                return false;
            }
            if !self.outer.iter().all(|(normal, distance)| normal.dot(point) <= *distance) {
                continue;
            }
            if within(&self.inner, point) {
                sure += 1;
            } else {
                open.push(point);
            }
            if sure >= needed {
                return true;
            }
        }
        if sure + open.len() < needed {
            return false;
        }
        let exact = self.exact.get_or_init(|| {
            let outside: Vec<DVec3> =
                own.iter().copied().filter(|&point| !strictly_within(&self.inner, point)).collect();
            Hull::of(&outside).planes(TOLERANCE)
        });
        sure + open.iter().filter(|&&point| within(exact, point)).count() >= needed
    }
}

fn within(planes: &[(DVec3, f64)], point: DVec3) -> bool {
    !planes.is_empty() && planes.iter().all(|(normal, distance)| normal.dot(point) <= *distance)
}

fn strictly_within(planes: &[(DVec3, f64)], point: DVec3) -> bool {
    !planes.is_empty() && planes.iter().all(|(normal, distance)| normal.dot(point) < *distance - 1e-9)
}

/// Whether all points lie in a plane, as far as rounding can tell.
fn is_flat(points: &[DVec3]) -> bool {
    let Some(&origin) = points.first() else { return true };
    let farthest = |measure: &dyn Fn(DVec3) -> f64| {
        points
            .iter()
            .map(|&point| point - origin)
            .max_by(|a, b| measure(*a).total_cmp(&measure(*b)))
            .unwrap_or_default()
    };
    let along = farthest(&|offset| offset.length_squared()).normalize_or_zero();
    let across = farthest(&|offset| along.cross(offset).length_squared());
    let normal = along.cross(across).normalize_or_zero();
    points.iter().all(|&point| normal.dot(point - origin).abs() < 1e-9)
}

/// Directions spread evenly: the corners, edges and faces of a cube and a spiral over the sphere.
fn directions() -> impl Iterator<Item = DVec3> {
    let cube = (0..27).filter(|index| *index != 13).map(|index| {
        DVec3::new(f64::from(index % 3 - 1), f64::from(index / 3 % 3 - 1), f64::from(index / 9 - 1)).normalize()
    });
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let spiral = (0..38).map(move |index| {
        let z = 1.0 - (2.0 * f64::from(index) + 1.0) / 38.0;
        let (sin, cos) = (golden * f64::from(index)).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        DVec3::new(radius * cos, radius * sin, z)
    });
    cube.chain(spiral)
}
