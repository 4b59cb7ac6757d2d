//! Final collision check of a path: edges in long segments first, then only critical parts in short steps.

use std::cell::RefMut;

use super::checker::Checker;
use super::fast::{self, Scratch, Unresolved};
use super::lanes::{LANES, Lanes, lanes_of};
use crate::path::lerp;
use crate::rigid::Rigid;

/// Maximum length of a segment, in steps of the final spacing: one step per SIMD lane.
const STEPS: usize = LANES;
/// Step length for pairs with a relaxed clearance, as a share of the final spacing. Chosen by hand.
const RELAXED_STEP_SHARE: f64 = 0.2;

impl Checker<'_> {
    /// True if a polyline of states keeps its clearances everywhere.
    pub(crate) fn polyline_is_free(&self, states: &[Vec<f64>], spacing: f64) -> bool {
        self.edges_are_free(states.windows(2).map(|pair| [&*pair[0], &*pair[1]]).collect(), spacing)
    }

    /// True if straight edges keep their clearances everywhere, like `edge_is_free` for each of them.
    ///
    /// Segments with enough clearance are proven free at once by the motion of each body over half of them. Only bodies
    /// that pass near an obstacle are followed in steps of `spacing` (m).
    pub(crate) fn edges_are_free(&self, edges: Vec<[&[f64]; 2]>, spacing: f64) -> bool {
        let speeds: Vec<Vec<f64>> = edges.iter().map(|[from, to]| self.speeds(from, to)).collect();
        let segments_of = |edge: usize| {
            let fastest = speeds[edge].iter().copied().fold(0.0, f64::max);
            let count = (fastest / (spacing * STEPS as f64)).ceil().max(1.0);
            let half = 0.5 / count;
            (0..count as usize).map(move |k| Segment { edge, middle: half * (2 * k + 1) as f64, half })
        };
        let segments: Vec<Segment> = (0..edges.len()).flat_map(segments_of).collect();
        let mut scratch = self.scratch.borrow_mut();
        scratch.config.resize(self.robot.chain.dof(), Lanes::all(0.0));
        let mut query = Query { checker: self, edges, speeds, spacing, scratch };
        let Some(near) = query.check_segments(&segments) else { return false };
        near.iter().all(|near| query.follow(near))
    }

    /// Maximum speed of any point of each body along an edge of unit duration (m per edge).
    fn speeds(&self, from: &[f64], to: &[f64]) -> Vec<f64> {
        let speed =
            |bounds: &Vec<f64>| bounds.iter().zip(from).zip(to).map(|((bound, a), b)| bound * (a - b).abs()).sum();
        self.motion_bounds.iter().map(speed).collect()
    }
}

/// Part of an edge: the state in its middle and half its length, as shares of the edge.
#[derive(Clone, Copy)]
struct Segment {
    edge: usize,
    middle: f64,
    half: f64,
}

/// A body near an obstacle on a segment.
struct NearPass {
    segment: Segment,
    body: usize,
    obstacle: usize,
}

/// Result for a whole segment from its middle state.
enum SegmentState {
    /// The whole segment keeps its clearance.
    Clear,
    /// The segment must be followed in steps.
    Near,
    /// The middle state is in contact.
    Touching,
}

/// A check of several edges.
struct Query<'a, 'c> {
    checker: &'a Checker<'c>,
    edges: Vec<[&'a [f64]; 2]>,
    /// Maximum speed of any point of each body, by edge (m per edge).
    speeds: Vec<Vec<f64>>,
    spacing: f64,
    scratch: RefMut<'a, Scratch>,
}

impl Query<'_, '_> {
    /// Checks whole segments; `None` on contact, otherwise the passes not proven free.
    fn check_segments(&mut self, segments: &[Segment]) -> Option<Vec<NearPass>> {
        let (mut passes, mut unresolved_pairs) = (Vec::new(), Vec::new());
        let batches = segments.len().div_ceil(LANES);
        for batch in 0..batches {
            // Lanes are interleaved over the path to find contacts early.
            let at = |lane: usize| segments[(lane * batches + batch).min(segments.len() - 1)];
            self.set_states(|lane| (at(lane).edge, at(lane).middle));
            let reach = |body: usize, lane: usize| self.speeds[at(lane).edge][body] * at(lane).half;
            let widest = |body: usize| (0..LANES).map(|lane| reach(body, lane)).fold(0.0, f64::max) as f32;
            self.scratch.inflation.clear();
            self.scratch.inflation.extend((0..self.checker.bodies.len()).map(widest));
            if !fast::find_unresolved(&self.checker.fast, &mut self.scratch) {
                return None;
            }
            // Lanes beyond the end repeat the last segment.
            let real = |lane: &usize| lane * batches + batch < segments.len();
            let mut frames: [Option<Vec<Rigid>>; LANES] = Default::default();
            for index in 0..self.scratch.unresolved.len() {
                match self.scratch.unresolved[index] {
                    Unresolved::Obstacle { body, obstacle, lanes } => {
                        for lane in lanes_of(lanes).filter(real) {
                            let near = NearPass { segment: at(lane), body, obstacle };
                            match self.check_middle(&near, &mut frames[lane]) {
                                SegmentState::Touching => return None,
                                SegmentState::Near => passes.push(near),
                                SegmentState::Clear => {}
                            }
                        }
                    }
                    Unresolved::Bodies { pair, lanes } => {
                        unresolved_pairs.extend(lanes_of(lanes).map(|lane| (at(lane).edge, pair)));
                    }
                }
            }
        }
        unresolved_pairs.sort_unstable();
        unresolved_pairs.dedup();
        let is_free = |&(edge, pair): &(usize, usize)| {
            let [from, to] = self.edges[edge];
            self.checker.pair_is_free(&self.checker.body_pairs[pair], from, to, self.spacing)
        };
        unresolved_pairs.iter().all(is_free).then_some(passes)
    }

    /// Exact check of the middle state of a segment near a surface, which the fast path left undecided. It often proves
    /// the whole segment free, and rejects paths through a surface early. `Near` for other obstacles.
    fn check_middle(&self, passes: &NearPass, frames: &mut Option<Vec<Rigid>>) -> SegmentState {
        let NearPass { segment: Segment { edge, middle, half }, body: index, obstacle } = *passes;
        let checker = self.checker;
        let (body, target) = (&checker.bodies[index], &checker.obstacles[obstacle]);
        let margin = checker.obstacle_margin[index * checker.obstacles.len() + obstacle];
        let Some(margin) = margin.filter(|_| target.surface.is_some() && !target.relaxed_facets.any(body)) else {
            return SegmentState::Near;
        };
        let [from, to] = self.edges[edge];
        let frames = frames.get_or_insert_with(|| checker.robot.chain.frames(&lerp(from, to, middle)));
        let world_from_body = frames[body.frame] * body.frame_from_body;
        let is_within = |distance: f64| target.closer_than(body, &world_from_body, distance);
        if !is_within(margin + half * self.speeds[edge][index]) {
            SegmentState::Clear
        } else if is_within(margin) {
            SegmentState::Touching
        } else {
            SegmentState::Near
        }
    }

    /// True if a body keeps its clearance from an obstacle at every step of a segment; the exact check decides.
    fn follow(&mut self, passes: &NearPass) -> bool {
        let NearPass { segment: Segment { edge, middle, half }, body, obstacle } = *passes;
        let checker = self.checker;
        let Some(margin) = checker.obstacle_margin[body * checker.obstacles.len() + obstacle] else { return true };
        // If half a step is within the padding, no contact is possible in between.
        let comes_closer =
            margin < 0.5 * self.spacing || checker.obstacles[obstacle].relaxed_facets.any(&checker.bodies[body]);
        let spacing = if comes_closer { RELAXED_STEP_SHARE * self.spacing } else { self.spacing };
        let batches = (2.0 * half * self.speeds[edge][body] / (spacing * LANES as f64)).ceil().max(1.0) as usize;
        let steps = batches * LANES;
        (0..batches).all(|batch| {
            let time = |lane: usize| middle + half * ((2 * (lane * batches + batch) + 1) as f64 / steps as f64 - 1.0);
            self.set_states(|lane| (edge, time(lane)));
            let Some(lanes) = fast::find_unresolved_lanes(&checker.fast, &mut self.scratch, body, obstacle) else {
                return false;
            };
            let [from, to] = self.edges[edge];
            lanes == 0
                || checker.unresolved_are_free(&[Unresolved::Obstacle { body, obstacle, lanes }], |lane| {
                    lerp(from, to, time(lane))
                })
        })
    }

    /// Fills the lanes with states at shares of edges.
    fn set_states(&mut self, place: impl Fn(usize) -> (usize, f64)) {
        let places: [(usize, f64); LANES] = std::array::from_fn(place);
        for (joint, q) in self.scratch.config.iter_mut().enumerate() {
            *q = Lanes::from_array(places.map(|(edge, time)| {
                let [from, to] = self.edges[edge];
                (from[joint] + (to[joint] - from[joint]) * time) as f32
            }));
        }
    }
}
