//! A convex piece of the robot against many small things: quick bounds first, the exact distance where they fail.

use glam::DVec3;
use parry3d_f64::math::{Pose as ParryPose, Vector};

use super::convex::{Convex, Core, Separation, cores_closer_than, cores_separation};
use super::lanes::{LANES, Lanes};
use super::triangle::Triangle;
use crate::hull::convex_hull;
use crate::rigid::Rigid;

/// The planes of a hull's faces, in the frame of its core; none for other shapes, whose distances have closed forms.
///
/// Eight at a time, every next plane as different from those before as possible: what is far is known after a few.
#[derive(Clone, Debug)]
pub(crate) struct Planes(Vec<EightPlanes>);

/// Outward normals, coordinate by coordinate, and how far along them the hull reaches.
#[derive(Clone, Copy, Debug)]
struct EightPlanes {
    outward: [Lanes; 3],
    offset: Lanes,
}

/// Rounding of single precision over the size of a link and its surroundings, m.
const SINGLE: f64 = 2e-6;
/// Faces whose normals differ less than this are one face, rad² / 2.
const SAME_FACE: f64 = 1e-9;

/// A convex piece at its place in the world: whose points are these?
#[derive(Clone, Debug)]
pub(crate) struct Solid<'a> {
    pub(super) piece: &'a Convex,
    /// None when it is not worth to know its planes.
    pub(super) planes: Option<&'a Planes>,
    pub(super) core_from_world: Rigid,
}

impl Solid<'_> {
    /// Whether a point of the world lies within `margin` of the piece; where its planes are known, of all of them, which
    /// is a little more at sharp edges.
    pub(crate) fn is_within(&self, point: DVec3, margin: f64) -> bool {
        let point = self.core_from_world.point(point);
        // What is inside belongs to it even without a margin.
        let reach = (margin + self.piece.radius).max(SINGLE);
        match self.planes {
            Some(planes) if !planes.0.is_empty() => {
                self.piece.core.distance_bound(point) <= reach && farthest(&planes.0, point, reach) <= reach
            }
            _ => Probe::new(self.piece, &Planes(vec![])).touches_point(point, reach),
        }
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

impl Planes {
    pub(crate) fn new(piece: &Convex) -> Self {
        let Core::Hull { corners, .. } = &piece.core else { return Self(vec![]) };
        let Ok((hull, triangles)) = convex_hull(corners) else { return Self(vec![]) };
        let corner = |index: u32| hull[index as usize];
        let normal = |[a, b, c]: &[u32; 3]| (corner(*b) - corner(*a)).cross(corner(*c) - corner(*a)).try_normalize();
        let normals: Vec<DVec3> = triangles.iter().filter_map(normal).collect();
        // How like each normal is to the nearest of those chosen.
        let mut likeness = vec![-2.0_f64; normals.len()];
        let mut chosen: Vec<[f32; 4]> = Vec::new();
        while let Some(next) = (0..normals.len()).min_by(|a, b| likeness[*a].total_cmp(&likeness[*b])) {
            if likeness[next] > 1.0 - SAME_FACE {
                break;
            }
            let outward = normals[next];
            likeness.iter_mut().zip(&normals).for_each(|(like, other)| *like = like.max(outward.dot(*other)));
            let outward = outward.as_vec3();
            // No corner lies beyond, whatever the rounding of the normal.
            let reach = corners.iter().map(|corner| corner.dot(outward.as_dvec3())).fold(f64::NEG_INFINITY, f64::max);
            chosen.push([outward.x, outward.y, outward.z, reach as f32]);
        }
        let eight = |planes: &[[f32; 4]]| {
            let value = |axis: usize| Lanes::from_array(std::array::from_fn(|k| planes[k.min(planes.len() - 1)][axis]));
            EightPlanes { outward: [value(0), value(1), value(2)], offset: value(3) }
        };
        Self(chosen.chunks(LANES).map(eight).collect())
    }
}

/// Distance of a point from the farthest plane it lies before, negative inside, up to rounding: the distance from the
/// hull is not less. Anything above `enough` may come instead of what is larger than that.
fn farthest(planes: &[EightPlanes], point: DVec3, enough: f64) -> f64 {
    let [x, y, z] = point.to_array().map(|value| Lanes::all(value as f32));
    let mut farthest = Lanes::all(f32::MIN);
    for EightPlanes { outward, offset } in planes {
        farthest = (x * outward[0] + y * outward[1] + z * outward[2] - *offset).higher(farthest);
        if (farthest - Lanes::all(enough as f32)).not_positive() != u8::MAX {
            break;
        }
    }
    farthest.to_array().into_iter().fold(f32::MIN, f32::max).into()
}

impl<'a> Probe<'a> {
    pub(super) fn new(piece: &'a Convex, planes: &'a Planes) -> Self {
        Self { piece, planes }
    }

    /// Whether a few of the planes have a ball, in the frame of the core, certainly `reach` away.
    pub(super) fn is_roughly_beyond(&self, center: DVec3, reach: f64) -> bool {
        let few = &self.planes.0[..self.planes.0.len().min(2)];
        farthest(few, center, reach + SINGLE) > reach + SINGLE
    }

    /// Whether a point, in the frame of the core, is less than `reach` (positive) away from the core.
    pub(super) fn touches_point(&self, point: DVec3, reach: f64) -> bool {
        let core = &self.piece.core;
        let bound = core.distance_bound(point);
        if bound > reach || core.nearest_is_exact() {
            return bound < reach;
        }
        let beyond = farthest(&self.planes.0, point, reach + SINGLE);
        if beyond - SINGLE > reach {
            return false;
        }
        let inside = beyond < -SINGLE && !self.planes.0.is_empty();
        inside || cores_closer_than(&at(point), core, &Core::Point, reach)
    }

    /// Distance between a point, in the frame of the core, and the piece, both rounded, if it is at most `limit`.
    pub(super) fn separation_of_point(&self, point: DVec3, radius: f64, limit: f64) -> Separation {
        let rounding = self.piece.radius + radius;
        let reach = limit + rounding;
        let core = &self.piece.core;
        if core.distance_bound(point) > reach || farthest(&self.planes.0, point, reach + SINGLE) > reach + SINGLE {
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
        let corners = triangle.0.map(|corner| corner.to_array().map(|value| Lanes::all(value as f32)));
        let enough = (reach + SINGLE) as f32;
        self.planes.0.iter().any(|EightPlanes { outward, offset }| {
            let before = |[x, y, z]: [Lanes; 3]| x * outward[0] + y * outward[1] + z * outward[2] - *offset;
            let [a, b, c] = corners.map(before);
            (a.lower(b).lower(c) - Lanes::all(enough)).not_positive() != u8::MAX
        })
    }
}

fn at(point: DVec3) -> ParryPose {
    ParryPose::from_translation(Vector::from_array(point.to_array()))
}
