//! A convex piece of the robot against many small things: quick bounds first, the exact distance where they fail.

use glam::DVec3;
use parry3d_f64::math::{Pose as ParryPose, Vector};
use parry3d_f64::shape::SupportMap;
use parry3d_f64::transformation::try_convex_hull;

use crate::rigid::Rigid;

use super::convex::{Convex, Core, Separation, cores_closer_than, cores_separation};

/// The planes of a hull's faces, in the frame of its core; none for other shapes, whose distances have closed forms.
#[derive(Clone, Debug)]
pub(crate) struct Planes(Vec<Plane>);

#[derive(Clone, Copy, Debug)]
struct Plane {
    outward: DVec3,
    offset: f64,
}

/// A convex piece at its place in the world: whose points are these?
#[derive(Clone, Debug)]
pub(crate) struct Solid<'a> {
    pub(super) piece: &'a Convex,
    /// None when it is not worth to know its planes.
    pub(super) planes: Option<&'a Planes>,
    pub(super) core_from_world: Rigid,
}

impl Solid<'_> {
    /// Whether a point of the world lies within `margin` of the piece.
    pub(crate) fn is_within(&self, point: DVec3, margin: f64) -> bool {
        let none = Planes(vec![]);
        let probe = Probe::new(self.piece, self.planes.unwrap_or(&none));
        // What is inside belongs to it even without a margin.
        probe.touches_point(self.core_from_world.point(point), (margin + self.piece.radius).max(f64::MIN_POSITIVE))
    }

    /// Whether a point of the world certainly lies farther than `margin` from the piece.
    pub(crate) fn is_surely_beyond(&self, point: DVec3, margin: f64) -> bool {
        self.piece.core.distance_bound(self.core_from_world.point(point)) > margin + self.piece.radius
    }
}

/// A piece with its planes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probe<'a> {
    pub(super) piece: &'a Convex,
    planes: &'a Planes,
}

/// Three corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triangle(pub(super) [DVec3; 3]);

impl Planes {
    pub(crate) fn new(piece: &Convex) -> Self {
        let Core::Hull { corners, .. } = &piece.core else { return Self(vec![]) };
        let input: Vec<Vector> = corners.iter().map(|corner| Vector::from_array(corner.to_array())).collect();
        let Ok((hull, triangles)) = try_convex_hull(&input) else { return Self(vec![]) };
        let corner = |index: u32| DVec3::from_array(hull[index as usize].to_array());
        let mut planes: Vec<Plane> = Vec::new();
        for [a, b, c] in triangles {
            let (a, b, c) = (corner(a), corner(b), corner(c));
            let Some(outward) = (b - a).cross(c - a).try_normalize() else { continue };
            if planes.iter().all(|plane| plane.outward.dot(outward) < 1.0 - 1e-9) {
                // No corner lies beyond, whatever the rounding of the normal.
                let offset = corners.iter().map(|corner| corner.dot(outward)).fold(f64::NEG_INFINITY, f64::max);
                planes.push(Plane { outward, offset });
            }
        }
        Self(planes)
    }

    /// A lower bound on the distance from a point to the hull, as soon as it exceeds `enough`.
    fn bound(&self, point: DVec3, enough: f64) -> f64 {
        let mut bound = f64::NEG_INFINITY;
        for plane in &self.0 {
            bound = bound.max(plane.outward.dot(point) - plane.offset);
            if bound > enough {
                break;
            }
        }
        bound
    }
}

impl<'a> Probe<'a> {
    pub(super) fn new(piece: &'a Convex, planes: &'a Planes) -> Self {
        Self { piece, planes }
    }

    /// A lower bound on the distance from a point to the core, exact beyond `enough` or not at all.
    pub(super) fn bound(&self, point: DVec3, enough: f64) -> f64 {
        let bound = self.piece.core.distance_bound(point);
        if bound > enough { bound } else { bound.max(self.planes.bound(point, enough)) }
    }

    /// Whether a point, in the frame of the core, is less than `reach` (positive) away from the core.
    pub(super) fn touches_point(&self, point: DVec3, reach: f64) -> bool {
        let core = &self.piece.core;
        let bound = core.distance_bound(point);
        if bound > reach || core.nearest_is_exact() {
            return bound < reach;
        }
        let beyond = self.planes.bound(point, reach);
        if beyond > reach {
            return false;
        }
        let inside = beyond <= 0.0 && !self.planes.0.is_empty();
        inside || cores_closer_than(&at(point), core, &Core::Point, reach)
    }

    /// Distance between a point, in the frame of the core, and the piece, both rounded, if it is at most `limit`.
    pub(super) fn separation_of_point(&self, point: DVec3, radius: f64, limit: f64) -> Separation {
        let rounding = self.piece.radius + radius;
        if self.bound(point, limit + rounding) > limit + rounding {
            return Separation::Beyond;
        }
        cores_separation(&at(point), &self.piece.core, &Core::Point, rounding, limit)
    }

    /// Whether a triangle, in the frame of the core, is less than `reach` away from the core.
    pub(super) fn touches_triangle(&self, triangle: &Triangle, reach: f64) -> bool {
        if reach <= 0.0 {
            return matches!(self.separation_of_triangle(triangle, 0.0), Separation::Within(d) if d < 0.0);
        }
        !self.is_beyond(triangle, reach) && cores_closer_than(&at(DVec3::ZERO), &self.piece.core, triangle, reach)
    }

    /// Distance between a triangle, in the frame of the core, and the piece, if it is at most `limit`.
    pub(super) fn separation_of_triangle(&self, triangle: &Triangle, limit: f64) -> Separation {
        if self.is_beyond(triangle, limit + self.piece.radius) {
            return Separation::Beyond;
        }
        cores_separation(&at(DVec3::ZERO), &self.piece.core, triangle, self.piece.radius, limit)
    }

    /// Whether one of the planes has the whole triangle more than `reach` before it.
    fn is_beyond(&self, triangle: &Triangle, reach: f64) -> bool {
        let before = |plane: &Plane| triangle.0.iter().all(|c| plane.outward.dot(*c) - plane.offset > reach);
        self.planes.0.iter().any(before)
    }
}

fn at(point: DVec3) -> ParryPose {
    ParryPose::from_translation(Vector::from_array(point.to_array()))
}

impl SupportMap for Triangle {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let direction = DVec3::from_array(direction.to_array());
        let [a, b, c] = self.0;
        let farther = |a: DVec3, b: DVec3| if b.dot(direction) > a.dot(direction) { b } else { a };
        Vector::from_array(farther(farther(a, b), c).to_array())
    }
}
