//! Tests of straight joint-space edges, eight states at a time.

use super::body::{BodyPair, LOOK, bodies_separation};
use super::checker::Checker;
use super::convex::Separation;
use super::fast::{self, Doubt};
use super::lanes::{LANES, Lanes, lanes_of};
use crate::path::lerp;
use crate::rigid::Rigid;

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
        let mut doubted_pairs = vec![false; self.body_pairs.len()];
        // The lanes are spread over the edge and walk backwards together; the first state is the caller's to test.
        let obstacles_are_clear = (0..batches).rev().all(|batch| {
            let time = |lane: usize| ((lane * batches + batch + 1).min(steps)) as f64 / steps as f64;
            for ((q, a), b) in scratch.config.iter_mut().zip(from).zip(to) {
                *q = Lanes::from_array(std::array::from_fn(|lane| (a + (b - a) * time(lane)) as f32));
            }
            if !fast::find_doubts(&self.fast, &mut scratch) {
                return false;
            }
            for doubt in &scratch.doubts {
                if let Doubt::Bodies { pair, .. } = *doubt {
                    doubted_pairs[pair] = true;
                }
            }
            self.doubts_are_unfounded(&scratch.doubts, |lane| lerp(from, to, time(lane)))
        });
        // Last, because a pair is followed along the whole edge, and most edges end at an obstacle.
        obstacles_are_clear
            && self
                .body_pairs
                .iter()
                .zip(doubted_pairs)
                .all(|(pair, doubted)| !doubted || self.pair_is_free(pair, from, to, spacing))
    }

    /// Whether two bodies keep their distance all along an edge, by conservative advancement: the distance at one
    /// state is also how far the bodies may move before they can meet.
    pub(super) fn pair_is_free(&self, pair: &BodyPair, from: &[f64], to: &[f64], spacing: f64) -> bool {
        let table = pair.table.and_then(|index| self.robot.tables[index].as_ref());
        let speed: f64 = pair.movers.iter().map(|&(joint, bound)| (to[joint] - from[joint]).abs() * bound).sum();
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
    pub(super) fn doubts_are_unfounded(&self, doubts: &[Doubt], config: impl Fn(usize) -> Vec<f64>) -> bool {
        let mut cached: [Option<Vec<Rigid>>; LANES] = Default::default();
        let count = self.obstacles.len();
        doubts.iter().all(|doubt| {
            let Doubt::Obstacle { body, obstacle, lanes } = *doubt else { return true };
            let Some(margin) = self.obstacle_margin[body * count + obstacle] else { return true };
            let (body, target) = (&self.bodies[body], &self.obstacles[obstacle]);
            lanes_of(lanes).all(|lane| {
                let frames = cached[lane].get_or_insert_with(|| self.robot.chain.frames(&config(lane)));
                !target.closer_than(body, &(frames[body.frame] * body.frame_from_body), margin)
            })
        })
    }

    /// Number of equal steps in which no point of the robot moves more than `spacing`.
    pub(crate) fn edge_steps(&self, from: &[f64], to: &[f64], spacing: f64) -> usize {
        let motion: f64 =
            from.iter().zip(to).zip(&self.motion_bound).map(|((a, b), bound)| (a - b).abs() * bound).sum();
        ((motion / spacing).ceil() as usize).clamp(1, 1 << 20)
    }
}
