//! Convex collision geometry.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Pose;

/// A convex shape centred in its own frame; a primitive or hull that the physics engine represents exactly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Shape {
    /// Axis-aligned box.
    Box {
        /// Half extent along each axis, m.
        #[schemars(with = "[f64; 3]")]
        half_extents: DVec3,
    },
    /// Ball.
    Sphere {
        /// Radius, m.
        radius: f64,
    },
    /// Axis-aligned ellipsoid.
    Ellipsoid {
        /// Semi-axes along x, y and z, m.
        #[schemars(with = "[f64; 3]")]
        radii: DVec3,
    },
    /// Flat-ended cylinder along z.
    Cylinder {
        /// Radius, m.
        radius: f64,
        /// Half height, m.
        half_height: f64,
    },
    /// Round-ended cylinder along z.
    Capsule {
        /// Radius of the tube and of the caps, m.
        radius: f64,
        /// Half distance between the centres of the caps, m.
        half_length: f64,
    },
    /// Convex hull of points.
    Hull {
        /// Vertices, m, unordered, not coplanar.
        #[schemars(with = "Vec<[f64; 3]>")]
        points: Vec<DVec3>,
    },
}

/// One convex piece of a link, posed in the link's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Piece {
    /// Convex shape in the piece's own frame.
    pub shape: Shape,
    /// Pose of the piece in the link's frame.
    pub link_from_piece: Pose,
}

impl Piece {
    /// A shape placed without rotation.
    pub fn at(position: DVec3, shape: Shape) -> Self {
        Self { shape, link_from_piece: Pose::from_position(position) }
    }

    /// Support point along `direction`, both in the link's frame.
    pub fn support(&self, direction: DVec3) -> DVec3 {
        let local = self.link_from_piece.rotation.inverse() * direction;
        self.link_from_piece.transform_point(self.shape.support(local))
    }
}

impl Shape {
    /// Support point of the shape along `direction`, which need not be normalised.
    pub fn support(&self, direction: DVec3) -> DVec3 {
        let sign = |value: f64| if value < 0.0 { -1.0 } else { 1.0 };
        match self {
            Self::Box { half_extents } => {
                *half_extents * DVec3::new(sign(direction.x), sign(direction.y), sign(direction.z))
            }
            Self::Sphere { radius } => direction.normalize_or_zero() * *radius,
            Self::Ellipsoid { radii } => {
                let scaled = *radii * direction;
                *radii * scaled.normalize_or_zero()
            }
            Self::Cylinder { radius, half_height } => {
                let flat = DVec3::new(direction.x, direction.y, 0.0).normalize_or_zero() * *radius;
                flat + DVec3::Z * (sign(direction.z) * *half_height)
            }
            Self::Capsule { radius, half_length } => {
                direction.normalize_or_zero() * *radius + DVec3::Z * (sign(direction.z) * *half_length)
            }
            Self::Hull { points } => points
                .iter()
                .copied()
                .max_by(|a, b| a.dot(direction).total_cmp(&b.dot(direction)))
                .unwrap_or(DVec3::ZERO),
        }
    }

    /// Radius of the bounding sphere about the origin of the shape's frame.
    pub fn bounding_radius(&self) -> f64 {
        match self {
            Self::Box { half_extents } => half_extents.length(),
            Self::Sphere { radius } => *radius,
            Self::Ellipsoid { radii } => radii.max_element(),
            Self::Cylinder { radius, half_height } => radius.hypot(*half_height),
            Self::Capsule { radius, half_length } => radius + half_length,
            Self::Hull { points } => points.iter().map(|point| point.length()).fold(0.0, f64::max),
        }
    }
}

/// Axis-aligned bounding box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Aabb {
    /// Corner with the smallest x, y and z.
    #[schemars(with = "[f64; 3]")]
    pub min: DVec3,
    /// Corner with the largest x, y and z.
    #[schemars(with = "[f64; 3]")]
    pub max: DVec3,
}

impl Aabb {
    /// Bounds of nothing: contain no point, and grow with [`Aabb::including`].
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// Bounds of points; [`Aabb::EMPTY`] for none.
    pub fn from_points(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |bounds, point| bounds.including(point))
    }

    /// Exact bounds of pieces transformed by a pose, e.g. `world_from_link`.
    pub fn from_pieces<'a>(outer_from_link: &Pose, pieces: impl IntoIterator<Item = &'a Piece>) -> Self {
        let to_link = outer_from_link.rotation.inverse();
        pieces.into_iter().fold(Self::EMPTY, |bounds, piece| {
            [DVec3::X, DVec3::Y, DVec3::Z].iter().fold(bounds, |bounds, &axis| {
                let high = outer_from_link.transform_point(piece.support(to_link * axis));
                let low = outer_from_link.transform_point(piece.support(to_link * -axis));
                Self {
                    min: DVec3::select(axis.cmpgt(DVec3::ZERO), bounds.min.min(low), bounds.min),
                    max: DVec3::select(axis.cmpgt(DVec3::ZERO), bounds.max.max(high), bounds.max),
                }
            })
        })
    }

    /// The bounds extended to a point.
    #[must_use]
    pub fn including(&self, point: DVec3) -> Self {
        Self { min: self.min.min(point), max: self.max.max(point) }
    }

    /// The smallest bounds that hold both.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Extent along each axis.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Centre of the bounds.
    pub fn center(&self) -> DVec3 {
        (self.max + self.min) * 0.5
    }
}

/// Bounding box with any orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedBox {
    /// Centre and axes of the box in the outer frame, e.g. the world.
    pub outer_from_box: Pose,
    /// Lengths along its axes, metres.
    pub size: DVec3,
}

impl OrientedBox {
    /// The two corners of each edge, as indices into [`OrientedBox::corners`].
    pub const EDGES: [[usize; 2]; 12] =
        [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

    /// Box of axis-aligned bounds given in an inner frame.
    pub fn of_bounds(outer_from_inner: &Pose, bounds: &Aabb) -> Self {
        Self { outer_from_box: *outer_from_inner * Pose::from_position(bounds.center()), size: bounds.size() }
    }

    /// Corners in the outer frame; bits 0, 1 and 2 of the index select the high side of x, y and z.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|corner| {
            let side = |axis: usize| if corner >> axis & 1 == 1 { 0.5 } else { -0.5 };
            self.outer_from_box.transform_point(self.size * DVec3::new(side(0), side(1), side(2)))
        })
    }
}
