//! Sphere covers of convex bodies, tested by the fast path instead of the body.
//!
//! The cover is conservative: every point of the body is in a sphere, so clear spheres prove that the body is clear.
//! Otherwise the exact body decides.

use glam::DVec3;

use super::convex::{Ball, Convex, Core};
use crate::hull::convex_hull;

/// Maximum overhang of a sphere before it is split: half of the body's thickness, within these bounds (m).
const OVERHANG: [f64; 2] = [0.008, 0.025];
/// Maximum split depth per body: 2^3 spheres.
const DEPTH: usize = 3;

/// A cover sphere with an inscribed radius.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CoverBall {
    pub(crate) ball: Ball,
    /// Radius around the centre that is certainly inside the body (m); 0 if the centre is outside.
    pub(crate) inner: f64,
}

/// Computes the cover of a body, in its owner's frame.
pub(crate) fn cover(body: &Convex) -> Vec<CoverBall> {
    let mut balls = Vec::new();
    split(corners(&body.core), body.radius, DEPTH, &mut balls);
    let placed = |ball: Ball| {
        let inner = (depth_in(&body.core, ball.center) + body.radius).max(0.0);
        CoverBall { ball: Ball { center: body.owner_from_core.point(ball.center), ..ball }, inner }
    };
    balls.into_iter().map(placed).collect()
}

/// Lower bound on the depth of a point inside the core (m); not positive outside.
fn depth_in(core: &Core, point: DVec3) -> f64 {
    match core {
        Core::Point => -point.length(),
        Core::Segment(half_length) => -point.distance(DVec3::Z * point.z.clamp(-half_length, *half_length)),
        Core::Box(half) => (*half - point.abs()).min_element(),
        Core::Cylinder { radius, half_height } => (radius - point.truncate().length()).min(half_height - point.z.abs()),
        // Depth in the unit sphere after scaling by 1 / radii; scaled back, it is at least this.
        Core::Ellipsoid(radii) => (1.0 - (point / *radii).length()) * radii.min_element(),
        Core::Hull { corners, .. } => depth_in_hull(corners, point),
    }
}

fn depth_in_hull(corners: &[DVec3], point: DVec3) -> f64 {
    let Ok((corners, triangles)) = convex_hull(corners) else { return f64::NEG_INFINITY };
    let depth = |triangle: [u32; 3]| {
        let [a, b, c] = triangle.map(|index| corners[index as usize]);
        (b - a).cross(c - a).try_normalize().map_or(f64::INFINITY, |outward| outward.dot(a - point))
    };
    triangles.into_iter().map(depth).fold(f64::INFINITY, f64::min) - 1e-6
}

/// Vertices of a polyhedron that contains the core.
pub(super) fn corners(core: &Core) -> Vec<DVec3> {
    const SIDES: usize = 16;
    let prism = |radius: f64, half_height: f64| {
        // The polygon is circumscribed, so that it contains the circle.
        let outer = radius / (std::f64::consts::PI / SIDES as f64).cos();
        let corner = move |side: usize, z: f64| {
            let (sin, cos) = (std::f64::consts::TAU * side as f64 / SIDES as f64).sin_cos();
            DVec3::new(outer * cos, outer * sin, z)
        };
        (0..SIDES).flat_map(|side| [corner(side, -half_height), corner(side, half_height)]).collect::<Vec<_>>()
    };
    let signs = || [-1.0, 1.0].into_iter();
    let cuboid = |half: DVec3| -> Vec<DVec3> {
        let corner = |(x, y, z)| half * DVec3::new(x, y, z);
        signs().flat_map(|x| signs().flat_map(move |y| signs().map(move |z| (x, y, z)))).map(corner).collect()
    };
    match core {
        Core::Point => vec![DVec3::ZERO],
        Core::Segment(half_length) => vec![DVec3::Z * *half_length, DVec3::NEG_Z * *half_length],
        Core::Box(half) => cuboid(*half),
        Core::Cylinder { radius, half_height } => prism(*radius, *half_height),
        // Three slabs of prisms bound an ellipsoid more tightly than its box.
        Core::Ellipsoid(radii) => {
            let slab = |low: f64, high: f64| {
                let widest = if low < 0.0 && high > 0.0 { 0.0 } else { low.abs().min(high.abs()) };
                let scale = (1.0 - widest * widest).sqrt();
                prism(scale, 1.0)
                    .into_iter()
                    .map(move |corner| DVec3::new(corner.x, corner.y, if corner.z < 0.0 { low } else { high }) * *radii)
            };
            slab(-1.0, -0.5).chain(slab(-0.5, 0.5)).chain(slab(0.5, 1.0)).collect()
        }
        Core::Hull { corners, .. } => corners.clone(),
    }
}

fn split(corners: Vec<DVec3>, rounding: f64, depth: usize, balls: &mut Vec<Ball>) {
    let bounds = genmanip_core::Aabb::from_points(corners.iter().copied());
    let (center, size) = (bounds.center(), bounds.size());
    let radius = corners.iter().map(|corner| corner.distance(center)).fold(0.0, f64::max);
    let half = 0.5 * size.min_element();
    if depth == 0 || radius - half <= (0.5 * (half + rounding)).clamp(OVERHANG[0], OVERHANG[1]) {
        balls.push(Ball { center, radius: radius + rounding });
        return;
    }
    let axis = match size.max_position() {
        0 => DVec3::X,
        1 => DVec3::Y,
        _ => DVec3::Z,
    };
    let cut = center.dot(axis);
    let (mut low, mut high): (Vec<DVec3>, Vec<DVec3>) = corners.iter().partition(|corner| corner.dot(axis) < cut);
    // Every edge across the cut joins a vertex below to one above, so the crossings of all such pairs include the cut's
    // corners.
    let mut crossings = Vec::with_capacity(low.len() * high.len());
    for a in &low {
        for b in &high {
            let t = (cut - a.dot(axis)) / (b.dot(axis) - a.dot(axis));
            crossings.push(a.lerp(*b, t));
        }
    }
    low.extend_from_slice(&crossings);
    high.extend(crossings);
    split(extreme(low), rounding, depth - 1, balls);
    split(extreme(high), rounding, depth - 1, balls);
}

/// Reduces more than 32 points to the vertices of their hull.
fn extreme(points: Vec<DVec3>) -> Vec<DVec3> {
    if points.len() <= 32 {
        return points;
    }
    convex_hull(&points).map_or(points, |(corners, _)| corners)
}
