//! Convex polygons in the table plane.

use glam::DVec2;

/// A convex polygon, counter-clockwise, without repeated corners; a point or a segment if degenerate.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Polygon {
    pub corners: Vec<DVec2>,
    pub min: DVec2,
    pub max: DVec2,
}

impl Polygon {
    /// Convex hull of points (Andrew's monotone chain).
    pub fn hull(mut points: Vec<DVec2>) -> Self {
        points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        points.dedup();
        let mut corners: Vec<DVec2> = Vec::with_capacity(points.len());
        if points.len() < 3 {
            corners = points;
        } else {
            let turns_right = |chain: &[DVec2], point: DVec2| match chain {
                [.., a, b] => (*b - *a).perp_dot(point - *b) <= 0.0,
                _ => false,
            };
            let mut half = |points: &mut dyn Iterator<Item = DVec2>| {
                let start = corners.len();
                for point in points {
                    while turns_right(&corners[start..], point) {
                        corners.pop();
                    }
                    corners.push(point);
                }
                corners.pop();
            };
            half(&mut points.iter().copied());
            half(&mut points.iter().rev().copied());
        }
        let min = corners.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let max = corners.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        Self { corners, min, max }
    }

    /// Enclosed area (m²).
    pub fn area(&self) -> f64 {
        self.edges().map(|(a, b)| a.perp_dot(b)).sum::<f64>() * 0.5
    }

    /// Shortest distance to another polygon (m), 0 if they overlap.
    pub fn distance(&self, other: &Self) -> f64 {
        if self.overlaps(other) {
            return 0.0;
        }
        let one_way = |from: &Self, to: &Self| {
            from.corners
                .iter()
                .flat_map(|&corner| to.edges().map(move |(a, b)| segment_distance_squared(corner, a, b)))
                .fold(f64::INFINITY, f64::min)
        };
        one_way(self, other).min(one_way(other, self)).sqrt()
    }

    /// True if a line along one of the edges separates the polygons by at least a distance (m). The test is
    /// conservative: corners that face each other can be slightly farther apart than it detects.
    pub fn is_apart(&self, other: &Self, distance: f64) -> bool {
        let keeps_apart = |from: &Self, to: &Self| {
            from.edges().any(|(a, b)| {
                let outward = (b - a).normalize_or_zero();
                outward != DVec2::ZERO && to.corners.iter().all(|&at| outward.perp_dot(at - a) <= -distance)
            })
        };
        self.bounds_distance(other) >= distance || keeps_apart(self, other) || keeps_apart(other, self)
    }

    /// Translates the polygon.
    pub fn shift(&mut self, by: DVec2) {
        self.corners.iter_mut().for_each(|corner| *corner += by);
        self.min += by;
        self.max += by;
    }

    /// Lower bound of the distance to another polygon (m), from the bounding boxes.
    pub fn bounds_distance(&self, other: &Self) -> f64 {
        (self.min - other.max).max(other.min - self.max).max(DVec2::ZERO).length()
    }

    /// The part inside another polygon (Sutherland and Hodgman).
    pub fn intersection(&self, other: &Self) -> Self {
        let mut corners = self.corners.clone();
        for (a, b) in other.edges() {
            let side = |point: DVec2| (b - a).perp_dot(point - a);
            let mut kept = Vec::with_capacity(corners.len() + 1);
            for (index, &corner) in corners.iter().enumerate() {
                let next = corners[(index + 1) % corners.len()];
                let (here, there) = (side(corner), side(next));
                if here >= 0.0 {
                    kept.push(corner);
                }
                if (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0) {
                    kept.push(corner.lerp(next, here / (here - there)));
                }
            }
            corners = kept;
        }
        Self::hull(corners)
    }

    fn edges(&self) -> impl Iterator<Item = (DVec2, DVec2)> + '_ {
        let count = self.corners.len();
        (0..count).map(move |index| (self.corners[index], self.corners[(index + 1) % count]))
    }

    /// True if no line along an edge separates the polygons; false if both are degenerate.
    fn overlaps(&self, other: &Self) -> bool {
        let separates = |from: &Self, to: &Self| {
            from.edges().any(|(a, b)| a != b && to.corners.iter().all(|&corner| (b - a).perp_dot(corner - a) < 0.0))
        };
        let flat = self.corners.len() < 3 && other.corners.len() < 3;
        !flat && self.bounds_distance(other) == 0.0 && !separates(self, other) && !separates(other, self)
    }
}

fn segment_distance_squared(point: DVec2, a: DVec2, b: DVec2) -> f64 {
    let along = b - a;
    let length_squared = along.length_squared();
    let t = if length_squared > 0.0 { ((point - a).dot(along) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
    (a + along * t - point).length_squared()
}
