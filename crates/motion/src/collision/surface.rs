//! Surfaces of many facets (cloud points or mesh triangles): a bounding volume hierarchy for exact queries, a distance
//! field for the fast path.
//!
//! Each node has eight children, tested with one SIMD operation.

use glam::DVec3;

use super::body::{Body, MovingBody};
use super::convex::{Ball, Separation};
use super::fast_piece::FastPiece;
use super::field::DistanceField;
use super::lane_geometry::{Point, ROUNDING};
use super::lanes::{LANES, Lanes, lanes_of};
use super::probe::Probe;
use super::triangle::Triangle;
use crate::rigid::Rigid;

/// Stack size of the deepest tree: each level adds seven nodes.
const STACK_SIZE: usize = 64;

/// An immutable surface, world frame, shared by all worlds that contain it.
#[derive(Clone, Debug)]
pub(crate) struct Surface {
    facets: Facets,
    /// Radius by which facets are inflated (m).
    radius: f64,
    /// Levels of the hierarchy: facets in groups of eight, then groups of groups, up to a single one.
    levels: Vec<Vec<Node>>,
    pub(super) field: DistanceField,
    /// Bounding sphere of the surface, world frame.
    pub(super) ball: Ball,
}

/// Facets, world frame, sorted so that aligned groups of eight, sixty-four, … are spatial neighbours.
#[derive(Clone, Debug)]
pub(super) enum Facets {
    Points(Vec<DVec3>),
    Triangles(Vec<Triangle>),
}

/// Bounding spheres of eight facets or of eight nodes of the level below; the last group may be smaller.
#[derive(Clone, Copy, Debug)]
struct Node {
    balls: [Ball; LANES],
    count: usize,
    centers: Point,
    radii: Lanes,
}

impl Surface {
    pub(super) fn new(mut facets: Facets, radius: f64) -> Self {
        let balls = match &mut facets {
            Facets::Points(points) => sort(points),
            Facets::Triangles(triangles) => sort(triangles),
        };
        let mut levels = vec![nodes_of(&balls)];
        while let Some(top) = levels.last().filter(|top| top.len() > 1) {
            let balls: Vec<Ball> = top.iter().map(Node::ball).collect();
            levels.push(nodes_of(&balls));
        }
        let [low, high] = match &facets {
            Facets::Points(points) => bounds(points),
            Facets::Triangles(triangles) => bounds(triangles),
        };
        let field = DistanceField::new([low, high], radius, facets.smallest_cell(), |cell, mark| match &facets {
            Facets::Points(points) => points.iter().for_each(|point| mark(*point, *point)),
            Facets::Triangles(triangles) => triangles.iter().for_each(|triangle| triangle.subdivide(cell, mark)),
        });
        let around = Ball::around(levels.last().into_iter().flatten().map(Node::ball));
        let ball = Ball { radius: around.radius + radius, ..around };
        Self { facets, radius, levels, field, ball }
    }

    pub(super) fn facet_count(&self) -> usize {
        self.facets.len()
    }

    /// True if a body is closer than `margin` (m) to the surface; relaxed facets have their own clearance.
    pub(super) fn closer_than(
        &self,
        body: &Body,
        world_from_body: &Rigid,
        margin: f64,
        relaxed_facets: &RelaxedFacets,
    ) -> bool {
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
                    && relaxed_facets.margin(body, facet).is_none_or(|own| {
                        let found = self.facet_separation(facet, &probe, &core_from_world, margin);
                        matches!(found, Separation::Within(distance) if distance < own)
                    })
            })
        })
    }

    /// Distance of a body (m) if it is at most `margin`; relaxed facets count only if closer than their own clearance.
    pub(super) fn separation(
        &self,
        body: &Body,
        world_from_body: &Rigid,
        margin: f64,
        relaxed_facets: &RelaxedFacets,
    ) -> Separation {
        let mut nearest = Separation::Beyond;
        self.each_near(body, world_from_body, margin, |facet, distance| {
            let counts = relaxed_facets.margin(body, facet).is_none_or(|own| distance < own);
            if counts && !matches!(nearest, Separation::Within(other) if other <= distance) {
                nearest = Separation::Within(distance);
            }
        });
        nearest
    }

    /// Calls `visit` with every facet within `margin` of a piece of the body, and its distance.
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

    /// True if `test` holds for any facet that may be within `reach` of the piece's core.
    fn any(&self, probe: &Probe, core_from_world: &Rigid, reach: f64, test: &mut impl FnMut(usize) -> bool) -> bool {
        let core = FastPiece::new(&probe.piece.core, 0.0, core_from_world);
        let mut stack = [(0, 0); STACK_SIZE];
        stack[0] = (self.levels.len() - 1, 0);
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (level, index) = stack[count];
            let node = &self.levels[level][index];
            let farthest = node.radii + Lanes::all(reach as f32 + ROUNDING);
            let near = (core.squared_distance(&node.centers) - farthest * farthest).not_positive();
            for lane in lanes_of(near).take_while(|lane| *lane < node.count) {
                let child = index * LANES + lane;
                if level == 0 {
                    if test(child) {
                        return true;
                    }
                    continue;
                }
                let Ball { center, radius } = node.balls[lane];
                if !probe.is_roughly_beyond(core_from_world.point(center), reach + radius) {
                    stack[count] = (level - 1, child);
                    count += 1;
                }
            }
        }
        false
    }
}

impl Node {
    fn new(balls: &[Ball]) -> Self {
        let ball = |lane: usize| balls[lane.min(balls.len() - 1)];
        let center = |axis: usize| Lanes::from_array(std::array::from_fn(|lane| ball(lane).center[axis] as f32));
        let count = balls.len();
        let balls: [Ball; LANES] = std::array::from_fn(ball);
        // Enlarged by an upper bound of the error from rounding centres to single precision.
        let rounded = |ball: Ball| (ball.radius + 1e-7 * (ball.radius + ball.center.abs().max_element())) as f32;
        Self { count, centers: [center(0), center(1), center(2)], radii: Lanes::from_array(balls.map(rounded)), balls }
    }

    fn ball(&self) -> Ball {
        Ball::around(self.balls[..self.count].iter().copied())
    }
}

fn nodes_of(balls: &[Ball]) -> Vec<Node> {
    balls.chunks(LANES).map(Node::new).collect()
}

/// Facets with a reduced clearance for a body that is near them at the start or goal of a motion.
#[derive(Clone, Debug, Default)]
pub(super) struct RelaxedFacets {
    /// Body, index of the facet and clearance (m), sorted.
    facets: Vec<(MovingBody, u32, f64)>,
}

impl RelaxedFacets {
    /// Reduces the clearance of `body` from `facet` to `margin`.
    pub(super) fn add(&mut self, body: &Body, facet: usize, margin: f64) {
        match self.find(body, facet) {
            Ok(index) => self.facets[index].2 = self.facets[index].2.min(margin),
            Err(index) => self.facets.insert(index, (body.id, facet as u32, margin)),
        }
    }

    /// True if the body has any relaxed facet.
    pub(super) fn any(&self, body: &Body) -> bool {
        self.facets.iter().any(|(id, ..)| *id == body.id)
    }

    fn margin(&self, body: &Body, facet: usize) -> Option<f64> {
        self.find(body, facet).ok().map(|index| self.facets[index].2)
    }

    fn find(&self, body: &Body, facet: usize) -> Result<usize, usize> {
        self.facets.binary_search_by(|(id, other, _)| (*id, *other).cmp(&(body.id, facet as u32)))
    }
}

fn probes<'a>(body: &Body<'a>) -> impl Iterator<Item = Probe<'a>> + use<'a> {
    body.pieces.iter().zip(body.planes).map(|(piece, planes)| Probe::new(piece, planes))
}

/// Point or triangle of a [`Surface`].
trait Facet: Copy {
    fn low(&self) -> DVec3;
    fn high(&self) -> DVec3;
    fn ball(&self) -> Ball;
}

impl Facet for DVec3 {
    fn low(&self) -> DVec3 {
        *self
    }

    fn high(&self) -> DVec3 {
        *self
    }

    fn ball(&self) -> Ball {
        Ball { center: *self, radius: 0.0 }
    }
}

impl Facet for Triangle {
    fn low(&self) -> DVec3 {
        self.0[0].min(self.0[1]).min(self.0[2])
    }

    fn high(&self) -> DVec3 {
        self.0[0].max(self.0[1]).max(self.0[2])
    }

    fn ball(&self) -> Ball {
        let center = (self.low() + self.high()) / 2.0;
        Ball { center, radius: self.0.iter().map(|corner| corner.distance(center)).fold(0.0, f64::max) }
    }
}

impl Facets {
    fn len(&self) -> usize {
        match self {
            Self::Points(points) => points.len(),
            Self::Triangles(triangles) => triangles.len(),
        }
    }

    /// Cell size of the distance field (m) for which subdividing all triangles stays cheap.
    fn smallest_cell(&self) -> f64 {
        const PIECES: f64 = 4e6;
        let Self::Triangles(triangles) = self else { return 0.0 };
        let area: f64 = triangles.iter().map(Triangle::area).sum();
        let perimeter: f64 = triangles.iter().map(Triangle::perimeter).sum();
        (8.0 * area / PIECES).sqrt().max(4.0 * perimeter / PIECES)
    }
}

fn bounds<F: Facet>(facets: &[F]) -> [DVec3; 2] {
    let wider = |[low, high]: [DVec3; 2], facet: &F| [low.min(facet.low()), high.max(facet.high())];
    facets.iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], wider)
}

/// Sorts facets spatially and returns their bounding spheres.
fn sort<F: Facet>(facets: &mut [F]) -> Vec<Ball> {
    sort_spatially(facets);
    facets.iter().map(Facet::ball).collect()
}

/// Splits facets recursively across their longest extent, at multiples of the largest power of eight.
fn sort_spatially<F: Facet>(facets: &mut [F]) {
    let mut unit = 1;
    while unit * LANES < facets.len() {
        unit *= LANES;
    }
    if unit < LANES {
        return;
    }
    let [low, high] = bounds(facets);
    let axis = (high - low).max_position();
    let middle = |facet: &F| facet.low()[axis] + facet.high()[axis];
    let half = facets.len().div_ceil(unit).div_ceil(2) * unit;
    facets.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
    let (low, high) = facets.split_at_mut(half);
    sort_spatially(low);
    sort_spatially(high);
}
