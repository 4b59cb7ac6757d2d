//! The judges on point clouds: profile `seed` when only points on the objects' surfaces are known.
//!
//! Thresholds, order of the decision and explanations are those of posed geometry; only the measures differ:
//! - *distance in the plane* is the shortest one between points;
//! - *inside* is the share of points in the other's convex hull that have the other's surface around them, at their
//!   height or above, in most directions of the compass: a cloud tells no cavity, but a hollow shows in its walls;
//! - *resting on* compares, in small columns over the table, the lowest point of the one with the highest of the other.
//!
//! A cloud says nothing about joints, so no state holds.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use genmanip_core::{Aabb, Atom, AtomVerdict, Goal, GoalVerdict};
use glam::{DVec2, DVec3};

use super::contact::Contact;
use super::extent::{Extent, Extents, supported};
use super::judge::{judge, judge_alternatives};
use super::pair::{PairVerdict, label_extents};
use super::requirement::Requirement;
use super::{RelationSettings, Rest};
use crate::clouds::{Cloud, spread_directions};
use crate::hull::Hull;
use crate::planar::Polygon;

/// Points of a cloud that are tried for being inside.
const TRIED: usize = 384;

/// Points of a container that can stand in the way.
const WALL: usize = 1536;

/// In how many of 16 directions of the compass a point that is inside has a wall.
const WALLED: u32 = 11;

/// Directions in which the hull of a cloud gets its corners, besides those of a cube.
const HULL_DIRECTIONS: usize = 230;

/// Narrowest and widest column in which heights are compared, metres.
const COLUMN_M: [f64; 2] = [0.004, 0.02];

/// Objects of which points are known, ready to be judged.
#[derive(Debug, Default)]
pub struct CloudScene {
    bodies: Vec<CloudBody>,
}

/// A cloud with its outline, hull and samples, made when first needed.
#[derive(Debug)]
pub(super) struct CloudBody {
    uid: String,
    cloud: Cloud,
    /// Points in an order of their own, so that the order they came in does not matter.
    sorted: OnceLock<Vec<DVec3>>,
    outline: OnceLock<Polygon>,
    hull: OnceLock<Vec<(DVec3, f64)>>,
}

impl CloudScene {
    /// Objects by uid with their points in the world frame, metres.
    pub fn new(clouds: impl IntoIterator<Item = (String, Cloud)>) -> Self {
        let body = |(uid, cloud)| CloudBody {
            uid,
            cloud,
            sorted: OnceLock::new(),
            outline: OnceLock::new(),
            hull: OnceLock::new(),
        };
        Self { bodies: clouds.into_iter().map(body).collect() }
    }

    /// Index of an object.
    pub fn index_of(&self, uid: &str) -> Option<usize> {
        self.bodies.iter().position(|body| body.uid == uid)
    }

    /// Judges one condition on objects at rest, as [`super::judge_atom`] does.
    pub fn judge_atom(&self, atom: &Atom, settings: &RelationSettings) -> AtomVerdict {
        judge(self, atom, &Rest::default(), settings)
    }

    /// Judges a goal, as [`super::judge_goal`] does.
    pub fn judge_goal(&self, goal: &Goal, rest: &Rest, settings: &RelationSettings) -> GoalVerdict {
        judge_alternatives(self, goal, rest, settings)
    }

    /// Measures and labels two objects, as [`super::label_pair`] does; `None` for an index out of range.
    pub fn label_pair(&self, a: usize, b: usize, settings: &RelationSettings) -> Option<PairVerdict> {
        label_extents(self, a, b, settings)
    }
}

impl Extents for CloudScene {
    type Extent = CloudBody;

    fn find(&self, uid: &str) -> Option<usize> {
        self.index_of(uid)
    }

    fn extent(&self, index: usize) -> Option<&CloudBody> {
        self.bodies.get(index)
    }
}

impl Extent for CloudBody {
    fn bounds(&self) -> Aabb {
        Aabb { min: self.cloud.min, max: self.cloud.max }
    }

    fn center(&self) -> DVec3 {
        self.cloud.mean
    }

    fn planar_gap(&self, other: &Self) -> f64 {
        self.cloud.tree().planar_distance(other.cloud.tree())
    }

    fn share_inside(&self, container: &Self) -> f64 {
        let (tried, walls) = (thinned(self.sorted(), TRIED), thinned(container.sorted(), WALL));
        let planes = container.hull();
        let in_hull =
            |point: DVec3| !planes.is_empty() && planes.iter().all(|(normal, limit)| normal.dot(point) <= *limit);
        let inside = tried.iter().filter(|&&point| in_hull(point) && is_walled_in(point, &walls)).count();
        inside as f64 / tried.len().max(1) as f64
    }

    fn contact_above(&self, lower: &Self, settings: &RelationSettings) -> Option<Contact> {
        let width = self.column_width().max(lower.column_width());
        if self.planar_gap(lower) > 0.5 * width {
            return None;
        }
        let common = Aabb { min: self.cloud.min.max(lower.cloud.min), max: self.cloud.max.min(lower.cloud.max) };
        let bottoms = columns(&self.cloud, &common, width, |[low, _]| low);
        let tops = columns(&lower.cloud, &common, width, |[_, high]| high);
        let gaps = bottoms.iter().filter_map(|(&[column, row], bottom)| {
            let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| [column + dx, row + dy]));
            let top = around.filter_map(|cell| tops.get(&cell)).copied().reduce(f64::max)?;
            Some(bottom - top)
        });
        // Of columns where the one is above the other the closest counts, otherwise the one that is least sunk in.
        let gap_m = gaps.reduce(|one, other| match (one >= -settings.sinking_m, other >= -settings.sinking_m) {
            (true, true) => one.min(other),
            (false, false) => one.max(other),
            (true, false) => one,
            (false, true) => other,
        })?;
        Some(Contact { gap_m, rise_m: self.cloud.mean.z - lower.cloud.mean.z })
    }

    fn supports(&self, upper: &Self, settings: &RelationSettings) -> bool {
        supported(upper.outline(), self.outline(), settings)
    }

    fn state(&self, _state: &str, _settings: &RelationSettings) -> Vec<Requirement> {
        vec![Requirement::fact("a state that points can show", false)]
    }
}

impl CloudBody {
    fn sorted(&self) -> &[DVec3] {
        self.sorted.get_or_init(|| {
            let mut points = self.cloud.points().to_vec();
            points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
            points
        })
    }

    fn outline(&self) -> &Polygon {
        self.outline.get_or_init(|| Polygon::hull(self.sorted().iter().map(|point| point.truncate()).collect()))
    }

    /// Planes of the convex hull of the extreme points in evenly spread directions; none when the points are flat.
    fn hull(&self) -> &[(DVec3, f64)] {
        self.hull.get_or_init(|| {
            let tree = self.cloud.tree();
            let mut extremes: Vec<DVec3> =
                spread_directions(HULL_DIRECTIONS).map(|direction| tree.farthest(direction)).collect();
            extremes.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
            extremes.dedup();
            Hull::of(&extremes).planes(1e-9)
        })
    }

    /// About the distance between neighbouring points.
    fn column_width(&self) -> f64 {
        let size = self.cloud.max - self.cloud.min;
        (size.x * size.y / self.cloud.points().len() as f64).sqrt().clamp(COLUMN_M[0], COLUMN_M[1])
    }
}

/// At most so many points, evenly taken.
fn thinned(points: &[DVec3], most: usize) -> Vec<DVec3> {
    points.iter().step_by(points.len().div_ceil(most).max(1)).copied().collect()
}

/// Whether a container's surface is around a point, at its height or above, in most directions.
fn is_walled_in(point: DVec3, walls: &[DVec3]) -> bool {
    let mut seen = 0_u32;
    for wall in walls.iter().filter(|wall| wall.z >= point.z) {
        seen |= 1 << compass(wall.truncate() - point.truncate());
        if seen.count_ones() >= WALLED {
            return true;
        }
    }
    false
}

/// Which of 16 directions is nearest; mirror images and quarter turns of a way have those of the direction.
fn compass(way: DVec2) -> u32 {
    let size = way.abs();
    let slope = size.min_element() / size.max_element();
    // The tangents of 11.25 and 33.75 degrees.
    let step = if slope < 0.198_912 { 0 } else { 1 + u32::from(slope >= 0.668_179) };
    let quarter = if size.y > size.x { 4 - step } else { step };
    match (way.x < 0.0, way.y < 0.0) {
        (false, false) => quarter,
        (true, false) => 8 - quarter,
        (true, true) => 8 + quarter,
        (false, true) => (16 - quarter) % 16,
    }
}

/// One height per column of points in the given bounds, chosen from the lowest and highest one.
fn columns(cloud: &Cloud, within: &Aabb, width: f64, choose: impl Fn([f64; 2]) -> f64) -> BTreeMap<[i64; 2], f64> {
    let (min, max) = (within.min.truncate() - width, within.max.truncate() + width);
    let mut spans: BTreeMap<[i64; 2], [f64; 2]> = BTreeMap::new();
    for point in cloud.points() {
        let place: DVec2 = point.truncate();
        if place.cmpge(min).all() && place.cmple(max).all() {
            let cell = (place / width).floor().to_array().map(|index| index as i64);
            let span = spans.entry(cell).or_insert([point.z, point.z]);
            *span = [span[0].min(point.z), span[1].max(point.z)];
        }
    }
    spans.into_iter().map(|(cell, span)| (cell, choose(span))).collect()
}
