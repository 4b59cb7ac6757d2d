//! Containment of points in convex bodies.

use genmanip_core::{Piece, Pose, Shape};
use glam::DVec3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;

/// A convex body that answers whether a point is in it.
#[derive(Clone, Debug)]
pub(super) struct Solid {
    piece_from_link: Pose,
    body: Body,
}

#[derive(Clone, Debug)]
enum Body {
    Exact(Shape),
    /// Outward normals and distances from the origin.
    Planes(Vec<(DVec3, f64)>),
}

/// A convex hull as a closed triangle mesh; empty when the points lie in a plane.
#[derive(Clone, Debug, Default)]
pub(super) struct Hull {
    pub corners: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Solid {
    /// The body of a piece.
    pub fn of_piece(piece: &Piece) -> Self {
        let body = match &piece.shape {
            Shape::Hull { points } => Body::Planes(Hull::of(points).planes()),
            other => Body::Exact(other.clone()),
        };
        Self { piece_from_link: piece.link_from_piece.inverse(), body }
    }

    /// The body of a hull.
    pub fn of_hull(hull: &Hull) -> Self {
        Self { piece_from_link: Pose::IDENTITY, body: Body::Planes(hull.planes()) }
    }

    /// Whether a point of the link's frame is in the body.
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

impl Hull {
    /// Convex hull of points.
    pub fn of(points: &[DVec3]) -> Self {
        let points: Vec<Vector> = points.iter().map(|point| Vector::from_array(point.to_array())).collect();
        if points.len() < 4 {
            return Self::default();
        }
        match try_convex_hull(&points) {
            Ok((corners, triangles)) => {
                Self { corners: corners.iter().map(|corner| DVec3::from_array(corner.to_array())).collect(), triangles }
            }
            Err(_) => Self::default(),
        }
    }

    /// Corners of each triangle.
    pub fn faces(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles.iter().map(|triangle| triangle.map(|index| self.corners[index as usize]))
    }

    fn planes(&self) -> Vec<(DVec3, f64)> {
        let center = self.corners.iter().sum::<DVec3>() / self.corners.len().max(1) as f64;
        self.faces()
            .filter_map(|[a, b, c]| {
                let normal = (b - a).cross(c - a).try_normalize()?;
                let outward = if normal.dot(a - center) < 0.0 { -normal } else { normal };
                Some((outward, outward.dot(a) + 1e-12))
            })
            .collect()
    }
}
