//! Bounding volume hierarchy (BVH), split by the surface-area heuristic (Wald, "On fast Construction of SAH-based
//! Bounding Volume Hierarchies", 2007).

use glam::Vec3A;

/// Largest number of triangles in a leaf; exceeded only if all centres coincide. Chosen by hand.
const LEAF: usize = 4;
/// Number of bins per axis, whose borders are the candidate splits. Chosen by hand.
const BINS: usize = 16;
/// Capacity of the traversal stack: enough for 2³² triangles in a tree twice as deep as a balanced one.
const DEPTH: usize = 64;
/// Smallest hit distance (m), against self-intersection; the planes of slivers are accurate to a tenth of a millimetre.
const NEAREST_M: f32 = 1e-4;

/// Relative enlargement of triangles in intersection tests, which closes gaps between slivers.
const OVERLAP: f32 = 1e-4;

/// Triangles with their hierarchy of bounding boxes.
#[derive(Debug, Default)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
}

/// Triangle of a part in world coordinates (m).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triangle {
    corner: Vec3A,
    /// Edges from the first vertex to the others.
    edges: [Vec3A; 2],
    pub part: u32,
    pub index: u32,
}

/// Nearest intersection of a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    pub distance: f32,
    pub part: usize,
    pub triangle: usize,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    /// Index of a leaf's first triangle, or of an inner node's first child.
    first: u32,
    /// Number of triangles; 0 for an inner node.
    count: u32,
}

#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: Vec3A,
    high: Vec3A,
}

impl Triangle {
    pub fn new([a, b, c]: [Vec3A; 3], part: usize, index: usize) -> Self {
        Self { corner: a, edges: [b - a, c - a], part: part as u32, index: index as u32 }
    }

    fn bounds(&self) -> Bounds {
        let [ab, ac] = self.edges;
        Bounds { low: self.corner + ab.min(ac).min(Vec3A::ZERO), high: self.corner + ab.max(ac).max(Vec3A::ZERO) }
    }

    fn center(&self) -> Vec3A {
        self.corner + (self.edges[0] + self.edges[1]) * (1.0 / 3.0)
    }

    /// Distance along a ray to the triangle; `None` if it misses (Möller and Trumbore, 1997).
    #[inline(always)]
    fn hit(&self, origin: Vec3A, direction: Vec3A) -> Option<f32> {
        let [ab, ac] = self.edges;
        let across = direction.cross(ac);
        let determinant = ab.dot(across);
        if determinant == 0.0 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let from = origin - self.corner;
        let u = from.dot(across) * inverse;
        let up = from.cross(ab);
        let v = direction.dot(up) * inverse;
        let distance = ac.dot(up) * inverse;
        let inside = u >= -OVERLAP && v >= -OVERLAP && u + v <= 1.0 + OVERLAP;
        (inside && distance > NEAREST_M).then_some(distance)
    }
}

impl Bounds {
    const NONE: Self = Self { low: Vec3A::INFINITY, high: Vec3A::NEG_INFINITY };

    fn joined(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Half the surface area of the box (m²); 0 for an empty box.
    fn area(&self) -> f32 {
        let size = (self.high - self.low).max(Vec3A::ZERO);
        size.x * size.y + size.y * size.z + size.z * size.x
    }

    /// Distance at which a ray enters the box; infinite if it misses or enters beyond `limit`.
    #[inline(always)]
    fn entered(&self, origin: Vec3A, inverse: Vec3A, limit: f32) -> f32 {
        let (one, other) = ((self.low - origin) * inverse, (self.high - origin) * inverse);
        let (near, far) = (one.min(other).max_element(), one.max(other).min_element());
        if near <= far && far >= 0.0 && near < limit { near } else { f32::INFINITY }
    }
}

impl Bvh {
    pub fn new(mut triangles: Vec<Triangle>) -> Self {
        let mut nodes = vec![Node { bounds: Bounds::NONE, first: 0, count: triangles.len() as u32 }];
        let mut open = vec![(0_usize, 1_usize)];
        while let Some((node, depth)) = open.pop() {
            let range = nodes[node].first as usize..(nodes[node].first + nodes[node].count) as usize;
            let own = &mut triangles[range.clone()];
            nodes[node].bounds = own.iter().fold(Bounds::NONE, |all, triangle| all.joined(triangle.bounds()));
            let Some(middle) = (own.len() > LEAF && depth < DEPTH).then(|| split(own)).flatten() else { continue };
            let below = nodes.len();
            for part in [range.start..range.start + middle, range.start + middle..range.end] {
                nodes.push(Node { bounds: Bounds::NONE, first: part.start as u32, count: part.len() as u32 });
            }
            (nodes[node].first, nodes[node].count) = (below as u32, 0);
            open.extend([(below, depth + 1), (below + 1, depth + 1)]);
        }
        Self { nodes, triangles }
    }

    /// Nearest hit of a ray with unit direction.
    pub fn nearest(&self, origin: Vec3A, direction: Vec3A) -> Option<Hit> {
        let mut hit: Option<Hit> = None;
        self.walk(origin, direction, |triangle, distance| {
            if hit.is_none_or(|known| distance < known.distance) {
                hit = Some(Hit { distance, part: triangle.part as usize, triangle: triangle.index as usize });
            }
            hit.map_or(f32::INFINITY, |known| known.distance)
        });
        hit
    }

    /// Visits the triangles that a ray hits, in any order; `call` returns the distance up to which further hits matter.
    #[inline(always)]
    pub fn walk(&self, origin: Vec3A, direction: Vec3A, mut call: impl FnMut(&Triangle, f32) -> f32) {
        let inverse = direction.recip();
        let mut limit = f32::INFINITY;
        let mut stack = [(0_u32, 0.0_f32); DEPTH + 1];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (index, entered) = stack[height];
            if entered >= limit {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                for triangle in &self.triangles[node.first as usize..(node.first + node.count) as usize] {
                    if let Some(distance) = triangle.hit(origin, direction).filter(|&distance| distance < limit) {
                        limit = limit.min(call(triangle, distance));
                    }
                }
                continue;
            }
            let below = [node.first, node.first + 1]
                .map(|index| (index, self.nodes[index as usize].bounds.entered(origin, inverse, limit)));
            let (near, far) = if below[0].1 <= below[1].1 { (below[0], below[1]) } else { (below[1], below[0]) };
            for next in [far, near].into_iter().filter(|next| next.1 < f32::INFINITY) {
                stack[height] = next;
                height += 1;
            }
        }
    }
}

/// Partitions triangles at the cheapest split and returns the size of the left part; `None` if no split pays off.
fn split(triangles: &mut [Triangle]) -> Option<usize> {
    let (low, high) = triangles.iter().fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(low, high), triangle| {
        (low.min(triangle.center()), high.max(triangle.center()))
    });
    let scale = (high - low).max(Vec3A::splat(1e-12)).recip() * BINS as f32;
    let bin =
        move |triangle: &Triangle, axis: usize| (((triangle.center() - low) * scale)[axis] as usize).min(BINS - 1);
    let mut best = (f32::INFINITY, 0, 0);
    for axis in 0..3 {
        let mut bins = [(Bounds::NONE, 0_usize); BINS];
        for triangle in &*triangles {
            let (bounds, count) = &mut bins[bin(triangle, axis)];
            (*bounds, *count) = (bounds.joined(triangle.bounds()), *count + 1);
        }
        let join = |a: (Bounds, usize), b: &(Bounds, usize)| (a.0.joined(b.0), a.1 + b.1);
        for place in 1..BINS {
            let (left, right) = bins.split_at(place);
            let [left, right] = [left, right].map(|side| side.iter().fold((Bounds::NONE, 0), join));
            let cost = left.0.area() * left.1 as f32 + right.0.area() * right.1 as f32;
            if left.1 > 0 && right.1 > 0 && cost < best.0 {
                best = (cost, axis, place);
            }
        }
    }
    let (cost, axis, place) = best;
    if cost.is_infinite() {
        return None;
    }
    triangles.sort_unstable_by_key(|triangle| (bin(triangle, axis) >= place, triangle.part, triangle.index));
    Some(triangles.partition_point(|triangle| bin(triangle, axis) < place))
}
