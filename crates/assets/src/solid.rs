//! Convex pieces with analytic volume and moments.

use std::f64::consts::PI;

use genmanip_core::{MassProperties, Piece, Pose, Shape};
use glam::{DMat3, DQuat, DVec3};

/// Convex collision piece with the moments of its volume.
#[derive(Clone, Debug)]
pub struct Solid {
    /// Collision piece, in the link's frame.
    pub piece: Piece,
    /// Moments of the piece's volume, in the link's frame.
    pub moments: Moments,
}

/// Volume, centroid and second moments of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// Volume, m³.
    pub volume: f64,
    /// Centroid, m.
    pub center: DVec3,
    /// Second moments about the centroid c: ∫ (x − c)(x − c)ᵀ dV, m⁵.
    pub second: DMat3,
}

impl Solid {
    /// Oriented box with these half extents, m.
    pub fn cuboid(link_from_piece: Pose, half_extents: DVec3) -> Self {
        let volume = 8.0 * half_extents.element_product();
        Self::primitive(
            link_from_piece,
            Shape::Box { half_extents },
            volume,
            half_extents * half_extents * (volume / 3.0),
        )
    }

    /// Cylinder between the centres of its ends, m.
    pub fn cylinder(from: DVec3, to: DVec3, radius: f64) -> Self {
        let half_height = from.distance(to) / 2.0;
        let volume = 2.0 * PI * radius * radius * half_height;
        let across = radius * radius / 4.0;
        let second = DVec3::new(across, across, half_height * half_height / 3.0) * volume;
        Self::primitive(along(from, to), Shape::Cylinder { radius, half_height }, volume, second)
    }

    /// Capsule between the centres of its caps, m.
    pub fn capsule(from: DVec3, to: DVec3, radius: f64) -> Self {
        let half_length = from.distance(to) / 2.0;
        let tube = 2.0 * PI * radius * radius * half_length;
        let caps = 4.0 / 3.0 * PI * radius.powi(3);
        let across = tube * radius * radius / 4.0 + caps * radius * radius / 5.0;
        let lengthwise = tube * half_length * half_length / 3.0
            + caps * (radius * radius / 5.0 + half_length * half_length + 0.75 * half_length * radius);
        let second = DVec3::new(across, across, lengthwise);
        Self::primitive(along(from, to), Shape::Capsule { radius, half_length }, tube + caps, second)
    }

    /// Body lofted between rings with the same number of points, each counter-clockwise seen from the last ring.
    ///
    /// The rings must span a convex body (tested for every object of the catalogue), so that the hull of the points
    /// equals the body and its moments follow from the rings.
    pub fn loft(rings: &[Vec<DVec3>]) -> Self {
        let moments = Moments::of_surface(&loft_triangles(rings));
        let points = rings.iter().flatten().map(|&point| point - moments.center).collect();
        Self { piece: Piece::at(moments.center, Shape::Hull { points }), moments }
    }

    fn primitive(link_from_piece: Pose, shape: Shape, volume: f64, principal: DVec3) -> Self {
        let rotation = DMat3::from_quat(link_from_piece.rotation);
        let second = rotation * DMat3::from_diagonal(principal) * rotation.transpose();
        let moments = Moments { volume, center: link_from_piece.position, second };
        Self { piece: Piece { shape, link_from_piece }, moments }
    }
}

impl Moments {
    /// Moments of the interior of a closed surface whose triangles are counter-clockwise seen from outside.
    pub fn of_surface(triangles: &[[DVec3; 3]]) -> Self {
        let origin = triangles.first().map_or(DVec3::ZERO, |triangle| triangle[0]);
        let (mut volume, mut first, mut second) = (0.0, DVec3::ZERO, DMat3::ZERO);
        for triangle in triangles {
            let [a, b, c] = triangle.map(|corner| corner - origin);
            let tetrahedron = a.dot(b.cross(c)) / 6.0;
            let sum = a + b + c;
            volume += tetrahedron;
            first += sum * (tetrahedron / 4.0);
            second += (outer(a) + outer(b) + outer(c) + outer(sum)) * (tetrahedron / 20.0);
        }
        let center = first / volume;
        Self { volume, center: center + origin, second: second - outer(center) * volume }
    }

    /// Combined moments of several bodies; overlaps count twice.
    pub fn sum<'a>(parts: impl IntoIterator<Item = &'a Self> + Clone) -> Self {
        let volume: f64 = parts.clone().into_iter().map(|part| part.volume).sum();
        let center = parts.clone().into_iter().fold(DVec3::ZERO, |sum, part| sum + part.center * part.volume) / volume;
        let second = parts
            .into_iter()
            .fold(DMat3::ZERO, |sum, part| sum + part.second + outer(part.center - center) * part.volume);
        Self { volume, center, second }
    }

    /// Mass properties of a body with these moments, uniform density and the given total mass.
    pub fn with_mass(&self, mass_kg: f64) -> MassProperties {
        let second = self.second * (mass_kg / self.volume);
        let trace = second.x_axis.x + second.y_axis.y + second.z_axis.z;
        MassProperties { mass_kg, center: self.center, inertia: DMat3::from_diagonal(DVec3::splat(trace)) - second }
    }
}

/// Triangles of the closed surface lofted between rings, counter-clockwise seen from outside.
pub fn loft_triangles(rings: &[Vec<DVec3>]) -> Vec<[DVec3; 3]> {
    let mut triangles = Vec::new();
    for pair in rings.windows(2) {
        let (low, high) = (&pair[0], &pair[1]);
        for i in 0..low.len() {
            let next = (i + 1) % low.len();
            triangles.push([low[i], low[next], high[next]]);
            triangles.push([low[i], high[next], high[i]]);
        }
    }
    if let (Some(first), Some(last)) = (rings.first(), rings.last()) {
        for i in 1..first.len().saturating_sub(1) {
            triangles.push([first[0], first[i + 1], first[i]]);
            triangles.push([last[0], last[i], last[i + 1]]);
        }
    }
    triangles
}

/// Frame at the midpoint of a segment with z along it.
pub fn along(from: DVec3, to: DVec3) -> Pose {
    let direction = (to - from).normalize_or(DVec3::Z);
    Pose::new((from + to) / 2.0, DQuat::from_rotation_arc(DVec3::Z, direction))
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}
