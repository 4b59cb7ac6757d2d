//! A convex robot piece against many facets: quick bounds first, exact distance if inconclusive.

use glam::DVec3;
use parry3d_f64::math::{Pose as ParryPose, Vector};

use super::convex::{Convex, Core, Separation, cores_closer_than, cores_separation};
use super::lanes::{LANES, Lanes};
use super::triangle::Triangle;
use crate::hull::convex_hull;
use crate::rigid::Rigid;

/// Face planes of a hull, in the frame of its core; empty for other shapes, whose distances have closed forms.
///
/// The planes are in batches of eight and ordered so that each one differs most from all before it: distant points are
/// rejected after a few planes.
#[derive(Clone, Debug)]
pub(crate) struct FacePlanes(Vec<EightPlanes>);

/// Outward normals (structure of arrays) and plane offsets.
#[derive(Clone, Copy, Debug)]
struct EightPlanes {
    outward: [Lanes; 3],
    offset: Lanes,
}

/// Rounding error of single precision over the size of a link and its surroundings (m). Chosen by hand.
const SINGLE: f64 = 2e-6;
/// Normals that differ by less are one face [rad² / 2].
const SAME_FACE: f64 = 1e-9;

/// A convex piece at its pose, for attributing points.
#[derive(Clone, Debug)]
pub(crate) struct Solid<'a> {
    pub(super) piece: &'a Convex,
    /// Face planes of the piece; `None` if they were not precomputed, as for an attached object.
    pub(super) planes: Option<&'a FacePlanes>,
    pub(super) core_from_world: Rigid,
}

impl Solid<'_> {
    /// True if a point is within `margin` (m) of the piece. With face planes, distance means that to the farthest
    /// plane, so that points slightly farther away count near sharp edges.
    pub(crate) fn is_within(&self, point: DVec3, margin: f64) -> bool {
        let point = self.core_from_world.point(point);
        // Inside points count even without a margin.
        let reach = (margin + self.piece.radius).max(SINGLE);
        match self.planes {
            Some(planes) if !planes.0.is_empty() => {
                self.piece.core.distance_bound(point) <= reach && max_plane_distance(&planes.0, point, reach) <= reach
            }
            _ => Probe::new(self.piece, &FacePlanes(vec![])).touches_point(point, reach),
        }
    }

    /// True if a point is certainly farther than `margin` (m) from the piece.
    pub(crate) fn is_surely_beyond(&self, point: DVec3, margin: f64) -> bool {
        self.piece.core.distance_bound(self.core_from_world.point(point)) > margin + self.piece.radius
    }
}

/// A piece with its face planes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probe<'a> {
    pub(super) piece: &'a Convex,
    planes: &'a FacePlanes,
}

impl FacePlanes {
    pub(crate) fn new(piece: &Convex) -> Self {
        let Core::Hull { corners, .. } = &piece.core else { return Self(vec![]) };
        let Ok((hull, triangles)) = convex_hull(corners) else { return Self(vec![]) };
        let corner = |index: u32| hull[index as usize];
        let normal = |[a, b, c]: &[u32; 3]| (corner(*b) - corner(*a)).cross(corner(*c) - corner(*a)).try_normalize();
        let normals: Vec<DVec3> = triangles.iter().filter_map(normal).collect();
        // Cosine of the angle between each normal and the most similar normal chosen so far.
        let mut similarity = vec![-2.0_f64; normals.len()];
        let mut chosen: Vec<[f32; 4]> = Vec::new();
        while let Some(next) = (0..normals.len()).min_by(|a, b| similarity[*a].total_cmp(&similarity[*b])) {
            if similarity[next] > 1.0 - SAME_FACE {
                break;
            }
            let outward = normals[next];
            similarity.iter_mut().zip(&normals).for_each(|(like, other)| *like = like.max(outward.dot(*other)));
            let outward = outward.as_vec3();
            // Conservative offset: no vertex lies beyond it despite rounding.
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

/// Largest signed distance of a point from a plane (m), negative inside, up to rounding: a lower bound of the distance
/// to the hull. Values above `enough` may be reported early.
fn max_plane_distance(planes: &[EightPlanes], point: DVec3, enough: f64) -> f64 {
    let [x, y, z] = point.to_array().map(|value| Lanes::all(value as f32));
    let mut max_plane_distance = Lanes::all(f32::MIN);
    for EightPlanes { outward, offset } in planes {
        max_plane_distance = (x * outward[0] + y * outward[1] + z * outward[2] - *offset).higher(max_plane_distance);
        if (max_plane_distance - Lanes::all(enough as f32)).not_positive() != u8::MAX {
            break;
        }
    }
    max_plane_distance.to_array().into_iter().fold(f32::MIN, f32::max).into()
}

impl<'a> Probe<'a> {
    pub(super) fn new(piece: &'a Convex, planes: &'a FacePlanes) -> Self {
        Self { piece, planes }
    }

    /// True if one of the first planes proves that a sphere's centre, in the core frame, is at least `reach` (m) from
    /// the core.
    pub(super) fn is_roughly_beyond(&self, center: DVec3, reach: f64) -> bool {
        let few = &self.planes.0[..self.planes.0.len().min(2)];
        max_plane_distance(few, center, reach + SINGLE) > reach + SINGLE
    }

    /// True if a point, in the core frame, is closer than `reach` (positive) to the core.
    pub(super) fn touches_point(&self, point: DVec3, reach: f64) -> bool {
        let core = &self.piece.core;
        let bound = core.distance_bound(point);
        if bound > reach || core.nearest_is_exact() {
            return bound < reach;
        }
        let beyond = max_plane_distance(&self.planes.0, point, reach + SINGLE);
        if beyond - SINGLE > reach {
            return false;
        }
        let inside = beyond < -SINGLE && !self.planes.0.is_empty();
        inside || cores_closer_than(&at(point), core, &Core::Point, reach)
    }

    /// Distance between a point, in the core frame, and the piece, both rounded, if it is at most `limit` (m).
    pub(super) fn separation_of_point(&self, point: DVec3, radius: f64, limit: f64) -> Separation {
        let rounding = self.piece.radius + radius;
        let reach = limit + rounding;
        let core = &self.piece.core;
        if core.distance_bound(point) > reach
            || max_plane_distance(&self.planes.0, point, reach + SINGLE) > reach + SINGLE
        {
            return Separation::Beyond;
        }
        cores_separation(&at(point), &self.piece.core, &Core::Point, rounding, limit)
    }

    /// True if a triangle, in the core frame, is closer than `reach` to the core.
    pub(super) fn touches_triangle(&self, triangle: &Triangle, reach: f64) -> bool {
        if reach <= 0.0 {
            return matches!(self.separation_of_triangle(triangle, 0.0), Separation::Within(d) if d < 0.0);
        }
        !self.is_beyond(triangle, reach) && cores_closer_than(&at(DVec3::ZERO), &self.piece.core, triangle, reach)
    }

    /// Distance between a triangle, in the core frame, and the piece, if it is at most `limit` (m).
    pub(super) fn separation_of_triangle(&self, triangle: &Triangle, limit: f64) -> Separation {
        if self.is_beyond(triangle, limit + self.piece.radius) {
            return Separation::Beyond;
        }
        cores_separation(&at(DVec3::ZERO), &self.piece.core, triangle, self.piece.radius, limit)
    }

    /// True if a plane separates the whole triangle by more than `reach`.
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
