//! Tests of configurations and of straight joint-space edges for one robot, world and carried object.

use super::bodies::{
    Body, BodyPair, LOOK, Target, TargetPiece, apart, bodies, bodies_closer_than, bodies_separation, body_pairs, moved,
    reaches,
};
use super::convex::Separation;
use super::fast::{self, Doubt, FastBody, FastJoint, FastModel, FastObstacle, FastPiece, Scratch};
use super::lanes::{LANES, Lanes};
use super::robot_shape::RobotShape;
use super::world::{Allowed, Attached, World};
use crate::path::lerp;
use crate::rigid::Rigid;

/// Two things that are too close.
#[derive(Clone, Debug, PartialEq)]
pub struct CollisionReport {
    /// The moving one: a link's name, or the attached object's.
    pub part: String,
    /// The other one: an obstacle's, a link's or the attached object's name.
    pub other: String,
    /// Distance between them; negative is the depth of penetration.
    pub distance: f64,
}

impl std::fmt::Display for CollisionReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { part, other, distance } = self;
        if *distance < 0.0 {
            write!(f, "{part} is {:.1} mm inside {other}", -distance * 1e3)
        } else {
            write!(f, "{part} is {:.1} mm from {other}", distance * 1e3)
        }
    }
}

/// Collision tests for one query; cheap to make, holds everything in the shape the tests want.
///
/// The base (everything that no arm joint moves) is tested against moving links, not against the world:
/// no motion of the arm could change the answer.
#[derive(Clone, Debug)]
pub struct Checker<'a> {
    pub(super) robot: &'a RobotShape,
    pub(super) bodies: Vec<Body<'a>>,
    pub(super) obstacles: Vec<Target<'a>>,
    /// Distance to keep per body and obstacle, row by row of bodies; `None` where contact is allowed.
    pub(super) obstacle_margin: Vec<Option<f64>>,
    pub(super) body_pairs: Vec<BodyPair>,
    /// Largest speed of any point of the robot per unit speed of each joint.
    reach: Vec<f64>,
    /// The same scene for the fast path.
    fast: FastModel,
}

impl<'a> Checker<'a> {
    /// Prepares tests that keep `padding` metres from everything that is not allowed to touch.
    pub fn new(
        robot: &'a RobotShape,
        world: &'a World,
        attached: Option<&'a Attached>,
        allowed: &Allowed,
        gripper_width: f64,
        padding: f64,
    ) -> Self {
        let bodies = bodies(robot, attached, gripper_width);
        let obstacles: Vec<Target> = world.obstacles.iter().map(Target::new).collect();
        let obstacle_margin = bodies
            .iter()
            .flat_map(|body| {
                obstacles
                    .iter()
                    .map(|target| (body.frame > 0 && !allowed.contains(body.part, target.name)).then_some(padding))
            })
            .collect();
        let body_pairs = body_pairs(robot, &bodies, padding);
        let reach = bodies.iter().fold(vec![0.0; robot.chain.dof()], |widest: Vec<f64>, body| {
            widest.iter().zip(reaches(robot, body)).map(|(a, b)| a.max(b)).collect()
        });
        let fast = fast_model(robot, &bodies, &obstacles);
        let mut checker = Self { robot, bodies, obstacles, obstacle_margin, body_pairs, reach, fast };
        checker.refresh_fast_margins();
        checker
    }

    /// The arm's kinematics.
    pub fn chain(&self) -> &'a crate::chain::Chain {
        &self.robot.chain
    }

    /// The pair that violates its distance most, if any.
    pub fn check(&self, config: &[f64]) -> Option<CollisionReport> {
        let frames = self.robot.chain.frames(config);
        let mut worst: Option<(f64, CollisionReport)> = None;
        let mut note = |part: &str, other: &str, margin: f64, separation: Separation| {
            let Separation::Within(distance) = separation else { return };
            if distance < margin && worst.as_ref().is_none_or(|(violation, _)| distance - margin < *violation) {
                let report = CollisionReport { part: part.to_owned(), other: other.to_owned(), distance };
                worst = Some((distance - margin, report));
            }
        };
        for (index, body) in self.bodies.iter().enumerate() {
            let world_from_body = frames[body.frame] * body.frame_from_body;
            for (target, margin) in self.obstacles.iter().zip(self.margins_of(index)) {
                if let Some(margin) = *margin {
                    note(body.name, target.name, margin, target.separation(body, &world_from_body, margin));
                }
            }
        }
        for &BodyPair { first, second, margin, .. } in &self.body_pairs {
            let (a, b) = (&self.bodies[first], &self.bodies[second]);
            let [world_from_a, world_from_b] = [a, b].map(|body| frames[body.frame] * body.frame_from_body);
            note(a.name, b.name, margin, bodies_separation(a, b, &world_from_a, &world_from_b, margin));
        }
        worst.map(|(_, report)| report)
    }

    /// Whether every pair keeps its distance.
    pub fn is_free(&self, config: &[f64]) -> bool {
        let frames = self.robot.chain.frames(config);
        let world_from = |body: &Body| frames[body.frame] * body.frame_from_body;
        for (index, body) in self.bodies.iter().enumerate() {
            let ball = moved(&frames[body.frame], &body.ball);
            for (target, margin) in self.obstacles.iter().zip(self.margins_of(index)) {
                let Some(margin) = *margin else { continue };
                if apart(&ball, &target.ball, margin) {
                    continue;
                }
                if target.closer_than(body, &world_from(body), margin) {
                    return false;
                }
            }
        }
        !self.body_pairs.iter().any(|&BodyPair { first, second, margin, .. }| {
            let (a, b) = (&self.bodies[first], &self.bodies[second]);
            !apart(&moved(&frames[a.frame], &a.ball), &moved(&frames[b.frame], &b.ball), margin)
                && bodies_closer_than(a, b, &world_from(a), &world_from(b), margin)
        })
    }

    /// Whether every state of the straight joint-space edge keeps its distances.
    ///
    /// States are so close together that no point of the robot moves more than `spacing` metres between them;
    /// with `spacing` at most twice the padding, nothing can be touched in between either.
    pub fn edge_is_free(&self, from: &[f64], to: &[f64], spacing: f64) -> bool {
        let steps = self.edge_steps(from, to, spacing);
        let batches = steps.div_ceil(LANES);
        let mut config = vec![Lanes::all(0.0); from.len()];
        let mut scratch = Scratch::default();
        let mut proven_pairs = vec![false; self.body_pairs.len()];
        // The lanes are spread over the edge and walk backwards together; the first state is the caller's to test.
        (0..batches).rev().all(|batch| {
            let time = |lane: usize| ((lane * batches + batch + 1).min(steps)) as f64 / steps as f64;
            for ((q, a), b) in config.iter_mut().zip(from).zip(to) {
                for (lane, value) in q.0.iter_mut().enumerate() {
                    *value = (a + (b - a) * time(lane)) as f32;
                }
            }
            fast::find_doubts(&self.fast, &config, &mut scratch);
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

    fn refresh_fast_margins(&mut self) {
        let single = |margin: &f64| margin.max(0.0) as f32;
        self.fast.margins = self.obstacle_margin.iter().map(|margin| margin.as_ref().map(single)).collect();
        self.fast.body_pairs =
            self.body_pairs.iter().map(|pair| (pair.first, pair.second, single(&pair.margin))).collect();
    }

    /// Accepts `config` although pairs are closer than the padding: from now on such a pair keeps (nearly) the
    /// distance it has there.
    ///
    /// Start and goal of a motion may be anywhere from touching on; fails with the pair that penetrates by more
    /// than `tolerance`.
    pub fn relax(&mut self, config: &[f64], tolerance: f64) -> Result<(), CollisionReport> {
        let frames = self.robot.chain.frames(config);
        let mut worst: Option<CollisionReport> = None;
        let count = self.obstacles.len();
        for (index, body) in self.bodies.iter().enumerate() {
            let world_from_body = frames[body.frame] * body.frame_from_body;
            for (target, slot) in self.obstacles.iter().zip(&mut self.obstacle_margin[index * count..]) {
                let Some(margin) = slot else { continue };
                if apart(&moved(&frames[body.frame], &body.ball), &target.ball, *margin) {
                    continue;
                }
                if let Separation::Within(distance) = target.separation(body, &world_from_body, *margin) {
                    *margin = margin.min(relaxed(distance));
                    note_worst(&mut worst, body.name, target.name, distance);
                }
            }
        }
        for BodyPair { first, second, margin, .. } in &mut self.body_pairs {
            let (a, b) = (&self.bodies[*first], &self.bodies[*second]);
            let (world_from_a, world_from_b) =
                (frames[a.frame] * a.frame_from_body, frames[b.frame] * b.frame_from_body);
            if let Separation::Within(distance) = bodies_separation(a, b, &world_from_a, &world_from_b, *margin) {
                *margin = margin.min(relaxed(distance));
                note_worst(&mut worst, a.name, b.name, distance);
            }
        }
        self.refresh_fast_margins();
        match worst {
            Some(report) if report.distance < -tolerance => Err(report),
            _ => Ok(()),
        }
    }

    /// Number of equal steps in which no point of the robot moves more than `spacing`.
    pub(crate) fn edge_steps(&self, from: &[f64], to: &[f64], spacing: f64) -> usize {
        let motion: f64 = from.iter().zip(to).zip(&self.reach).map(|((a, b), reach)| (a - b).abs() * reach).sum();
        ((motion / spacing).ceil() as usize).clamp(1, 1 << 20)
    }

    fn margins_of(&self, body: usize) -> &[Option<f64>] {
        let count = self.obstacles.len();
        &self.obstacle_margin[body * count..(body + 1) * count]
    }
}

fn fast_model(robot: &RobotShape, bodies: &[Body], obstacles: &[Target]) -> FastModel {
    let joint = |joint: &crate::chain::ChainJoint| FastJoint {
        parent_frame: joint.parent_frame,
        parent_from_joint: (&joint.parent_from_joint).into(),
        slides: joint.slides,
    };
    let body = |body: &Body| FastBody {
        frame: body.frame,
        ball: (&body.ball).into(),
        cover: body.cover.iter().map(|ball| (&moved(&body.frame_from_body, ball)).into()).collect(),
    };
    let piece = |piece: &TargetPiece| FastPiece::new(&piece.convex.core, piece.convex.radius, &piece.core_from_world);
    let obstacle = |target: &Target| FastObstacle {
        ball: (&target.ball).into(),
        pieces: target.pieces.iter().map(piece).collect(),
    };
    FastModel {
        joints: robot.chain.joints().iter().map(joint).collect(),
        bodies: bodies.iter().map(body).collect(),
        obstacles: obstacles.iter().map(obstacle).collect(),
        ..FastModel::default()
    }
}

/// The distance a pair keeps that was found at `distance`, nearer than its padding.
fn relaxed(distance: f64) -> f64 {
    distance - (0.1 * distance.abs()).max(1e-4)
}

fn note_worst(worst: &mut Option<CollisionReport>, part: &str, other: &str, distance: f64) {
    if worst.as_ref().is_none_or(|report| distance < report.distance) {
        *worst = Some(CollisionReport { part: part.to_owned(), other: other.to_owned(), distance });
    }
}
