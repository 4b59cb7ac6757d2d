//! Collision checker for one robot, world and attached object.

use std::cell::RefCell;

use super::body::{Body, BodyPair, MovingBody, bodies_closer_than, bodies_separation};
use super::convex::Separation;
use super::cover::CoverBall;
use super::fast::{FastBody, FastJoint, FastMargin, FastModel, FastObstacle, Scratch};
use super::fast_piece::FastPiece;
use super::placed_obstacle::{PlacedObstacle, PlacedPiece};
use super::probe::Solid;
use super::robot_shape::RobotShape;
use super::world::{AllowedCollisions, Attached, CollisionWorld};
use crate::rigid::Rigid;

/// Pair of bodies that are closer than their clearance.
#[derive(Clone, Debug, PartialEq)]
pub struct CollisionReport {
    /// Moving body: name of a link or the attached object.
    pub part: String,
    /// Other body: name of an obstacle, a link or the attached object.
    pub other: String,
    /// Distance (m); negative is penetration depth.
    pub distance: f64,
    /// True if both are links of the robot.
    pub between_links: bool,
}

impl std::fmt::Display for CollisionReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { part, other, distance, .. } = self;
        if *distance < 0.0 {
            write!(f, "{part} is {:.1} mm inside {other}", -distance * 1e3)
        } else {
            write!(f, "{part} is {:.1} mm from {other}", distance * 1e3)
        }
    }
}

/// Collision checks for one query; cheap to create.
///
/// The base (everything that no arm joint moves) is checked against moving links but not against the world: no arm
/// motion could change the result.
#[derive(Clone, Debug)]
pub struct Checker<'a> {
    pub(super) robot: &'a RobotShape,
    pub(super) bodies: Vec<Body<'a>>,
    pub(super) obstacles: Vec<PlacedObstacle<'a>>,
    /// Clearance per body and obstacle, row-major by body; `None` if contact is allowed or out of reach.
    pub(super) obstacle_margin: Vec<Option<f64>>,
    pub(super) body_pairs: Vec<BodyPair>,
    /// Motion bounds of each body: per joint the maximum speed of its points per unit joint velocity [m/rad] (1 for
    /// prismatic joints).
    pub(super) motion_bounds: Vec<Vec<f64>>,
    /// Motion bounds of the whole robot: per joint the maximum over all bodies.
    pub(super) motion_bound: Vec<f64>,
    /// Single-precision model of the fast path.
    pub(super) fast: FastModel<'a>,
    /// Reused storage of the fast path.
    pub(super) scratch: RefCell<Scratch>,
}

impl<'a> Checker<'a> {
    /// Creates a checker with a clearance of `padding` (m) from everything not allowed to touch.
    pub fn new(
        robot: &'a RobotShape,
        world: &'a CollisionWorld,
        attached: Option<&'a Attached>,
        allowed: &AllowedCollisions,
        gripper_width: f64,
        padding: f64,
    ) -> Self {
        let bodies = robot.bodies(attached, gripper_width);
        let obstacles: Vec<PlacedObstacle> = world.obstacles.iter().map(PlacedObstacle::new).collect();
        let obstacle_margin = bodies
            .iter()
            .flat_map(|body| {
                let reachable = robot.reachable_ball(body);
                let may_meet = move |target: &PlacedObstacle| {
                    body.frame > 0 && !allowed.contains(body.id, target.name) && !target.clear_of(&reachable, padding)
                };
                obstacles.iter().map(move |target| may_meet(target).then_some(padding))
            })
            .collect();
        let body_pairs = robot.body_pairs(&bodies, padding);
        let motion_bounds: Vec<Vec<f64>> = bodies.iter().map(|body| robot.motion_bounds(body)).collect();
        let largest = |joint: usize| motion_bounds.iter().map(|body| body[joint]).fold(0.0, f64::max);
        let motion_bound = (0..robot.chain.dof()).map(largest).collect();
        let fast = fast_model(robot, &bodies, &obstacles);
        let mut checker = Self {
            robot,
            bodies,
            obstacles,
            obstacle_margin,
            body_pairs,
            motion_bounds,
            motion_bound,
            fast,
            scratch: RefCell::default(),
        };
        checker.refresh_fast_margins();
        checker
    }

    /// Kinematic chain of the checked robot.
    pub fn chain(&self) -> &'a crate::chain::Chain {
        &self.robot.chain
    }

    /// The pair with the largest clearance violation, if any.
    pub fn check(&self, config: &[f64]) -> Option<CollisionReport> {
        let frames = self.robot.chain.frames(config);
        let mut worst: Option<(f64, CollisionReport)> = None;
        let mut note = |part: &str, other: &str, between_links: bool, margin: f64, separation: Separation| {
            let Separation::Within(distance) = separation else { return };
            if distance < margin && worst.as_ref().is_none_or(|(violation, _)| distance - margin < *violation) {
                let report =
                    CollisionReport { part: part.to_owned(), other: other.to_owned(), distance, between_links };
                worst = Some((distance - margin, report));
            }
        };
        for (index, body) in self.bodies.iter().enumerate() {
            let world_from_body = frames[body.frame] * body.frame_from_body;
            for (target, margin) in self.obstacles.iter().zip(self.margins_of(index)) {
                if let Some(margin) = *margin {
                    note(body.name, target.name, false, margin, target.separation(body, &world_from_body, margin));
                }
            }
        }
        for &BodyPair { first, second, margin, .. } in &self.body_pairs {
            let (a, b) = (&self.bodies[first], &self.bodies[second]);
            let [world_from_a, world_from_b] = [a, b].map(|body| frames[body.frame] * body.frame_from_body);
            note(
                a.name,
                b.name,
                are_links(a, b),
                margin,
                bodies_separation(a, b, &world_from_a, &world_from_b, margin),
            );
        }
        worst.map(|(_, report)| report)
    }

    /// True if every pair keeps its clearance.
    pub fn is_free(&self, config: &[f64]) -> bool {
        let frames = self.robot.chain.frames(config);
        let world_from = |body: &Body| frames[body.frame] * body.frame_from_body;
        // From the gripper to the base, since contacts are most frequent at the gripper.
        if (0..self.bodies.len()).rev().any(|index| self.violates_obstacle(index, &frames)) {
            return false;
        }
        !self.body_pairs.iter().any(|&BodyPair { first, second, margin, .. }| {
            let (a, b) = (&self.bodies[first], &self.bodies[second]);
            !a.ball.moved(&frames[a.frame]).is_apart(&b.ball.moved(&frames[b.frame]), margin)
                && bodies_closer_than(a, b, &world_from(a), &world_from(b), margin)
        })
    }

    /// True if the bodies on the last moving frame (gripper and attached object) keep their clearance to obstacles;
    /// independent of the arm configuration for a given gripper pose.
    pub fn gripper_is_free(&self, config: &[f64]) -> bool {
        let frames = self.robot.chain.frames(config);
        let last = frames.len().saturating_sub(1);
        !(0..self.bodies.len())
            .rev()
            .any(|index| self.bodies[index].frame == last && self.violates_obstacle(index, &frames))
    }

    /// True if a body violates its clearance to an obstacle.
    fn violates_obstacle(&self, index: usize, frames: &[Rigid]) -> bool {
        let body = &self.bodies[index];
        let (ball, world_from_body) = (body.ball.moved(&frames[body.frame]), frames[body.frame] * body.frame_from_body);
        self.obstacles.iter().zip(self.margins_of(index)).any(|(target, margin)| {
            margin.is_some_and(|margin| {
                !ball.is_apart(&target.ball, margin) && target.closer_than(body, &world_from_body, margin)
            })
        })
    }

    fn refresh_fast_margins(&mut self) {
        let single = |margin: &f64| margin.max(0.0) as f32;
        let count = self.obstacles.len();
        let both = |(index, margin): (usize, &Option<f64>)| {
            let margin = (*margin)?;
            // With relaxed facets, only the exact check knows the clearances.
            let relaxed_facets = self.obstacles[index % count].relaxed_facets.any(&self.bodies[index / count]);
            let reject = if relaxed_facets { -1.0 } else { margin as f32 };
            Some(FastMargin { accept: margin.max(0.0) as f32, reject })
        };
        self.fast.margins = self.obstacle_margin.iter().enumerate().map(both).collect();
        self.fast.body_pairs =
            self.body_pairs.iter().map(|pair| (pair.first, pair.second, single(&pair.margin))).collect();
    }

    /// Relaxes the clearance of pairs that are closer than the padding at `config` to (nearly) the distance there.
    ///
    /// Start and goal of a motion may touch; fails with the pair that penetrates by more than `tolerance`.
    pub fn relax(&mut self, config: &[f64], tolerance: f64) -> Result<(), CollisionReport> {
        let frames = self.robot.chain.frames(config);
        let mut worst: Option<CollisionReport> = None;
        let count = self.obstacles.len();
        for (index, body) in self.bodies.iter().enumerate() {
            let world_from_body = frames[body.frame] * body.frame_from_body;
            for (target, slot) in self.obstacles.iter_mut().zip(&mut self.obstacle_margin[index * count..]) {
                let Some(margin) = slot else { continue };
                if body.ball.moved(&frames[body.frame]).is_apart(&target.ball, *margin) {
                    continue;
                }
                if let Some(surface) = target.surface {
                    surface.each_near(body, &world_from_body, *margin, |facet, distance| {
                        target.relaxed_facets.add(body, facet, relaxed_margin(distance).min(*margin));
                        note_worst(&mut worst, body.name, target.name, distance, false);
                    });
                    continue;
                }
                if let Separation::Within(distance) = target.separation(body, &world_from_body, *margin) {
                    *margin = margin.min(relaxed_margin(distance));
                    note_worst(&mut worst, body.name, target.name, distance, false);
                }
            }
        }
        for BodyPair { first, second, margin, .. } in &mut self.body_pairs {
            let (a, b) = (&self.bodies[*first], &self.bodies[*second]);
            let (world_from_a, world_from_b) =
                (frames[a.frame] * a.frame_from_body, frames[b.frame] * b.frame_from_body);
            if let Separation::Within(distance) = bodies_separation(a, b, &world_from_a, &world_from_b, *margin) {
                *margin = margin.min(relaxed_margin(distance));
                note_worst(&mut worst, a.name, b.name, distance, are_links(a, b));
            }
        }
        self.refresh_fast_margins();
        match worst {
            Some(report) if report.distance < -tolerance => Err(report),
            _ => Ok(()),
        }
    }

    /// Convex pieces of robot and attached object at a configuration (with `true`), then those of obstacles (with
    /// `false`). Surfaces have none.
    pub(crate) fn solids(&self, config: &[f64]) -> impl Iterator<Item = (Solid<'_>, bool)> {
        let frames = self.robot.chain.frames(config);
        let moving = self.bodies.iter().flat_map(move |body| {
            let world_from_body = frames[body.frame] * body.frame_from_body;
            body.pieces.iter().zip(body.planes).map(move |(piece, planes)| {
                let core_from_world = (world_from_body * piece.owner_from_core).inverse();
                (Solid { piece, planes: Some(planes), core_from_world }, true)
            })
        });
        let fixed =
            self.obstacles.iter().flat_map(|target| &target.pieces).map(|piece| {
                (Solid { piece: piece.convex, planes: None, core_from_world: piece.core_from_world }, false)
            });
        moving.chain(fixed)
    }

    /// Maximum distance of any point of the robot or the attached object from the base (m).
    pub(crate) fn reach_m(&self) -> f64 {
        let from_base = |body: &Body| {
            let reachable = self.robot.reachable_ball(body);
            reachable.center.length() + reachable.radius
        };
        self.bodies.iter().map(from_base).fold(0.0, f64::max)
    }

    /// Copy in which relaxed pairs keep at least `distance` metres.
    pub(crate) fn with_min_clearance(&self, distance: f64) -> Self {
        let mut stricter = self.clone();
        for margin in stricter.obstacle_margin.iter_mut().flatten() {
            *margin = margin.max(distance);
        }
        for pair in &mut stricter.body_pairs {
            pair.margin = pair.margin.max(distance);
        }
        stricter.refresh_fast_margins();
        stricter
    }

    /// Reduces the clearance between links of the robot to `distance` (m) where it is larger.
    pub(crate) fn limit_link_clearance(&mut self, distance: f64) {
        for pair in &mut self.body_pairs {
            if are_links(&self.bodies[pair.first], &self.bodies[pair.second]) {
                pair.margin = pair.margin.min(distance);
            }
        }
        self.refresh_fast_margins();
    }

    /// True if the clearance of every pair is at least `distance` metres.
    pub(crate) fn has_min_clearance(&self, distance: f64) -> bool {
        let obstacles = self.obstacle_margin.iter().flatten();
        obstacles.chain(self.body_pairs.iter().map(|pair| &pair.margin)).all(|margin| *margin >= distance)
    }

    fn margins_of(&self, body: usize) -> &[Option<f64>] {
        let count = self.obstacles.len();
        &self.obstacle_margin[body * count..(body + 1) * count]
    }
}

fn fast_model<'a>(robot: &RobotShape, bodies: &[Body<'a>], obstacles: &[PlacedObstacle<'a>]) -> FastModel<'a> {
    let joint = |joint: &crate::chain::ChainJoint| FastJoint {
        parent_frame: joint.parent_frame,
        parent_from_joint: (&joint.parent_from_joint).into(),
        is_prismatic: joint.is_prismatic,
        driver: joint.driver,
        coupling: joint.coupling.map(|coupling| coupling.map(|value| value as f32)),
    };
    let placed = |body: &Body, cover: &CoverBall| CoverBall { ball: cover.ball.moved(&body.frame_from_body), ..*cover };
    let body = |body: &Body<'a>| FastBody {
        frame: body.frame,
        frame_from_body: (&body.frame_from_body).into(),
        skeletons: body.skeletons,
        ball: (&body.ball).into(),
        cover: body.cover.iter().map(|ball| (&placed(body, ball)).into()).collect(),
    };
    let piece = |piece: &PlacedPiece| FastPiece::new(&piece.convex.core, piece.convex.radius, &piece.core_from_world);
    let obstacle = |target: &PlacedObstacle<'a>| FastObstacle {
        ball: (&target.ball).into(),
        pieces: target.pieces.iter().map(piece).collect(),
        field: target.surface.map(|surface| &surface.field),
    };
    FastModel {
        joints: robot.chain.moving().iter().map(joint).collect(),
        bodies: bodies.iter().map(body).collect(),
        obstacles: obstacles.iter().map(obstacle).collect(),
        ..FastModel::default()
    }
}

/// Relaxed clearance of a pair found at `distance`; separated pairs stay separated.
fn relaxed_margin(distance: f64) -> f64 {
    let nearly = distance - (0.1 * distance.abs()).max(1e-4);
    if distance > 0.0 { nearly.max(0.0) } else { nearly }
}

fn are_links(a: &Body, b: &Body) -> bool {
    matches!((a.id, b.id), (MovingBody::Link(_), MovingBody::Link(_)))
}

fn note_worst(worst: &mut Option<CollisionReport>, part: &str, other: &str, distance: f64, between_links: bool) {
    if worst.as_ref().is_none_or(|report| distance < report.distance) {
        *worst = Some(CollisionReport { part: part.to_owned(), other: other.to_owned(), distance, between_links });
    }
}
