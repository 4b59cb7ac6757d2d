//! Exact convex bodies: a core rounded by a radius, and the distance between two of them.

use genmanip_core::{Piece, Shape};
use glam::{DQuat, DVec3};
use parry3d_f64::math::{Pose as ParryPose, Rot3, Vector};
use parry3d_f64::query::epa::EPA;
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SupportMap;

use crate::hull::convex_hull;
use crate::rigid::Rigid;

/// Error in a collision piece.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("collision piece {index} of {owner}: {what}")]
pub struct GeometryError {
    /// Name of the object or link.
    pub owner: String,
    /// Index of the invalid collision piece.
    pub index: usize,
    /// Description of the problem.
    pub what: String,
}

/// A convex body at its pose in a link or object.
#[derive(Clone, Debug)]
pub(crate) struct Convex {
    pub(crate) core: Core,
    /// Rounding radius around the core (m).
    pub(crate) radius: f64,
    pub(crate) owner_from_core: Rigid,
    /// Bounding sphere, owner frame.
    pub(crate) ball: Ball,
}

/// Bounding sphere, or any other sphere; all lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ball {
    pub(crate) center: DVec3,
    pub(crate) radius: f64,
}

impl Ball {
    /// Bounding sphere of spheres: centred in their bounds, not minimal.
    pub(crate) fn around(balls: impl Iterator<Item = Self> + Clone) -> Self {
        let bounds = balls.clone().fold(genmanip_core::Aabb::EMPTY, |bounds, ball| {
            bounds.including(ball.center - DVec3::splat(ball.radius)).including(ball.center + DVec3::splat(ball.radius))
        });
        let center = bounds.center();
        let radius = balls.map(|ball| ball.center.distance(center) + ball.radius).fold(0.0, f64::max);
        Self { center: if center.is_finite() { center } else { DVec3::ZERO }, radius }
    }

    /// Transforms the sphere to an outer frame.
    #[inline]
    pub(super) fn moved(&self, outer_from_inner: &Rigid) -> Self {
        Self { center: outer_from_inner.point(self.center), radius: self.radius }
    }

    /// True if two spheres certainly keep `margin` (m); a negative margin counts as 0.
    #[inline]
    pub(super) fn is_apart(&self, other: &Self, margin: f64) -> bool {
        let reach = self.radius + other.radius + margin.max(0.0);
        self.center.distance_squared(other.center) > reach * reach
    }
}

#[derive(Clone, Debug)]
pub(crate) enum Core {
    Point,
    /// Segment along z of this half length (m).
    Segment(f64),
    Box(DVec3),
    Cylinder {
        radius: f64,
        half_height: f64,
    },
    Ellipsoid(DVec3),
    /// Vertices, centre and half extents of their bounds, and for large hulls the neighbours of each vertex.
    Hull {
        corners: Vec<DVec3>,
        center: DVec3,
        half: DVec3,
        neighbors: Vec<Vec<u32>>,
    },
}

impl Convex {
    /// Compiles all pieces of a link or object.
    pub(crate) fn all(owner: &str, pieces: &[Piece]) -> Result<Vec<Self>, GeometryError> {
        pieces.iter().enumerate().map(|(index, piece)| Self::new(owner, index, piece)).collect()
    }

    pub(crate) fn new(owner: &str, index: usize, piece: &Piece) -> Result<Self, GeometryError> {
        let bad = |what: String| Err(GeometryError { owner: owner.to_owned(), index, what });
        let positive = |values: &[f64]| values.iter().all(|value| value.is_finite() && *value > 0.0);
        let (core, radius, sizes) = match &piece.shape {
            Shape::Box { half_extents } => (Core::Box(*half_extents), 0.0, half_extents.to_array().to_vec()),
            Shape::Sphere { radius } => (Core::Point, *radius, vec![*radius]),
            Shape::Ellipsoid { radii } => (Core::Ellipsoid(*radii), 0.0, radii.to_array().to_vec()),
            Shape::Cylinder { radius, half_height } => {
                let core = Core::Cylinder { radius: *radius, half_height: *half_height };
                (core, 0.0, vec![*radius, *half_height])
            }
            Shape::Capsule { radius, half_length } => (Core::Segment(*half_length), *radius, vec![*radius]),
            Shape::Hull { points } => {
                if points.len() < 4 || !points.iter().all(|point| point.is_finite()) {
                    return bad(format!("a hull needs at least 4 finite vertices, got {}", points.len()));
                }
                (Core::hull(points.clone()), 0.0, vec![])
            }
        };
        if !positive(&sizes) {
            return bad(format!("sizes must be positive and finite, got {:?}", piece.shape));
        }
        let pose = &piece.link_from_piece;
        if !(pose.position.is_finite() && pose.rotation.is_finite()) {
            return bad("its pose is not finite".into());
        }
        let owner_from_core = Rigid::from(pose);
        let center = core.center();
        let ball = Ball { center: owner_from_core.point(center), radius: core.bound_about(center) + radius };
        Ok(Self { core, radius, owner_from_core, ball })
    }

    /// Support point along a direction, owner frame.
    pub(crate) fn support(&self, direction: DVec3) -> DVec3 {
        let local = self.owner_from_core.rotation.transpose() * direction;
        self.owner_from_core.point(self.core.farthest(local)) + direction.normalize_or_zero() * self.radius
    }
}

impl Core {
    fn hull(corners: Vec<DVec3>) -> Self {
        let bounds = genmanip_core::Aabb::from_points(corners.iter().copied());
        let (corners, neighbors) = if corners.len() < LARGE_HULL { (corners, vec![]) } else { with_neighbors(corners) };
        Self::Hull { corners, center: bounds.center(), half: bounds.size() * 0.5, neighbors }
    }

    fn center(&self) -> DVec3 {
        if let Self::Hull { center, .. } = self { *center } else { DVec3::ZERO }
    }

    /// Lower bound on the distance of a point to the core (m), exact except for hulls and ellipsoids (distance to their
    /// box); 0 inside.
    pub(crate) fn distance_bound(&self, point: DVec3) -> f64 {
        self.nearest(point).distance(point)
    }

    /// Closest point of the core, or of the bounding box for hulls and ellipsoids.
    fn nearest(&self, point: DVec3) -> DVec3 {
        match self {
            Self::Point => DVec3::ZERO,
            Self::Segment(half_length) => DVec3::new(0.0, 0.0, point.z.clamp(-half_length, *half_length)),
            Self::Box(half) | Self::Ellipsoid(half) => point.clamp(-*half, *half),
            Self::Cylinder { radius, half_height } => {
                let across = point.truncate().clamp_length_max(*radius);
                across.extend(point.z.clamp(-half_height, *half_height))
            }
            Self::Hull { center, half, .. } => point.clamp(*center - *half, *center + *half),
        }
    }

    /// True if `distance_bound` is exact.
    pub(super) fn nearest_is_exact(&self) -> bool {
        !matches!(self, Self::Hull { .. } | Self::Ellipsoid(_))
    }

    fn bound_about(&self, center: DVec3) -> f64 {
        match self {
            Self::Point => 0.0,
            Self::Segment(half_length) => *half_length,
            Self::Box(half_extents) => half_extents.length(),
            Self::Cylinder { radius, half_height } => radius.hypot(*half_height),
            Self::Ellipsoid(radii) => radii.max_element(),
            Self::Hull { corners, .. } => corners.iter().map(|point| point.distance(center)).fold(0.0, f64::max),
        }
    }
}

impl Core {
    /// Support point along a direction.
    fn farthest(&self, direction: DVec3) -> DVec3 {
        match self {
            Self::Point => DVec3::ZERO,
            Self::Segment(half_length) => DVec3::new(0.0, 0.0, half_length.copysign(direction.z)),
            Self::Box(half) => {
                DVec3::new(half.x.copysign(direction.x), half.y.copysign(direction.y), half.z.copysign(direction.z))
            }
            Self::Cylinder { radius, half_height } => {
                let across = direction.x.hypot(direction.y);
                let scale = if across > 0.0 { radius / across } else { 0.0 };
                DVec3::new(direction.x * scale, direction.y * scale, half_height.copysign(direction.z))
            }
            Self::Ellipsoid(radii) => *radii * (*radii * direction).normalize_or_zero(),
            Self::Hull { corners, neighbors, .. } if neighbors.is_empty() => {
                let mut best = (f64::NEG_INFINITY, DVec3::ZERO);
                for corner in corners {
                    let along = corner.dot(direction);
                    if along > best.0 {
                        best = (along, *corner);
                    }
                }
                best.1
            }
            Self::Hull { corners, neighbors, .. } => hill_climb(corners, neighbors, direction),
        }
    }
}

/// Number of vertices from which support points are found by hill climbing.
const LARGE_HULL: usize = 40;

/// Hull vertices and their neighbours; no neighbours if the hull cannot be triangulated.
fn with_neighbors(points: Vec<DVec3>) -> (Vec<DVec3>, Vec<Vec<u32>>) {
    let Ok((corners, triangles)) = convex_hull(&points) else { return (points, vec![]) };
    let mut neighbors = vec![Vec::new(); corners.len()];
    for [a, b, c] in triangles {
        for (from, to) in [(a, b), (b, c), (c, a), (b, a), (c, b), (a, c)] {
            let known: &mut Vec<u32> = &mut neighbors[from as usize];
            if !known.contains(&to) {
                known.push(to);
            }
        }
    }
    (corners, neighbors)
}

/// Hill climbing along edges; on a convex hull a local maximum is global.
fn hill_climb(corners: &[DVec3], neighbors: &[Vec<u32>], direction: DVec3) -> DVec3 {
    // Of several spread vertices the best is the start, which shortens the walk.
    let stride = corners.len().div_ceil(12);
    let mut best = (f64::NEG_INFINITY, 0);
    for index in (0..corners.len()).step_by(stride) {
        let along = corners[index].dot(direction);
        if along > best.0 {
            best = (along, index);
        }
    }
    loop {
        let here = best.1;
        for &next in &neighbors[here] {
            let along = corners[next as usize].dot(direction);
            if along > best.0 {
                best = (along, next as usize);
            }
        }
        if best.1 == here {
            return corners[here];
        }
    }
}

/// parry uses a different version of glam, so vectors are converted component by component.
impl SupportMap for Core {
    fn local_support_point(&self, direction: Vector) -> Vector {
        Vector::from_array(self.farthest(DVec3::from_array(direction.to_array())).to_array())
    }
}

/// Distance query result, up to a limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Separation {
    /// Farther than the limit.
    Beyond,
    /// At this distance; negative is penetration depth.
    Within(f64),
}

impl Separation {
    /// The smaller of two distances.
    #[inline]
    pub(super) fn nearer(self, other: Self) -> Self {
        match (self, other) {
            (Self::Within(a), Self::Within(b)) => Self::Within(a.min(b)),
            (Self::Beyond, found) | (found, Self::Beyond) => found,
        }
    }
}

/// True if `b` is closer than `margin` (m) to `a`.
pub(crate) fn closer_than(a: &Convex, b: &Convex, world_from_a: &Rigid, world_from_b: &Rigid, margin: f64) -> bool {
    let pose = core_from_core(a, b, world_from_a, world_from_b);
    cores_closer_than(&pose, &a.core, &b.core, margin + a.radius + b.radius)
}

/// True if core `b` is closer than `reach` (m) to core `a`.
pub(super) fn cores_closer_than(a_from_b: &ParryPose, a: &Core, b: &impl SupportMap, reach: f64) -> bool {
    let mut simplex = first_simplex(a_from_b, a, b);
    match gjk::closest_points(a_from_b, a, b, reach.max(0.0), false, &mut simplex) {
        GJKResult::NoIntersection(direction) => !separated(a_from_b, a, b, direction, reach),
        _ => true,
    }
}

/// Fast, inconclusive version of `closer_than` with one support point of `b`; `None` if undecided.
///
/// The direction from obstacle `a` to the centre of `b` often separates them. If the support point of `b` against this
/// direction is within the margin, they are too close.
pub(crate) fn try_closer_than(
    a: &Convex,
    b: &Convex,
    core_from_world: &Rigid,
    world_from_b: &Rigid,
    margin: f64,
) -> Option<bool> {
    let reach = margin + a.radius;
    let middle = core_from_world.point(world_from_b.point(b.ball.center));
    let nearest = a.core.nearest(middle);
    let outward = (middle - nearest).try_normalize()?;
    let inward_of_b = world_from_b.rotation.transpose() * (core_from_world.rotation.transpose() * -outward);
    let deepest = core_from_world.point(world_from_b.point(b.support(inward_of_b)));
    if outward.dot(deepest - nearest) > reach {
        return Some(false);
    }
    (a.core.nearest_is_exact() && a.core.distance_bound(deepest) < reach).then_some(true)
}

/// Distance of two bodies if it is at most `limit`, with penetration depth.
pub(crate) fn separation(a: &Convex, b: &Convex, world_from_a: &Rigid, world_from_b: &Rigid, limit: f64) -> Separation {
    let pose = core_from_core(a, b, world_from_a, world_from_b);
    cores_separation(&pose, &a.core, &b.core, a.radius + b.radius, limit)
}

/// Like `separation`, for two cores with a total rounding radius.
pub(super) fn cores_separation(
    a_from_b: &ParryPose,
    a: &Core,
    b: &impl SupportMap,
    rounding: f64,
    limit: f64,
) -> Separation {
    let mut simplex = first_simplex(a_from_b, a, b);
    match gjk::closest_points(a_from_b, a, b, (limit + rounding).max(0.0), true, &mut simplex) {
        GJKResult::ClosestPoints(p, q, _) => {
            let distance = p.distance(q) - rounding;
            if distance > limit { Separation::Beyond } else { Separation::Within(distance) }
        }
        GJKResult::NoIntersection(direction) if separated(a_from_b, a, b, direction, limit + rounding) => {
            Separation::Beyond
        }
        _ => {
            let depth = EPA::new()
                .closest_points(a_from_b, a, b, &simplex)
                .map_or(0.0, |(p, q, normal)| (q - p).dot(normal).min(0.0));
            Separation::Within(depth - rounding)
        }
    }
}

/// GJK reports "far apart" when it runs out of iterations, so the result is verified with a separating direction.
fn separated(pose: &ParryPose, a: &Core, b: &impl SupportMap, direction: Vector, reach: f64) -> bool {
    -direction.dot(CsoPoint::from_shapes(pose, a, b, direction).point) > reach
}

fn first_simplex(pose: &ParryPose, a: &Core, b: &impl SupportMap) -> VoronoiSimplex {
    let mut simplex = VoronoiSimplex::new();
    let direction = pose.translation.try_normalize().unwrap_or(Vector::X);
    simplex.reset(CsoPoint::from_shapes(pose, a, b, direction));
    simplex
}

fn core_from_core(a: &Convex, b: &Convex, world_from_a: &Rigid, world_from_b: &Rigid) -> ParryPose {
    let (world_from_a, world_from_b) = (*world_from_a * a.owner_from_core, *world_from_b * b.owner_from_core);
    let relative = world_from_a.inverse() * world_from_b;
    let rotation = DQuat::from_mat3(&relative.rotation).to_array();
    ParryPose::from_parts(Vector::from_array(relative.translation.to_array()), Rot3::from_array(rotation))
}
