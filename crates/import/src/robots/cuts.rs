//! Meshes cut by planes until the hulls of their parts leave free what a bent link leaves free.
//!
//! Every part holds the surface on its side of the cuts, so the hulls together contain the mesh, and what a closed mesh
//! encloses. A mesh with holes stays whole. A cut is at right angles to an axis of the mesh, and the one that frees the
//! most volume comes first.

use genmanip_core::Aabb;
use genmanip_core::glam::DVec3;

use super::hulls::{farthest, spread};
use crate::collision::hull::{convex_hull, volume};

/// A triangle by its corners.
pub type Triangle = [DVec3; 3];

/// Maximum number of parts of a mesh. Chosen by hand.
pub const MAX_PARTS: usize = 4;
/// Least volume that a cut frees, as a share of the hull of the mesh. Chosen by hand: more parts slow planning down.
const WORTH: f64 = 0.1;
/// Share of its hull that a closed mesh encloses and that spares the search for cuts. Chosen by hand.
const NEARLY_CONVEX: f64 = 0.9;
/// Area of the holes of a mesh that counts as closed, as a share of its surface. Chosen by hand.
const MAX_OPEN: f64 = 0.01;
/// Number of slices along an axis; cuts are between them.
const SLICES: usize = 8;
/// Number of triangles and of directions from which the volume of hulls is estimated, for a bounded time.
const SAMPLED: usize = 1000;
const DIRECTIONS: usize = 48;

/// Plane at right angles to an axis.
#[derive(Clone, Copy)]
struct Plane {
    axis: usize,
    at: f64,
}

/// Parts of a mesh: the mesh itself, unless it is closed and cuts free enough of its hull.
pub fn parts(mesh: Vec<Triangle>) -> Vec<Vec<Triangle>> {
    let directions = spread(DIRECTIONS);
    let whole = estimate(&sampled(&mesh).concat(), &directions);
    if enclosed(&mesh).is_none_or(|volume| volume > NEARLY_CONVEX * whole) {
        return vec![mesh];
    }
    let first = best_cut(&mesh, &directions);
    let mut parts = vec![(mesh, first)];
    while parts.len() < MAX_PARTS {
        let gain = |(_, cut): &(_, Option<(f64, Plane)>)| cut.map_or(0.0, |(freed, _)| freed);
        let Some(next) = (0..parts.len()).max_by(|&a, &b| gain(&parts[a]).total_cmp(&gain(&parts[b]))) else { break };
        let Some((freed, plane)) = parts[next].1 else { break };
        if freed < WORTH * whole {
            break;
        }
        let (mesh, _) = parts.swap_remove(next);
        for side in [-1.0, 1.0] {
            let half: Vec<Triangle> = mesh.iter().flat_map(|triangle| beyond(triangle, plane, side)).collect();
            let cut = best_cut(&half, &directions);
            parts.push((half, cut));
        }
    }
    parts.into_iter().map(|(mesh, _)| mesh).collect()
}

/// Volume that a mesh encloses, m³; `None` for an open surface or points, whose hull is all that is known.
fn enclosed(mesh: &[Triangle]) -> Option<f64> {
    let &[origin, ..] = mesh.first()?;
    let (mut volume, mut area, mut open) = (0.0, 0.0, DVec3::ZERO);
    for triangle in mesh {
        let [a, b, c] = triangle.map(|corner| corner - origin);
        let normal = (b - a).cross(c - a);
        volume += a.dot(normal) / 6.0;
        area += normal.length();
        open += normal;
    }
    // The area vectors of a closed surface add up to nothing.
    (area > 0.0 && open.length() < MAX_OPEN * area).then(|| volume.abs())
}

/// Evenly many of the triangles, at most [`SAMPLED`].
fn sampled(mesh: &[Triangle]) -> Vec<Triangle> {
    mesh.iter().step_by(mesh.len().div_ceil(SAMPLED).max(1)).copied().collect()
}

/// The cut that frees the most volume, with that volume, m³; `None` if no cut frees any.
fn best_cut(mesh: &[Triangle], directions: &[DVec3]) -> Option<(f64, Plane)> {
    let sample = sampled(mesh);
    let bounds = Aabb::from_points(sample.iter().flatten().copied());
    let mut best: Option<(f64, Plane)> = None;
    for axis in 0..3 {
        let plane =
            |slice: usize| Plane { axis, at: bounds.min[axis] + bounds.size()[axis] * slice as f64 / SLICES as f64 };
        // Extreme points of the surface between neighbouring planes; hulls of several slices follow from them.
        let slices: Vec<Vec<DVec3>> = (0..SLICES)
            .map(|slice| {
                let above = sample.iter().flat_map(|triangle| beyond(triangle, plane(slice), 1.0));
                let between = above.flat_map(|triangle| beyond(&triangle, plane(slice + 1), -1.0));
                extremes(&between.flatten().collect::<Vec<_>>(), directions)
            })
            .collect();
        let whole = estimate(&slices.concat(), directions);
        for cut in 1..SLICES {
            let [below, above] = [&slices[..cut], &slices[cut..]].map(|side| estimate(&side.concat(), directions));
            let freed = whole - below - above;
            if freed > best.map_or(0.0, |(freed, _)| freed) {
                best = Some((freed, plane(cut)));
            }
        }
    }
    best
}

/// The part of a triangle on one side of a plane, `side` being −1 or 1, as triangles.
fn beyond(triangle: &Triangle, plane: Plane, side: f64) -> impl Iterator<Item = Triangle> + use<> {
    let height = triangle.map(|corner| side * (corner[plane.axis] - plane.at));
    let (mut polygon, mut count) = ([DVec3::ZERO; 4], 0);
    let mut push = |corner| {
        polygon[count] = corner;
        count += 1;
    };
    for (index, &corner) in triangle.iter().enumerate() {
        let next = (index + 1) % 3;
        if height[index] >= 0.0 {
            push(corner);
        }
        if height[index] * height[next] < 0.0 {
            push(corner + (triangle[next] - corner) * (height[index] / (height[index] - height[next])));
        }
    }
    (2..count).map(move |index| [polygon[0], polygon[index - 1], polygon[index]])
}

/// Farthest points along the directions.
fn extremes(points: &[DVec3], directions: &[DVec3]) -> Vec<DVec3> {
    if points.is_empty() {
        return Vec::new();
    }
    directions.iter().map(|along| farthest(points, *along)).collect()
}

/// Volume of the hull of the farthest points, m³: at most that of the hull.
fn estimate(points: &[DVec3], directions: &[DVec3]) -> f64 {
    convex_hull(&extremes(points, directions)).map_or(0.0, |(corners, triangles)| volume(&corners, &triangles))
}
