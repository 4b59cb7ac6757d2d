//! Containment of points in convex bodies.

use genmanip_core::{Piece, Pose, Shape};
use glam::DVec3;

use crate::hull::Hull;

/// A convex body for containment tests.
#[derive(Clone, Debug)]
pub(super) struct Solid {
    piece_from_link: Pose,
    body: Body,
}

#[derive(Clone, Debug)]
enum Body {
    Exact(Shape),
    /// Half-spaces of which the body is the intersection: outward normals and distances from the origin (m).
    Planes(Vec<(DVec3, f64)>),
}

impl Solid {
    /// Convex body of a collision piece, in its link's frame.
    pub fn of_piece(piece: &Piece) -> Self {
        let body = match &piece.shape {
            Shape::Hull { points } => Body::Planes(Hull::of(points).planes(1e-12)),
            other => Body::Exact(other.clone()),
        };
        Self { piece_from_link: piece.link_from_piece.inverse(), body }
    }

    /// Convex body of the points of a hull.
    pub fn of_hull(hull: &Hull) -> Self {
        Self { piece_from_link: Pose::IDENTITY, body: Body::Planes(hull.planes(1e-12)) }
    }

    /// True if a point in the link's frame is in the body.
    pub fn contains(&self, point: DVec3) -> bool {
        let point = self.piece_from_link.transform_point(point);
        match &self.body {
            Body::Planes(planes) => {
                !planes.is_empty() && planes.iter().all(|(normal, distance)| normal.dot(point) <= *distance)
            }
            Body::Exact(Shape::Box { half_extents }) => point.abs().cmple(*half_extents).all(),
            Body::Exact(Shape::Sphere { radius }) => point.length_squared() <= radius * radius,
            Body::Exact(Shape::Ellipsoid { radii }) => (point / *radii).length_squared() <= 1.0,
            Body::Exact(Shape::Cylinder { radius, half_height }) => {
                point.z.abs() <= *half_height && point.truncate().length_squared() <= radius * radius
            }
            Body::Exact(Shape::Capsule { radius, half_length }) => {
                let beyond = (point.z.abs() - half_length).max(0.0);
                point.truncate().length_squared() + beyond * beyond <= radius * radius
            }
            Body::Exact(Shape::Hull { .. }) => false,
        }
    }
}
