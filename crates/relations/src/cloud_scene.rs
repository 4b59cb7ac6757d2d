//! Relations between point clouds: the profile `seed` for objects of which only surface points are known.
//!
//! Thresholds, order of decisions and explanations are those for posed geometry. The measured quantities are
//! approximated:
//! - *distance in the plane* is the shortest distance between points;
//! - *inside* is the share of points in the other object's convex hull that have the other's surface around them, at
//!   their height or above, in most compass directions. A cloud has no explicit cavity, but a cavity is surrounded by
//!   walls;
//! - *resting on* compares, in narrow vertical columns, the lowest point of one object with the highest of the other.
//!
//! A cloud has no joint positions, so no condition on a state is met.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use genmanip_core::{Aabb, Atom, AtomVerdict, Goal, GoalVerdict, ReferenceId};
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

/// Maximum number of points of a cloud that are tested for being inside.
const MAX_TESTED_POINTS: usize = 384;

/// Maximum number of points of a container that are considered as walls.
const MAX_WALL_POINTS: usize = 1536;

/// Minimum number of the 16 compass directions in which a point inside has a wall.
const MIN_WALLED_DIRECTIONS: u32 = 11;

/// Number of directions that define the corners of a cloud's hull, besides those of a cube.
const HULL_DIRECTIONS: usize = 230;

/// Smallest and largest width of the columns in which heights are compared, metres.
const COLUMN_M: [f64; 2] = [0.004, 0.02];

/// Point clouds of objects, ready for relation queries.
#[derive(Debug, Default)]
pub struct CloudScene {
    bodies: Vec<CloudBody>,
}

/// A cloud with its outline, hull and samples, computed on first use.
#[derive(Debug)]
pub(super) struct CloudBody {
    id: ReferenceId,
    cloud: Cloud,
    /// Points in a canonical order, so that results do not depend on the input order.
    sorted: OnceLock<Vec<DVec3>>,
    outline: OnceLock<Polygon>,
    hull: OnceLock<Vec<(DVec3, f64)>>,
}

impl CloudScene {
    /// `clouds` are object ids with points in the world frame, metres.
    pub fn new(clouds: impl IntoIterator<Item = (ReferenceId, Cloud)>) -> Self {
        let body = |(id, cloud)| CloudBody {
            id,
            cloud,
            sorted: OnceLock::new(),
            outline: OnceLock::new(),
            hull: OnceLock::new(),
        };
        Self { bodies: clouds.into_iter().map(body).collect() }
    }

    /// Index of an object; `None` for an unknown id.
    pub fn index_of(&self, id: &ReferenceId) -> Option<usize> {
        self.bodies.iter().position(|body| body.id == *id)
    }

    /// Judges one condition on objects at rest, like [`super::judge_atom`].
    pub fn judge_atom(&self, atom: &Atom, settings: &RelationSettings) -> AtomVerdict {
        judge(self, atom, &Rest::default(), settings)
    }

    /// Judges a goal, like [`super::judge_goal`].
    pub fn judge_goal(&self, goal: &Goal, rest: &Rest, settings: &RelationSettings) -> GoalVerdict {
        judge_alternatives(self, goal, rest, settings)
    }

    /// Measures and labels two objects, like [`super::label_pair`]; `None` if an index is out of range.
    pub fn label_pair(&self, a: usize, b: usize, settings: &RelationSettings) -> Option<PairVerdict> {
        label_extents(self, a, b, settings)
    }
}

impl Extents for CloudScene {
    type Extent = CloudBody;

    fn find(&self, id: &ReferenceId) -> Option<usize> {
        self.index_of(id)
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
        let (tried, walls) = (thinned(self.sorted(), MAX_TESTED_POINTS), thinned(container.sorted(), MAX_WALL_POINTS));
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
        // Among columns where the object is above the other the smallest gap counts, otherwise the least negative one.
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

    /// Planes of the convex hull of the extreme points in evenly spread directions; empty for coplanar points.
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

    /// Approximate distance between neighbouring points in the plane, limited to [`COLUMN_M`] (m).
    fn column_width(&self) -> f64 {
        let size = self.cloud.max - self.cloud.min;
        (size.x * size.y / self.cloud.points().len() as f64).sqrt().clamp(COLUMN_M[0], COLUMN_M[1])
    }
}

/// Every n-th point, so that at most `most` are selected.
fn thinned(points: &[DVec3], most: usize) -> Vec<DVec3> {
    points.iter().step_by(points.len().div_ceil(most).max(1)).copied().collect()
}

/// True if a container's surface surrounds a point, at its height or above, in most directions.
fn is_walled_in(point: DVec3, walls: &[DVec3]) -> bool {
    let mut seen = 0_u32;
    for wall in walls.iter().filter(|wall| wall.z >= point.z) {
        seen |= 1 << compass(wall.truncate() - point.truncate());
        if seen.count_ones() >= MIN_WALLED_DIRECTIONS {
            return true;
        }
    }
    false
}

/// Index of the nearest of 16 compass directions. Consistent under mirroring and quarter turns.
fn compass(way: DVec2) -> u32 {
    let size = way.abs();
    let slope = size.min_element() / size.max_element();
    // Tangents of 11.25 and 33.75 degrees.
    let step = if slope < 0.198_912 { 0 } else { 1 + u32::from(slope >= 0.668_179) };
    let quarter = if size.y > size.x { 4 - step } else { step };
    match (way.x < 0.0, way.y < 0.0) {
        (false, false) => quarter,
        (true, false) => 8 - quarter,
        (true, true) => 8 + quarter,
        (false, true) => (16 - quarter) % 16,
    }
}

/// Per column of points within the bounds, the height that `choose` takes from the lowest and the highest (m).
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
