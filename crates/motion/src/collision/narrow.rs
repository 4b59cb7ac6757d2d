//! SIMD narrow phase: vertices of a convex body against bounding primitives of an obstacle, eight states at a time.
//!
//! Frank-Wolfe steps (M. Frank and P. Wolfe, *An algorithm for quadratic programming*, 1956) move a point of the body
//! towards the obstacle. At every step a close point proves contact, and the direction to the obstacle proves clearance
//! if all vertices are far enough along it; the exact check decides the rest.

use genmanip_core::Pose;
use glam::DVec3;

use super::convex::{Convex, Core, Separation, separation};
use super::cover::corners;
use super::fast_piece::FastPiece;
use super::lane_geometry::{LaneFrame, Point, ROUNDING, add, dot, place, scale, subtract};
use super::lanes::{LANES, Lanes, Verdict};
use crate::rigid::Rigid;

/// Maximum number of Frank-Wolfe steps before the exact check. Chosen by hand.
const STEPS: usize = 5;
/// Number of vertices above which hulls are simplified. Chosen by hand.
const MAX_VERTICES: usize = 32;
/// Maximum simplification error (m). Chosen by hand.
const MAX_ERROR_M: f64 = 0.0015;

/// Simplified vertices of a convex body, in its owner's frame.
#[derive(Clone, Debug)]
pub(crate) struct Skeleton {
    corners: Vec<[f32; 3]>,
    pub(super) center: [f32; 3],
    /// Radius of the bounding sphere around `center` (m).
    pub(super) ball_radius: f32,
    /// The body contains everything within this distance of the vertices' hull (m); negative if even the hull exceeds
    /// the body.
    inner: f32,
    /// The body is within this distance of the vertices' hull (m).
    outer: f32,
}

impl Skeleton {
    pub(crate) fn new(body: &Convex) -> Self {
        let (corners, slack) = match &body.core {
            Core::Hull { corners, .. } if corners.len() > MAX_VERTICES => simplified(corners),
            // Vertices on the cylinder's rims, instead of those of the circumscribed 16-gon that `corners` returns.
            Core::Cylinder { radius, .. } => {
                let shrink = (std::f64::consts::PI / 16.0).cos();
                let inside = |corner: DVec3| DVec3::new(corner.x * shrink, corner.y * shrink, corner.z);
                (corners(&body.core).into_iter().map(inside).collect(), radius * (1.0 - shrink))
            }
            core => (corners(core), 0.0),
        };
        let corners: Vec<DVec3> = corners.iter().map(|corner| body.owner_from_core.point(*corner)).collect();
        let inner = if matches!(body.core, Core::Ellipsoid(_)) { -1.0 } else { body.radius as f32 };
        // The mean of the vertices is inside, unlike possibly the centre of the bounding sphere.
        let center = corners.iter().sum::<DVec3>() / corners.len().max(1) as f64;
        let reach = corners.iter().map(|corner| corner.distance(center)).fold(0.0, f64::max);
        Self {
            corners: corners.iter().map(|corner| corner.as_vec3().to_array()).collect(),
            center: center.as_vec3().to_array(),
            ball_radius: (reach + body.radius + slack) as f32 + ROUNDING,
            inner,
            outer: (body.radius + slack) as f32,
        }
    }

    /// Compares with an obstacle piece in the given lanes: clear beyond `accept`, touching within `reject` (never if
    /// negative).
    #[inline(always)]
    pub(super) fn compare(
        &self,
        piece: &FastPiece,
        core_from_body: &LaneFrame,
        accept: f32,
        reject: f32,
        lanes: u8,
    ) -> Verdict {
        let clear_reach = Lanes::all(accept + self.outer + piece.rounding + ROUNDING);
        let certain = self.inner >= 0.0 && reject >= 0.0 && piece.exact;
        let touch = if certain { reject + self.inner + piece.rounding - ROUNDING } else { -1.0 };
        let touch_squared = Lanes::all(if touch > 0.0 { touch * touch } else { -1.0 });
        let mut point = place(core_from_body, self.center);
        let mut open = lanes;
        for step in 0..STEPS {
            let nearest = piece.nearest(&point);
            let away = subtract(point, nearest);
            let squared = dot(away, away);
            let touching = open & (squared - touch_squared).not_positive();
            if touching != 0 {
                return Verdict { touching, undecided: 0 };
            }
            let [x, y, z] = core_from_body.columns;
            let direction = [dot(x, away), dot(y, away), dot(z, away)];
            let (lowest, corner) = self.lowest(&direction);
            let along = lowest + dot(core_from_body.origin, away) - dot(nearest, away);
            let needed = squared.sqrt() * clear_reach;
            open &= !(needed - along).negative();
            if open == 0 || step + 1 == STEPS {
                break;
            }
            let corner =
                add(add(scale(x, corner[0]), scale(y, corner[1])), add(scale(z, corner[2]), core_from_body.origin));
            let edge = subtract(corner, point);
            let part = dot(away, edge).over(dot(edge, edge).max(1e-12) * -1.0).clamp(0.0, 1.0);
            point = add(point, scale(edge, part));
        }
        Verdict { touching: 0, undecided: open }
    }

    /// Support vertex opposite to `direction` (body frame) and its projection, per lane.
    #[inline(always)]
    fn lowest(&self, direction: &Point) -> (Lanes, Point) {
        let mut best = Lanes::all(f32::MAX);
        let mut lowest = Lanes::all(0.0);
        let mut index = 0.0;
        for &[x, y, z] in &self.corners {
            let along = direction[0] * x + direction[1] * y + direction[2] * z;
            lowest = along.below(best).pick(Lanes::all(index), lowest);
            best = along.lower(best);
            index += 1.0;
        }
        let mut chosen = [[0.0; LANES]; 3];
        for (lane, index) in lowest.to_array().into_iter().enumerate() {
            let corner = self.corners.get(index as usize).unwrap_or(&self.center);
            for (row, value) in chosen.iter_mut().zip(corner) {
                row[lane] = *value;
            }
        }
        let [x, y, z] = chosen;
        (best, [Lanes::from_array(x), Lanes::from_array(y), Lanes::from_array(z)])
    }
}

/// Simplified vertices, and how far the full hull extends beyond the hull of these (m).
fn simplified(all: &[DVec3]) -> (Vec<DVec3>, f64) {
    let mut kept: Vec<DVec3> = Vec::new();
    for x in -1..=1 {
        for y in -1..=1 {
            for z in -1..=1 {
                let direction = DVec3::new(f64::from(x), f64::from(y), f64::from(z));
                let along = |corner: &&DVec3| corner.dot(direction);
                if let Some(corner) = all.iter().max_by(|a, b| along(a).total_cmp(&along(b)))
                    && !kept.contains(corner)
                {
                    kept.push(*corner);
                }
            }
        }
    }
    loop {
        let Some(hull) = hull(&kept) else { return (all.to_vec(), 0.0) };
        let beyond: Vec<f64> = all.iter().map(|corner| distance_to(&hull, *corner)).collect();
        let worst = beyond.iter().copied().fold(0.0, f64::max);
        if worst <= MAX_ERROR_M || kept.len() >= all.len() {
            return (kept, worst + 1e-6);
        }
        let before = kept.len();
        // Vertices farthest outside are added first; others of the same round must be well away from them.
        let mut order: Vec<usize> = (0..all.len()).filter(|index| beyond[*index] > 0.6 * worst).collect();
        order.sort_by(|a, b| beyond[*b].total_cmp(&beyond[*a]));
        for index in order {
            if kept[before..].iter().all(|other| other.distance(all[index]) > 0.02) {
                kept.push(all[index]);
            }
        }
    }
}

fn hull(corners: &[DVec3]) -> Option<Convex> {
    let shape = genmanip_core::Shape::Hull { points: corners.to_vec() };
    Convex::new("", 0, &genmanip_core::Piece { shape, link_from_piece: Pose::IDENTITY }).ok()
}

fn distance_to(hull: &Convex, point: DVec3) -> f64 {
    let ball = super::convex::Ball { center: DVec3::ZERO, radius: 0.0 };
    let dot = Convex { core: Core::Point, radius: 0.0, owner_from_core: Rigid::IDENTITY, ball };
    let place = Rigid { translation: point, ..Rigid::IDENTITY };
    match separation(hull, &dot, &Rigid::IDENTITY, &place, 1.0) {
        Separation::Within(distance) => distance.max(0.0),
        Separation::Beyond => f64::INFINITY,
    }
}
