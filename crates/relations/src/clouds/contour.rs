//! The concave outline of a cloud in the top view.
//!
//! The algorithm is concaveman's (Park and Oh, "A New Concave Hull Algorithm and Concaveness Measure for n-dimensional
//! Datasets", 2012, with Agafonkin's search order): an edge of the convex hull is replaced by two edges through the
//! nearest interior point if that point is close enough relative to the length of the edge.

use std::collections::{BTreeSet, VecDeque};

use glam::{DVec2, DVec3};

use super::tree::Tree;
use crate::planar::Polygon;

/// Concavity parameter of the algorithm: an edge is replaced if the point is closer to one of its ends than the edge's
/// length divided by this.
const CONCAVITY: f64 = 2.0;

/// Closed outline in the top view.
#[derive(Debug)]
pub(crate) struct Contour {
    corners: Vec<DVec2>,
}

impl Contour {
    /// Concave outline of points; `None` if they are collinear.
    pub fn new(points: &[DVec3]) -> Option<Self> {
        let flat: Vec<DVec2> = points.iter().map(|point| point.truncate()).collect();
        let hull = Polygon::hull(flat.clone()).corners;
        if hull.len() < 3 {
            return None;
        }
        Some(Self { corners: dig(&hull, Grid::new(flat, &hull)) })
    }

    /// Points of a cloud inside the outline or closer to it than `reach` (m).
    pub fn crop(&self, tree: &Tree, reach: f64) -> Vec<DVec3> {
        let mut kept = Vec::new();
        let edges: Vec<usize> = (0..self.corners.len()).collect();
        self.crop_node(tree, 0, &edges, reach, &mut kept);
        kept
    }

    /// Crops one node of the tree, given the edges that may be within reach of it.
    fn crop_node(&self, tree: &Tree, index: usize, edges: &[usize], reach: f64, kept: &mut Vec<DVec3>) {
        let node = &tree.nodes[index];
        let center = ((node.min + node.max) * 0.5).truncate();
        let radius = ((node.max - node.min) * 0.5).truncate().length() + 1e-12;
        let points = &tree.points[node.start..node.end];
        let mut in_reach = Vec::new();
        for &edge in edges {
            let distance = self.edge_distance_squared(edge, center).sqrt();
            if distance + radius < reach {
                kept.extend_from_slice(points);
                return;
            }
            if distance - radius < reach {
                in_reach.push(edge);
            }
        }
        match node.children {
            _ if in_reach.is_empty() => {
                if self.surrounds(center) {
                    kept.extend_from_slice(points);
                }
            }
            Some((left, right)) => {
                self.crop_node(tree, left, &in_reach, reach, kept);
                self.crop_node(tree, right, &in_reach, reach, kept);
            }
            None => kept.extend(points.iter().copied().filter(|point| {
                let place = point.truncate();
                in_reach.iter().any(|&edge| self.edge_distance_squared(edge, place) < reach * reach)
                    || self.surrounds(place)
            })),
        }
    }

    fn edge_distance_squared(&self, edge: usize, point: DVec2) -> f64 {
        segment_distance_squared(point, self.corners[edge], self.corners[(edge + 1) % self.corners.len()])
    }

    /// True if a ray from the point crosses the outline an odd number of times.
    fn surrounds(&self, point: DVec2) -> bool {
        let mut inside = false;
        for (index, &a) in self.corners.iter().enumerate() {
            let b = self.corners[(index + 1) % self.corners.len()];
            if (a.y > point.y) != (b.y > point.y) && point.x < (b.x - a.x) * (point.y - a.y) / (b.y - a.y) + a.x {
                inside = !inside;
            }
        }
        inside
    }
}

/// Cell grid of the points that are not yet on the outline.
struct Grid {
    points: Vec<DVec2>,
    cells: Vec<Vec<usize>>,
    origin: DVec2,
    cell: f64,
    columns: usize,
    rows: usize,
}

impl Grid {
    fn new(mut points: Vec<DVec2>, hull: &[DVec2]) -> Self {
        points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        points.dedup();
        let corners: BTreeSet<[u64; 2]> = hull.iter().map(|corner| corner.to_array().map(f64::to_bits)).collect();
        points.retain(|point| !corners.contains(&point.to_array().map(f64::to_bits)));
        let min = hull.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let max = hull.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let size = max - min;
        let cell = (size.x * size.y / (points.len().max(1) as f64 / 4.0)).sqrt().max(size.max_element() / 256.0);
        let columns = (size.x / cell) as usize + 1;
        let rows = (size.y / cell) as usize + 1;
        let mut grid = Self { points, cells: vec![Vec::new(); columns * rows], origin: min, cell, columns, rows };
        for index in 0..grid.points.len() {
            let (column, row) = grid.cell_of(grid.points[index]);
            grid.cells[row * columns + column].push(index);
        }
        grid
    }

    fn cell_of(&self, point: DVec2) -> (usize, usize) {
        let place = ((point - self.origin) / self.cell).max(DVec2::ZERO);
        ((place.x as usize).min(self.columns - 1), (place.y as usize).min(self.rows - 1))
    }

    /// Points within a distance of a segment that satisfy `wanted`, nearest first, with their squared distances.
    fn near(&self, a: DVec2, b: DVec2, limit_squared: f64, wanted: impl Fn(f64, DVec2) -> bool) -> Vec<(f64, usize)> {
        let reach = DVec2::splat(limit_squared.sqrt());
        let (left, bottom) = self.cell_of(a.min(b) - reach);
        let (right, top) = self.cell_of(a.max(b) + reach);
        let half = DVec2::splat(self.cell * 0.5);
        let circle = half.length() + reach.x;
        let mut found = Vec::new();
        for row in bottom..=top {
            for column in left..=right {
                let middle = self.origin + DVec2::new(column as f64, row as f64) * self.cell + half;
                let list = &self.cells[row * self.columns + column];
                if list.is_empty() || segment_distance_squared(middle, a, b) > circle * circle {
                    continue;
                }
                for &index in list {
                    let distance = segment_distance_squared(self.points[index], a, b);
                    if distance <= limit_squared && wanted(distance, self.points[index]) {
                        found.push((distance, index));
                    }
                }
            }
        }
        found.sort_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
        found
    }

    fn remove(&mut self, index: usize) {
        let (column, row) = self.cell_of(self.points[index]);
        self.cells[row * self.columns + column].retain(|&other| other != index);
    }
}

/// A ring of corners as a linked list: corner, previous, next.
type Ring = Vec<(DVec2, usize, usize)>;

fn dig(hull: &[DVec2], mut grid: Grid) -> Vec<DVec2> {
    let count = hull.len();
    let mut ring: Ring = hull
        .iter()
        .enumerate()
        .map(|(index, &corner)| (corner, (index + count - 1) % count, (index + 1) % count))
        .collect();
    let mut queue: VecDeque<usize> = (0..count).collect();
    while let Some(node) = queue.pop_front() {
        let (b, previous, next) = ring[node];
        let c = ring[next].0;
        let limit = (b - c).length_squared() / (CONCAVITY * CONCAVITY);
        let (a, d) = (ring[previous].0, ring[ring[next].2].0);
        let nearest_here = |distance: f64, point: DVec2| {
            distance < segment_distance_squared(point, a, b) && distance < segment_distance_squared(point, c, d)
        };
        let candidate = grid.near(b, c, limit, nearest_here).into_iter().find(|&(_, index)| {
            let point = grid.points[index];
            crosses_nothing(&ring, b, point) && crosses_nothing(&ring, c, point)
        });
        let Some((_, index)) = candidate else { continue };
        let point = grid.points[index];
        if (point - b).length_squared().min((point - c).length_squared()) > limit {
            continue;
        }
        let inserted = ring.len();
        ring.push((point, node, next));
        ring[node].2 = inserted;
        ring[next].1 = inserted;
        grid.remove(index);
        queue.extend([node, inserted]);
    }
    let mut corners = Vec::with_capacity(ring.len());
    let mut node = 0;
    for _ in 0..ring.len() {
        corners.push(ring[node].0);
        node = ring[node].2;
    }
    corners
}

fn crosses_nothing(ring: &Ring, a: DVec2, b: DVec2) -> bool {
    let (low, high) = (a.min(b), a.max(b));
    ring.iter().all(|&(p, _, next)| {
        let q = ring[next].0;
        let apart = p.min(q).cmpgt(high).any() || p.max(q).cmplt(low).any();
        apart || p == b || q == a || {
            let left = |u: DVec2, v: DVec2, w: DVec2| (v - u).perp_dot(w - u) > 0.0;
            left(p, q, a) == left(p, q, b) || left(a, b, p) == left(a, b, q)
        }
    })
}

fn segment_distance_squared(point: DVec2, a: DVec2, b: DVec2) -> f64 {
    let along = b - a;
    let length_squared = along.length_squared();
    let t = if length_squared > 0.0 { ((point - a).dot(along) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
    (a + along * t - point).length_squared()
}
