//! Tests of straight joint-space edges, eight states at a time.

use std::cell::RefMut;

use super::bodies::{BodyPair, LOOK, bodies_separation};
use super::checker::Checker;
use super::convex::Separation;
use super::fast::{self, Doubt, Scratch};
use super::lanes::{LANES, Lanes};
use crate::path::lerp;
use crate::rigid::Rigid;

/// Largest motion of any point of the robot over a stretch that is first tested as one, m.
const FIRST_STRETCH: f64 = 0.12;
/// Parts into which a stretch that is not proven clear is cut.
const PARTS: usize = 4;

/// A part of an edge around the state in its middle.
#[derive(Clone, Copy)]
struct Stretch {
    edge: usize,
    middle: f64,
}

impl Checker<'_> {
    /// Whether every state of the straight joint-space edge keeps its distances.
    ///
    /// States are so close together that no point of the robot moves more than `spacing` metres between them;
    /// with `spacing` at most twice the padding, nothing can be touched in between either.
    pub fn edge_is_free(&self, from: &[f64], to: &[f64], spacing: f64) -> bool {
        let steps = self.edge_steps(from, to, spacing);
        let batches = steps.div_ceil(LANES);
        let mut scratch = self.scratch.borrow_mut();
        scratch.config.resize(from.len(), Lanes::all(0.0));
        scratch.swell.clear();
        scratch.swell.resize(self.bodies.len(), 0.0);
        let mut proven_pairs = vec![false; self.body_pairs.len()];
        // The lanes are spread over the edge and walk backwards together; the first state is the caller's to test.
        (0..batches).rev().all(|batch| {
            let time = |lane: usize| ((lane * batches + batch + 1).min(steps)) as f64 / steps as f64;
            for ((q, a), b) in scratch.config.iter_mut().zip(from).zip(to) {
                *q = Lanes::from_array(std::array::from_fn(|lane| (a + (b - a) * time(lane)) as f32));
            }
            if !fast::find_doubts(&self.fast, &mut scratch) {
                return false;
            }
            let pairs_are_free = scratch.doubts.iter().all(|doubt| match *doubt {
                Doubt::Bodies { pair, .. } if !proven_pairs[pair] => {
                    proven_pairs[pair] = self.pair_is_free(&self.body_pairs[pair], from, to, spacing);
                    proven_pairs[pair]
                }
                _ => true,
            });
            pairs_are_free && self.doubts_are_unfounded(&scratch.doubts, |lane| lerp(from, to, time(lane)))
        })
    }

    /// Whether a polyline of states keeps its distances everywhere: like `edge_is_free` for each of its edges.
    ///
    /// Long stretches are proven clear at once where there is room, by the motion of each link over half of them;
    /// the others are cut until no point of the robot moves more than `spacing`.
    pub(crate) fn polyline_is_free(&self, states: &[Vec<f64>], spacing: f64) -> bool {
        let edges: Vec<[&[f64]; 2]> = states.windows(2).map(|pair| [&*pair[0], &*pair[1]]).collect();
        let speeds: Vec<Vec<f64>> = edges.iter().map(|[from, to]| self.speeds(from, to)).collect();
        let fastest = |edge: usize| speeds[edge].iter().copied().fold(0.0, f64::max);
        let longest = (0..edges.len()).map(fastest).fold(0.0, f64::max);
        // All edges are cut into as many stretches; lanes are spread, so that trouble anywhere is seen early.
        let per_edge = ((longest / FIRST_STRETCH).ceil() as usize).max(1);
        let per_edge = (per_edge * edges.len()).next_multiple_of(LANES).div_ceil(edges.len().max(1));
        let mut half = 0.5 / per_edge as f64;
        let mut stretches: Vec<Stretch> = (0..edges.len())
            .flat_map(|edge| (0..per_edge).map(move |k| Stretch { edge, middle: half * (2 * k + 1) as f64 }))
            .collect();
        let mut query =
            Query { checker: self, edges, speeds, spacing, proven: Vec::new(), scratch: self.scratch.borrow_mut() };
        while !stretches.is_empty() {
            let last = longest * half * 2.0 <= spacing;
            let Some(open) = query.level(&stretches, half, last) else { return false };
            half /= PARTS as f64;
            let parts = |stretch: Stretch| {
                let offset = move |k: usize| half * (2.0 * k as f64 + 1.0 - PARTS as f64);
                (0..PARTS).map(move |k| Stretch { middle: stretch.middle + offset(k), ..stretch })
            };
            stretches = open.into_iter().flat_map(parts).collect();
        }
        true
    }

    /// The largest speed of any point of each body along an edge that takes unit time.
    fn speeds(&self, from: &[f64], to: &[f64]) -> Vec<f64> {
        let speed =
            |reach: &Vec<f64>| reach.iter().zip(from).zip(to).map(|((reach, a), b)| reach * (a - b).abs()).sum();
        self.reaches.iter().map(speed).collect()
    }

    /// Whether two bodies keep their distance all along an edge, by conservative advancement: the distance at one
    /// state is also how far the bodies may move before they can meet.
    fn pair_is_free(&self, pair: &BodyPair, from: &[f64], to: &[f64], spacing: f64) -> bool {
        let table = pair.table.and_then(|index| self.robot.tables[index].as_ref());
        let speed: f64 = pair.movers.iter().map(|&(joint, reach)| (to[joint] - from[joint]).abs() * reach).sum();
        let (a, b) = (&self.bodies[pair.first], &self.bodies[pair.second]);
        let mut frames = Vec::new();
        let mut time = 0.0;
        loop {
            let at = |joint: usize| from[joint] + (to[joint] - from[joint]) * time;
            if let Some(bound) = table.and_then(|table| table.bound(at))
                && bound - pair.margin > spacing
            {
                if time >= 1.0 || speed <= 0.0 {
                    return true;
                }
                time = (time + (bound - pair.margin) / speed).min(1.0);
                continue;
            }
            self.robot.chain.frames_into(&lerp(from, to, time), &mut frames);
            let [world_from_a, world_from_b] = [a, b].map(|body| frames[body.frame] * body.frame_from_body);
            let clear = match bodies_separation(a, b, &world_from_a, &world_from_b, pair.margin.max(0.0) + LOOK) {
                Separation::Within(distance) => distance - pair.margin,
                Separation::Beyond => LOOK,
            };
            if clear < 0.0 {
                return false;
            }
            if time >= 1.0 || speed <= 0.0 {
                return true;
            }
            time = (time + clear.max(spacing) / speed).min(1.0);
        }
    }

    /// Looks exactly at the bodies and obstacles that the fast path could not prove clear.
    fn doubts_are_unfounded(&self, doubts: &[Doubt], config: impl Fn(usize) -> Vec<f64>) -> bool {
        let mut cached: [Option<Vec<Rigid>>; LANES] = Default::default();
        let count = self.obstacles.len();
        doubts.iter().all(|doubt| {
            let Doubt::Obstacle { body, obstacle, lanes } = *doubt else { return true };
            let Some(margin) = self.obstacle_margin[body * count + obstacle] else { return true };
            let (body, target) = (&self.bodies[body], &self.obstacles[obstacle]);
            fast::lanes_of(lanes).all(|lane| {
                let frames = cached[lane].get_or_insert_with(|| self.robot.chain.frames(&config(lane)));
                !target.closer_than(body, &(frames[body.frame] * body.frame_from_body), margin)
            })
        })
    }

    /// Number of equal steps in which no point of the robot moves more than `spacing`.
    pub(crate) fn edge_steps(&self, from: &[f64], to: &[f64], spacing: f64) -> usize {
        let motion: f64 = from.iter().zip(to).zip(&self.reach).map(|((a, b), reach)| (a - b).abs() * reach).sum();
        ((motion / spacing).ceil() as usize).clamp(1, 1 << 20)
    }
}

/// One test of a polyline.
struct Query<'a, 'c> {
    checker: &'a Checker<'c>,
    edges: Vec<[&'a [f64]; 2]>,
    /// Per edge and body.
    speeds: Vec<Vec<f64>>,
    spacing: f64,
    /// Edges and pairs of bodies that are known to keep their distance.
    proven: Vec<(usize, usize)>,
    scratch: RefMut<'a, Scratch>,
}

impl Query<'_, '_> {
    /// Tests stretches of one length; `None` when something is touched, otherwise those that are not proven clear.
    /// At the `last` level the exact test decides about the states in the middle.
    fn level(&mut self, stretches: &[Stretch], half: f64, last: bool) -> Option<Vec<Stretch>> {
        let mut open = Vec::new();
        let batches = stretches.len().div_ceil(LANES);
        let dof = self.checker.robot.chain.dof();
        self.scratch.config.resize(dof, Lanes::all(0.0));
        for batch in 0..batches {
            let at = |lane: usize| stretches[(lane * batches + batch).min(stretches.len() - 1)];
            for (joint, q) in self.scratch.config.iter_mut().enumerate() {
                *q = Lanes::from_array(std::array::from_fn(|lane| {
                    let Stretch { edge, middle } = at(lane);
                    let [from, to] = self.edges[edge];
                    (from[joint] + (to[joint] - from[joint]) * middle) as f32
                }));
            }
            let widest = |body: usize| (0..LANES).map(|lane| self.speeds[at(lane).edge][body]).fold(0.0, f64::max);
            let reach = if last { 0.0 } else { half };
            let swell = (0..self.checker.bodies.len()).map(|body| (widest(body) * reach) as f32);
            self.scratch.swell.clear();
            self.scratch.swell.extend(swell);
            if !fast::find_doubts(&self.checker.fast, &mut self.scratch) {
                return None;
            }
            let mut doubtful = 0;
            for index in 0..self.scratch.doubts.len() {
                match self.scratch.doubts[index] {
                    Doubt::Obstacle { lanes, .. } => doubtful |= lanes,
                    Doubt::Bodies { pair, lanes } => {
                        for lane in fast::lanes_of(lanes) {
                            self.prove_pair(at(lane).edge, pair)?;
                        }
                    }
                }
            }
            if last {
                let state = |lane: usize| {
                    let Stretch { edge, middle } = at(lane);
                    lerp(self.edges[edge][0], self.edges[edge][1], middle)
                };
                if !self.checker.doubts_are_unfounded(&self.scratch.doubts, state) {
                    return None;
                }
            } else {
                // Lanes beyond the end repeat the last stretch; it is cut once.
                let real = |lane: &usize| lane * batches + batch < stretches.len();
                open.extend(fast::lanes_of(doubtful).filter(real).map(at));
            }
        }
        Some(open)
    }

    fn prove_pair(&mut self, edge: usize, pair: usize) -> Option<()> {
        if !self.proven.contains(&(edge, pair)) {
            let [from, to] = self.edges[edge];
            if !self.checker.pair_is_free(&self.checker.body_pairs[pair], from, to, self.spacing) {
                return None;
            }
            self.proven.push((edge, pair));
        }
        Some(())
    }
}
