//! Surfaces of many small facets, the points of a cloud or the triangles of a mesh: a tree of balls for exact answers,
//! a field of gaps for the fast path.

use glam::DVec3;

use super::bodies::Body;
use super::convex::{Ball, Separation};
use super::field::Field;
use super::probe::{Probe, Triangle};
use crate::rigid::Rigid;

/// Facets that are not divided further.
const LEAF: usize = 8;

/// An immutable surface in the world, built once and shared by all worlds that hold it.
#[derive(Clone, Debug)]
pub(crate) struct Surface {
    facets: Facets,
    /// Everything within this distance of a facet belongs to the surface.
    radius: f64,
    /// The root first; children after their parents.
    nodes: Vec<Node>,
    pub(super) field: Field,
    /// Ball around the surface.
    pub(super) ball: Ball,
}

/// World frame; in the order of the tree's leaves.
#[derive(Clone, Debug)]
pub(super) enum Facets {
    Points(Vec<DVec3>),
    Triangles(Vec<Triangle>),
}

/// A ball around facets that stand next to each other.
#[derive(Clone, Copy, Debug)]
struct Node {
    center: DVec3,
    radius: f64,
    first: u32,
    count: u32,
    /// Index of the second child, the first follows its parent; 0 for a leaf.
    second: u32,
}

impl Surface {
    pub(super) fn new(mut facets: Facets, radius: f64) -> Self {
        let mut nodes = Vec::with_capacity(2 * facets.len().div_ceil(LEAF));
        match &mut facets {
            Facets::Points(points) => divide(points, 0, &mut nodes),
            Facets::Triangles(triangles) => divide(triangles, 0, &mut nodes),
        }
        let bounds = match &facets {
            Facets::Points(points) => bounds(points),
            Facets::Triangles(triangles) => bounds(triangles),
        };
        let field = Field::new([bounds.min, bounds.max], radius, facets.smallest_cell(), |cell, mark| match &facets {
            Facets::Points(points) => points.iter().for_each(|point| mark(*point, *point)),
            Facets::Triangles(triangles) => triangles.iter().for_each(|triangle| triangle.cut(cell, mark)),
        });
        let ball = nodes.first().map_or(Ball { center: DVec3::ZERO, radius: 0.0 }, |root| Ball {
            center: root.center,
            radius: root.radius + radius,
        });
        Self { facets, radius, nodes, field, ball }
    }

    pub(super) fn facet_count(&self) -> usize {
        self.facets.len()
    }

    /// Whether a body comes within `margin` of the surface; `excused` facets keep distances of their own.
    pub(super) fn closer_than(&self, body: &Body, world_from_body: &Rigid, margin: f64, excused: &Excused) -> bool {
        probes(body).any(|probe| {
            let core_from_world = (*world_from_body * probe.piece.owner_from_core).inverse();
            let reach = margin + probe.piece.radius + self.radius;
            self.any(&probe, &core_from_world, reach, &mut |facet| {
                let touches = match &self.facets {
                    Facets::Points(points) => probe.touches_point(core_from_world.point(points[facet]), reach),
                    Facets::Triangles(triangles) => {
                        probe.touches_triangle(&triangles[facet].moved(&core_from_world), reach)
                    }
                };
                touches
                    && excused.margin(body, facet).is_none_or(|own| {
                        let found = self.facet_separation(facet, &probe, &core_from_world, margin);
                        matches!(found, Separation::Within(distance) if distance < own)
                    })
            })
        })
    }

    /// The distance of a body if it is at most `margin`; of excused facets only those count that are too near.
    pub(super) fn separation(
        &self,
        body: &Body,
        world_from_body: &Rigid,
        margin: f64,
        excused: &Excused,
    ) -> Separation {
        let mut nearest = Separation::Beyond;
        self.each_near(body, world_from_body, margin, |facet, distance| {
            let counts = excused.margin(body, facet).is_none_or(|own| distance < own);
            if counts && !matches!(nearest, Separation::Within(other) if other <= distance) {
                nearest = Separation::Within(distance);
            }
        });
        nearest
    }

    /// Calls `visit` with every facet within `margin` of a piece of the body, and their distance.
    pub(super) fn each_near(
        &self,
        body: &Body,
        world_from_body: &Rigid,
        margin: f64,
        mut visit: impl FnMut(usize, f64),
    ) {
        let margin = margin.max(0.0);
        for probe in probes(body) {
            let core_from_world = (*world_from_body * probe.piece.owner_from_core).inverse();
            let reach = margin + probe.piece.radius + self.radius;
            self.any(&probe, &core_from_world, reach, &mut |facet| {
                if let Separation::Within(distance) = self.facet_separation(facet, &probe, &core_from_world, margin) {
                    visit(facet, distance);
                }
                false
            });
        }
    }

    fn facet_separation(&self, facet: usize, probe: &Probe, core_from_world: &Rigid, limit: f64) -> Separation {
        match &self.facets {
            Facets::Points(points) => {
                probe.separation_of_point(core_from_world.point(points[facet]), self.radius, limit)
            }
            Facets::Triangles(triangles) => {
                probe.separation_of_triangle(&triangles[facet].moved(core_from_world), limit)
            }
        }
    }

    /// Whether `test` holds for any facet that may come within `reach` of the piece's core, nearer ones first.
    fn any(&self, probe: &Probe, core_from_world: &Rigid, reach: f64, test: &mut impl FnMut(usize) -> bool) -> bool {
        let bound = |index: usize| {
            let node = &self.nodes[index];
            probe.bound(core_from_world.point(node.center), reach + node.radius) - node.radius
        };
        // A balanced tree of 2³² leaves is no deeper.
        let mut stack = [0_usize; 40];
        let mut depth = 0;
        let mut current = (!self.nodes.is_empty() && bound(0) <= reach).then_some(0);
        while let Some(index) = current.take().or_else(|| {
            depth = usize::checked_sub(depth, 1)?;
            Some(stack[depth])
        }) {
            let node = &self.nodes[index];
            if node.second == 0 {
                let first = node.first as usize;
                if (first..first + node.count as usize).any(&mut *test) {
                    return true;
                }
                continue;
            }
            let children = [index + 1, node.second as usize];
            let [a, b] = children.map(bound);
            let [near, far] = if a <= b { children } else { [children[1], children[0]] };
            if a.max(b) <= reach {
                stack[depth] = far;
                depth += 1;
            }
            current = (a.min(b) <= reach).then_some(near);
        }
        false
    }
}

/// Facets that a body may come nearer to than to the others: it is near them at the start or goal of the motion.
#[derive(Clone, Debug, Default)]
pub(super) struct Excused {
    /// Part, facet and distance to keep, sorted.
    facets: Vec<(super::world::Part, u32, f64)>,
}

impl Excused {
    /// From now on `body` keeps `margin` from `facet`, or less when that was granted before.
    pub(super) fn add(&mut self, body: &Body, facet: usize, margin: f64) {
        match self.find(body, facet) {
            Ok(index) => self.facets[index].2 = self.facets[index].2.min(margin),
            Err(index) => self.facets.insert(index, (body.part, facet as u32, margin)),
        }
    }

    fn margin(&self, body: &Body, facet: usize) -> Option<f64> {
        self.find(body, facet).ok().map(|index| self.facets[index].2)
    }

    fn find(&self, body: &Body, facet: usize) -> Result<usize, usize> {
        self.facets.binary_search_by(|(part, other, _)| (*part, *other).cmp(&(body.part, facet as u32)))
    }
}

fn probes<'a>(body: &Body<'a>) -> impl Iterator<Item = Probe<'a>> + use<'a> {
    body.pieces.iter().zip(body.planes).map(|(piece, planes)| Probe::new(piece, planes))
}

/// What a tree can be built of.
trait Facet: Copy {
    fn low(&self) -> DVec3;
    fn high(&self) -> DVec3;
    /// Distance of its farthest point.
    fn reach_from(&self, center: DVec3) -> f64;
}

impl Facet for DVec3 {
    fn low(&self) -> DVec3 {
        *self
    }

    fn high(&self) -> DVec3 {
        *self
    }

    fn reach_from(&self, center: DVec3) -> f64 {
        self.distance(center)
    }
}

impl Facet for Triangle {
    fn low(&self) -> DVec3 {
        self.0[0].min(self.0[1]).min(self.0[2])
    }

    fn high(&self) -> DVec3 {
        self.0[0].max(self.0[1]).max(self.0[2])
    }

    fn reach_from(&self, center: DVec3) -> f64 {
        self.0.iter().map(|corner| corner.distance(center)).fold(0.0, f64::max)
    }
}

impl Facets {
    fn len(&self) -> usize {
        match self {
            Self::Points(points) => points.len(),
            Self::Triangles(triangles) => triangles.len(),
        }
    }

    /// Cells so large that cutting all triangles into such pieces is done in a moment, m.
    fn smallest_cell(&self) -> f64 {
        const PIECES: f64 = 4e6;
        let Self::Triangles(triangles) = self else { return 0.0 };
        let area: f64 = triangles.iter().map(Triangle::area).sum();
        let perimeter: f64 = triangles.iter().map(Triangle::perimeter).sum();
        (8.0 * area / PIECES).sqrt().max(4.0 * perimeter / PIECES)
    }
}

fn bounds<F: Facet>(facets: &[F]) -> genmanip_core::Aabb {
    let include = |bounds: genmanip_core::Aabb, facet: &F| bounds.including(facet.low()).including(facet.high());
    facets.iter().fold(genmanip_core::Aabb::EMPTY, include)
}

/// Appends the tree of the facets that start at `first`, and puts them into its order.
fn divide<F: Facet>(facets: &mut [F], first: usize, nodes: &mut Vec<Node>) {
    let bounds = bounds(facets);
    let (center, size) = (bounds.center(), bounds.size());
    let radius = facets.iter().map(|facet| facet.reach_from(center)).fold(0.0, f64::max);
    let index = nodes.len();
    nodes.push(Node { center, radius, first: first as u32, count: facets.len() as u32, second: 0 });
    if facets.len() <= LEAF {
        return;
    }
    let axis = size.max_position();
    let middle = |facet: &F| (facet.low() + facet.high())[axis];
    let half = facets.len() / 2;
    facets.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
    let (low, high) = facets.split_at_mut(half);
    divide(low, first, nodes);
    nodes[index].second = nodes.len() as u32;
    divide(high, first + half, nodes);
}
