//! The final test of a path: straight edges, first in long stretches, then only what is near in short steps.

use std::cell::RefMut;

use super::checker::Checker;
use super::fast::{self, Doubt, Scratch};
use super::lanes::{LANES, Lanes, lanes_of};
use crate::path::lerp;
use crate::rigid::Rigid;

/// Steps at the final spacing into which a stretch is cut where it is not proven clear at once.
const STEPS: usize = LANES;
/// How much closer states are tested of a pair that may come closer than its padding.
const CLOSER: f64 = 0.2;

impl Checker<'_> {
    /// Whether a polyline of states keeps its distances everywhere.
    pub(crate) fn polyline_is_free(&self, states: &[Vec<f64>], spacing: f64) -> bool {
        self.edges_are_free(states.windows(2).map(|pair| [&*pair[0], &*pair[1]]).collect(), spacing)
    }

    /// Whether straight edges keep their distances everywhere: like `edge_is_free` for each of them.
    ///
    /// Stretches are proven clear at once where there is room, by the motion of each body over half of them.
    /// What remains are bodies that pass near an obstacle, and only these are followed in steps of `spacing` metres.
    pub(crate) fn edges_are_free(&self, edges: Vec<[&[f64]; 2]>, spacing: f64) -> bool {
        let speeds: Vec<Vec<f64>> = edges.iter().map(|[from, to]| self.speeds(from, to)).collect();
        let stretches_of = |edge: usize| {
            let fastest = speeds[edge].iter().copied().fold(0.0, f64::max);
            let count = (fastest / (spacing * STEPS as f64)).ceil().max(1.0);
            let half = 0.5 / count;
            (0..count as usize).map(move |k| Stretch { edge, middle: half * (2 * k + 1) as f64, half })
        };
        let stretches: Vec<Stretch> = (0..edges.len()).flat_map(stretches_of).collect();
        let mut scratch = self.scratch.borrow_mut();
        scratch.config.resize(self.robot.chain.dof(), Lanes::all(0.0));
        let mut query = Query { checker: self, edges, speeds, spacing, scratch };
        let Some(near) = query.survey(&stretches) else { return false };
        near.iter().all(|near| query.follow(near))
    }

    /// The largest speed of any point of each body along an edge that takes unit time.
    fn speeds(&self, from: &[f64], to: &[f64]) -> Vec<f64> {
        let speed =
            |bounds: &Vec<f64>| bounds.iter().zip(from).zip(to).map(|((bound, a), b)| bound * (a - b).abs()).sum();
        self.motion_bounds.iter().map(speed).collect()
    }
}

/// A part of an edge around the state in its middle, in parts of the edge.
#[derive(Clone, Copy)]
struct Stretch {
    edge: usize,
    middle: f64,
    half: f64,
}

/// A body that passes an obstacle on a stretch, perhaps too near.
struct Passing {
    stretch: Stretch,
    body: usize,
    obstacle: usize,
}

/// What the state in the middle of a stretch says about all of it.
enum Look {
    Clear,
    Near,
    Touching,
}

/// One test of some edges.
struct Query<'a, 'c> {
    checker: &'a Checker<'c>,
    edges: Vec<[&'a [f64]; 2]>,
    /// Per edge and body.
    speeds: Vec<Vec<f64>>,
    spacing: f64,
    scratch: RefMut<'a, Scratch>,
}

impl Query<'_, '_> {
    /// Looks at whole stretches; `None` when something is touched, otherwise what is not proven clear.
    fn survey(&mut self, stretches: &[Stretch]) -> Option<Vec<Passing>> {
        let (mut passing, mut doubted_pairs) = (Vec::new(), Vec::new());
        let batches = stretches.len().div_ceil(LANES);
        for batch in 0..batches {
            // Lanes are spread over the path, so that trouble anywhere is seen early.
            let at = |lane: usize| stretches[(lane * batches + batch).min(stretches.len() - 1)];
            self.set_states(|lane| (at(lane).edge, at(lane).middle));
            let reach = |body: usize, lane: usize| self.speeds[at(lane).edge][body] * at(lane).half;
            let widest = |body: usize| (0..LANES).map(|lane| reach(body, lane)).fold(0.0, f64::max) as f32;
            self.scratch.swell.clear();
            self.scratch.swell.extend((0..self.checker.bodies.len()).map(widest));
            if !fast::find_doubts(&self.checker.fast, &mut self.scratch) {
                return None;
            }
            // Lanes beyond the end repeat the last stretch.
            let real = |lane: &usize| lane * batches + batch < stretches.len();
            let mut frames: [Option<Vec<Rigid>>; LANES] = Default::default();
            for index in 0..self.scratch.doubts.len() {
                match self.scratch.doubts[index] {
                    Doubt::Obstacle { body, obstacle, lanes } => {
                        for lane in lanes_of(lanes).filter(real) {
                            let near = Passing { stretch: at(lane), body, obstacle };
                            match self.look_at_middle(&near, &mut frames[lane]) {
                                Look::Touching => return None,
                                Look::Near => passing.push(near),
                                Look::Clear => {}
                            }
                        }
                    }
                    Doubt::Bodies { pair, lanes } => {
                        doubted_pairs.extend(lanes_of(lanes).map(|lane| (at(lane).edge, pair)));
                    }
                }
            }
        }
        doubted_pairs.sort_unstable();
        doubted_pairs.dedup();
        let is_free = |&(edge, pair): &(usize, usize)| {
            let [from, to] = self.edges[edge];
            self.checker.pair_is_free(&self.checker.body_pairs[pair], from, to, self.spacing)
        };
        doubted_pairs.iter().all(is_free).then_some(passing)
    }

    /// Looks exactly at the state in the middle of a stretch on which a body passes a surface, for which the fast path
    /// knows no contact: often all of the stretch is clear, and a path that leads through a surface is found out early.
    fn look_at_middle(&self, passing: &Passing, frames: &mut Option<Vec<Rigid>>) -> Look {
        let Passing { stretch: Stretch { edge, middle, half }, body: index, obstacle } = *passing;
        let checker = self.checker;
        let (body, target) = (&checker.bodies[index], &checker.obstacles[obstacle]);
        let margin = checker.obstacle_margin[index * checker.obstacles.len() + obstacle];
        let Some(margin) = margin.filter(|_| target.surface.is_some() && !target.excused.any(body)) else {
            return Look::Near;
        };
        let [from, to] = self.edges[edge];
        let frames = frames.get_or_insert_with(|| checker.robot.chain.frames(&lerp(from, to, middle)));
        let world_from_body = frames[body.frame] * body.frame_from_body;
        let is_within = |distance: f64| target.closer_than(body, &world_from_body, distance);
        if !is_within(margin + half * self.speeds[edge][index]) {
            Look::Clear
        } else if is_within(margin) {
            Look::Touching
        } else {
            Look::Near
        }
    }

    /// Whether a body keeps its distance from an obstacle at every step of a stretch; the exact test has the last word.
    fn follow(&mut self, passing: &Passing) -> bool {
        let Passing { stretch: Stretch { edge, middle, half }, body, obstacle } = *passing;
        let checker = self.checker;
        let Some(margin) = checker.obstacle_margin[body * checker.obstacles.len() + obstacle] else { return true };
        // Steps so short that half of one is within the padding leave no room for contact in between.
        let comes_closer =
            margin < 0.5 * self.spacing || checker.obstacles[obstacle].excused.any(&checker.bodies[body]);
        let spacing = if comes_closer { CLOSER * self.spacing } else { self.spacing };
        let batches = (2.0 * half * self.speeds[edge][body] / (spacing * LANES as f64)).ceil().max(1.0) as usize;
        let steps = batches * LANES;
        (0..batches).all(|batch| {
            let time = |lane: usize| middle + half * ((2 * (lane * batches + batch) + 1) as f64 / steps as f64 - 1.0);
            self.set_states(|lane| (edge, time(lane)));
            let Some(lanes) = fast::find_doubt(&checker.fast, &mut self.scratch, body, obstacle) else { return false };
            let [from, to] = self.edges[edge];
            lanes == 0
                || checker.doubts_are_unfounded(&[Doubt::Obstacle { body, obstacle, lanes }], |lane| {
                    lerp(from, to, time(lane))
                })
        })
    }

    /// Fills the lanes with states, each at a part of an edge.
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
