//! Collision checks of straight joint-space edges, eight states at a time.

use super::body::{BodyPair, MAX_DISTANCE_M, bodies_separation};
use super::checker::Checker;
use super::convex::Separation;
use super::fast::{self, Unresolved};
use super::lanes::{LANES, Lanes, lanes_of};
use crate::path::lerp;
use crate::rigid::Rigid;

/// Maximum penetration of two bodies of the robot between checked states, m, where start or goal has relaxed their
/// clearance to nothing.
const GRAZE_M: f64 = 0.000_25;

impl Checker<'_> {
    /// True if every state of a straight joint-space edge keeps its clearances.
    ///
    /// States are sampled so that no point of the robot moves more than `spacing` (m) between them; with `spacing` at
    /// most twice the padding, nothing can be touched in between either.
    pub fn edge_is_free(&self, from: &[f64], to: &[f64], spacing: f64) -> bool {
        let steps = self.edge_steps(from, to, spacing);
        let batches = steps.div_ceil(LANES);
        let mut scratch = self.scratch.borrow_mut();
        scratch.config.resize(from.len(), Lanes::all(0.0));
        scratch.inflation.clear();
        scratch.inflation.resize(self.bodies.len(), 0.0);
        let mut unresolved_pairs = vec![false; self.body_pairs.len()];
        // Lanes are interleaved over the edge and advance backwards; the caller checks the first state.
        let obstacles_are_clear = (0..batches).rev().all(|batch| {
            let time = |lane: usize| ((lane * batches + batch + 1).min(steps)) as f64 / steps as f64;
            for ((q, a), b) in scratch.config.iter_mut().zip(from).zip(to) {
                *q = Lanes::from_array(std::array::from_fn(|lane| (a + (b - a) * time(lane)) as f32));
            }
            if !fast::find_unresolved(&self.fast, &mut scratch) {
                return false;
            }
            for unresolved in &scratch.unresolved {
                if let Unresolved::Bodies { pair, .. } = *unresolved {
                    unresolved_pairs[pair] = true;
                }
            }
            self.unresolved_are_free(&scratch.unresolved, |lane| lerp(from, to, time(lane)))
        });
        // Self-collision is checked last, because it follows the whole edge, and most edges end at an obstacle.
        obstacles_are_clear
            && self
                .body_pairs
                .iter()
                .zip(unresolved_pairs)
                .all(|(pair, is_unresolved)| !is_unresolved || self.pair_is_free(pair, from, to, spacing))
    }

    /// True if two bodies keep their clearance along an edge, by conservative advancement: the distance at one state
    /// bounds how far the bodies may move before they can touch.
    pub(super) fn pair_is_free(&self, pair: &BodyPair, from: &[f64], to: &[f64], spacing: f64) -> bool {
        let table = pair.table.and_then(|index| self.robot.tables[index].as_ref());
        let speed: f64 = pair.movers.iter().map(|&(joint, bound)| (to[joint] - from[joint]).abs() * bound).sum();
        let (a, b) = (&self.bodies[pair.first], &self.bodies[pair.second]);
        // Halfway between two states that keep the margin, bodies can be closer by half of what they moved.
        let least_step = spacing.min(2.0 * (pair.margin.max(0.0) + GRAZE_M));
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
            let clear =
                match bodies_separation(a, b, &world_from_a, &world_from_b, pair.margin.max(0.0) + MAX_DISTANCE_M) {
                    Separation::Within(distance) => distance - pair.margin,
                    Separation::Beyond => MAX_DISTANCE_M,
                };
            if clear < 0.0 {
                return false;
            }
            if time >= 1.0 || speed <= 0.0 {
                return true;
            }
            time = (time + clear.max(least_step) / speed).min(1.0);
        }
    }

    /// True if the exact check finds clear all pairs that the fast path could not prove clear.
    pub(super) fn unresolved_are_free(&self, unresolved: &[Unresolved], config: impl Fn(usize) -> Vec<f64>) -> bool {
        let mut cached: [Option<Vec<Rigid>>; LANES] = Default::default();
        let count = self.obstacles.len();
        unresolved.iter().all(|unresolved| {
            let Unresolved::Obstacle { body, obstacle, lanes } = *unresolved else { return true };
            let Some(margin) = self.obstacle_margin[body * count + obstacle] else { return true };
            let (body, target) = (&self.bodies[body], &self.obstacles[obstacle]);
            lanes_of(lanes).all(|lane| {
                let frames = cached[lane].get_or_insert_with(|| self.robot.chain.frames(&config(lane)));
                !target.closer_than(body, &(frames[body.frame] * body.frame_from_body), margin)
            })
        })
    }

    /// Number of equal steps with at most `spacing` (m) motion of any robot point per step.
    pub(crate) fn edge_steps(&self, from: &[f64], to: &[f64], spacing: f64) -> usize {
        let motion: f64 =
            from.iter().zip(to).zip(&self.motion_bound).map(|((a, b), bound)| (a - b).abs() * bound).sum();
        ((motion / spacing).ceil() as usize).clamp(1, 1 << 20)
    }
}
