//! Counts the points of one cloud in the convex hull of another.
//!
//! Computing the full hull of thousands of points is rarely necessary: an outer polytope of supporting planes contains
//! the hull, and the hull of the extreme points along the same directions is contained in it. Usually both give the
//! same answer to the question whether at least half of the points are inside.

use std::sync::OnceLock;

use glam::DVec3;

use super::tree::Tree;
use crate::hull::Hull;

/// Tolerance of the half-space tests, metres, so that points on the surface count.
const TOLERANCE: f64 = 1e-12;

/// Outer and inner convex bounds of a cloud, and its exact hull once a query needed it.
#[derive(Debug)]
pub(crate) struct Enclosure {
    /// Supporting planes: outward normal, and distance from the origin along it (m).
    outer: Vec<(DVec3, f64)>,
    /// Faces of the hull of the extreme points; empty if they are coplanar.
    inner: Vec<(DVec3, f64)>,
    exact: OnceLock<Vec<(DVec3, f64)>>,
}

impl Enclosure {
    pub fn new(tree: &Tree) -> Self {
        let supports: Vec<(DVec3, DVec3)> =
            spread_directions(38).map(|direction| (direction, tree.farthest(direction))).collect();
        let outer = supports.iter().map(|(direction, point)| (*direction, direction.dot(*point) + TOLERANCE)).collect();
        let extremes: Vec<DVec3> = supports.iter().map(|(_, point)| *point).collect();
        Self { outer, inner: Hull::of(&extremes).planes(TOLERANCE), exact: OnceLock::new() }
    }

    /// True if at least `needed` of the points lie in the hull of `own`, the cloud of this enclosure.
    pub fn holds(&self, points: &Tree, own: &[DVec3], needed: usize) -> bool {
        if self.inner.is_empty() && is_flat(own) {
            return false;
        }
        let outer: Vec<usize> = (0..self.outer.len()).collect();
        let inner: Vec<usize> = (0..self.inner.len()).collect();
        let mut count = Count { sure: 0, open: Vec::new(), left: points.points.len(), needed };
        self.count(points, 0, &outer, &inner, &mut count);
        if count.sure >= needed || count.sure + count.open.len() < needed {
            return count.sure >= needed;
        }
        let exact = self.exact.get_or_init(|| {
            let outside: Vec<DVec3> =
                own.iter().copied().filter(|&point| !strictly_within(&self.inner, point)).collect();
            Hull::of(&outside).planes(TOLERANCE)
        });
        count.sure + count.open.iter().filter(|&&point| within(exact, point)).count() >= needed
    }

    /// Counts the points of a node that are in the hull. `outer` are the outer planes that cross the parent's box,
    /// `inner` the inner planes not known to contain it.
    fn count(&self, tree: &Tree, index: usize, outer: &[usize], inner: &[usize], count: &mut Count) {
        if count.decided() {
            return;
        }
        let node = &tree.nodes[index];
        let (center, half) = ((node.min + node.max) * 0.5, (node.max - node.min) * 0.5);
        // Signed distance of the box's centre from a plane, and half the box's extent along the normal.
        let place = |(normal, distance): &(DVec3, f64)| (normal.dot(center) - distance, normal.abs().dot(half) + 1e-12);
        let size = node.end - node.start;
        let mut crossed = Vec::new();
        for &plane in outer {
            let (middle, reach) = place(&self.outer[plane]);
            if middle > reach {
                count.left -= size;
                return;
            }
            if middle > -reach {
                crossed.push(plane);
            }
        }
        let unknown: Vec<usize> = inner
            .iter()
            .copied()
            .filter(|&plane| {
                let (middle, reach) = place(&self.inner[plane]);
                middle > -reach
            })
            .collect();
        if unknown.is_empty() && !self.inner.is_empty() {
            count.left -= size;
            count.sure += size;
        } else if let Some((left, right)) = node.children {
            self.count(tree, left, &crossed, &unknown, count);
            self.count(tree, right, &crossed, &unknown, count);
        } else {
            let beyond = |planes: &[(DVec3, f64)], list: &[usize], point: DVec3| {
                list.iter().any(|&plane| planes[plane].0.dot(point) > planes[plane].1)
            };
            count.left -= size;
            for &point in &tree.points[node.start..node.end] {
                if beyond(&self.outer, &crossed, point) {
                    continue;
                }
                if self.inner.is_empty() || beyond(&self.inner, &unknown, point) {
                    count.open.push(point);
                } else {
                    count.sure += 1;
                }
            }
        }
    }
}

/// Intermediate state of the count.
struct Count {
    /// Points in the inner polytope.
    sure: usize,
    /// Points between the two polytopes.
    open: Vec<DVec3>,
    /// Points not yet classified.
    left: usize,
    needed: usize,
}

impl Count {
    fn decided(&self) -> bool {
        self.sure >= self.needed || self.sure + self.open.len() + self.left < self.needed
    }
}

fn within(planes: &[(DVec3, f64)], point: DVec3) -> bool {
    !planes.is_empty() && planes.iter().all(|(normal, distance)| normal.dot(point) <= *distance)
}

fn strictly_within(planes: &[(DVec3, f64)], point: DVec3) -> bool {
    !planes.is_empty() && planes.iter().all(|(normal, distance)| normal.dot(point) < *distance - 1e-9)
}

/// True if all points are coplanar within rounding.
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

/// Evenly spread directions: corners, edges and faces of a cube, and a spiral of `count` over the sphere.
pub(crate) fn spread_directions(count: usize) -> impl Iterator<Item = DVec3> {
    let cube = (0..27).filter(|index| *index != 13).map(|index| {
        DVec3::new(f64::from(index % 3 - 1), f64::from(index / 3 % 3 - 1), f64::from(index / 9 - 1)).normalize()
    });
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let spiral = (0..count).map(move |index| {
        let z = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
        let (sin, cos) = (golden * index as f64).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        DVec3::new(radius * cos, radius * sin, z)
    });
    cube.chain(spiral)
}
