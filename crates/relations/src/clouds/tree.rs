//! A k-d tree with bounding boxes.

use glam::DVec3;

/// Maximum number of points per leaf. Chosen by hand.
const LEAF: usize = 32;

/// Balanced k-d tree over the points of a cloud.
#[derive(Debug)]
pub(crate) struct Tree {
    pub points: Vec<DVec3>,
    pub nodes: Vec<Node>,
}

/// A box around a range of points; inner nodes have two children.
#[derive(Debug)]
pub(crate) struct Node {
    pub min: DVec3,
    pub max: DVec3,
    pub start: usize,
    pub end: usize,
    /// Indices of the left and the right child; `None` for a leaf.
    pub children: Option<(usize, usize)>,
}

impl Tree {
    pub fn new(points: &[DVec3]) -> Self {
        let mut tree = Self { points: points.to_vec(), nodes: Vec::with_capacity(points.len() / 4 + 2) };
        tree.split(0, points.len());
        tree
    }

    /// True if a point of this cloud and one of the other are at most `distance` (m) apart; without `with_height`, in
    /// the top view.
    pub fn has_pair_within(&self, other: &Self, distance: f64, with_height: bool) -> bool {
        let mask = if with_height { DVec3::ONE } else { DVec3::new(1.0, 1.0, 0.0) };
        let limit = distance * distance;
        let mut stack = vec![(0, 0)];
        while let Some((i, j)) = stack.pop() {
            let (a, b) = (&self.nodes[i], &other.nodes[j]);
            let apart = ((a.min - b.max).max(b.min - a.max).max(DVec3::ZERO) * mask).length_squared();
            if apart > limit {
                continue;
            }
            let farthest = ((a.max - b.min).max(b.max - a.min) * mask).length_squared();
            if farthest <= limit {
                return true;
            }
            match (a.children, b.children) {
                (None, None) => {
                    let found = self.points[a.start..a.end].iter().any(|&p| {
                        other.points[b.start..b.end].iter().any(|&q| ((p - q) * mask).length_squared() <= limit)
                    });
                    if found {
                        return true;
                    }
                }
                (Some((left, right)), _) if b.children.is_none() || a.end - a.start >= b.end - b.start => {
                    self.push_nearer_last(&mut stack, [(left, j), (right, j)], other, mask);
                }
                (_, Some((left, right))) => {
                    self.push_nearer_last(&mut stack, [(i, left), (i, right)], other, mask);
                }
                (Some(_), None) => {}
            }
        }
        false
    }

    /// Shortest distance between the two clouds in the top view (m).
    pub fn planar_distance(&self, other: &Self) -> f64 {
        let mask = DVec3::new(1.0, 1.0, 0.0);
        let mut best = f64::INFINITY;
        let mut stack = vec![(0, 0)];
        while let Some((i, j)) = stack.pop() {
            let (a, b) = (&self.nodes[i], &other.nodes[j]);
            if ((a.min - b.max).max(b.min - a.max).max(DVec3::ZERO) * mask).length_squared() >= best {
                continue;
            }
            match (a.children, b.children) {
                (None, None) => {
                    for &p in &self.points[a.start..a.end] {
                        for &q in &other.points[b.start..b.end] {
                            best = best.min(((p - q) * mask).length_squared());
                        }
                    }
                }
                (Some((left, right)), _) if b.children.is_none() || a.end - a.start >= b.end - b.start => {
                    self.push_nearer_last(&mut stack, [(left, j), (right, j)], other, mask);
                }
                (_, Some((left, right))) => {
                    self.push_nearer_last(&mut stack, [(i, left), (i, right)], other, mask);
                }
                (Some(_), None) => {}
            }
        }
        best.sqrt()
    }

    /// The farthest point along a direction.
    pub fn farthest(&self, direction: DVec3) -> DVec3 {
        let reach = |node: &Node| direction.dot(DVec3::select(direction.cmpge(DVec3::ZERO), node.max, node.min));
        let mut best = (f64::NEG_INFINITY, DVec3::ZERO);
        let mut stack = vec![0];
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index];
            if reach(node) <= best.0 {
                continue;
            }
            match node.children {
                Some((left, right)) if reach(&self.nodes[left]) > reach(&self.nodes[right]) => {
                    stack.extend([right, left]);
                }
                Some((left, right)) => stack.extend([left, right]),
                None => {
                    for &point in &self.points[node.start..node.end] {
                        let along = direction.dot(point);
                        if along > best.0 {
                            best = (along, point);
                        }
                    }
                }
            }
        }
        best.1
    }

    /// Pushes the nearer pair last, so that it is processed first.
    fn push_nearer_last(&self, stack: &mut Vec<(usize, usize)>, pairs: [(usize, usize); 2], other: &Self, mask: DVec3) {
        let middle = |(i, j): (usize, usize)| {
            let (a, b) = (&self.nodes[i], &other.nodes[j]);
            ((a.min + a.max - b.min - b.max) * mask).length_squared()
        };
        let [first, second] = pairs;
        if middle(first) < middle(second) {
            stack.extend([second, first]);
        } else {
            stack.extend([first, second]);
        }
    }

    fn split(&mut self, start: usize, end: usize) -> usize {
        let points = &mut self.points[start..end];
        let min = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let max = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let index = self.nodes.len();
        self.nodes.push(Node { min, max, start, end, children: None });
        if end - start > LEAF {
            let size = max - min;
            let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
            let middle = (end - start) / 2;
            self.points[start..end].select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
            let left = self.split(start, start + middle);
            let right = self.split(start + middle, end);
            self.nodes[index].children = Some((left, right));
        }
        index
    }
}
