//! What is tested against what: the moving bodies, the obstacles around them, and exact answers about pairs.

use super::convex::{self, Ball, Convex, Separation};
use super::cover::CoverBall;
use super::narrow::Skeleton;
use super::pair_table::PairTable;
use super::probe::Planes;
use super::robot_shape::{LinkShape, RobotShape, ball_around};
use super::surface::{Excused, Surface};
use super::world::{Attached, Obstacle, Part};
use crate::rigid::Rigid;

/// How far apart two links are looked at when their motion is advanced, m.
pub(super) const LOOK: f64 = 0.1;

/// A link or the carried object, in the frame that moves it.
#[derive(Clone, Debug)]
pub(super) struct Body<'a> {
    pub(super) part: Part,
    pub(super) name: &'a str,
    pub(super) frame: usize,
    pub(super) frame_from_body: Rigid,
    pub(super) pieces: &'a [Convex],
    pub(super) cover: &'a [CoverBall],
    pub(super) skeletons: &'a [Skeleton],
    pub(super) planes: &'a [Planes],
    /// Ball around the body, in the moving frame.
    pub(super) ball: Ball,
}

/// Two bodies that may meet.
#[derive(Clone, Debug)]
pub(super) struct BodyPair {
    pub(super) first: usize,
    pub(super) second: usize,
    /// Distance to keep.
    pub(super) margin: f64,
    /// Joints that move one against the other, and the largest speed of a point per unit speed of the joint.
    pub(super) movers: Vec<(usize, f64)>,
    /// Index of the pair's table in the robot's shape.
    pub(super) table: Option<usize>,
}

/// An obstacle with balls around it and around its pieces, in the world.
#[derive(Clone, Debug)]
pub(super) struct Target<'a> {
    pub(super) name: &'a str,
    pub(super) world_from_obstacle: Rigid,
    pub(super) ball: Ball,
    pub(super) pieces: Vec<TargetPiece<'a>>,
    pub(super) surface: Option<&'a Surface>,
    /// Facets of the surface that need not be kept away from as the others.
    pub(super) excused: Excused,
}

/// A piece of an obstacle.
#[derive(Clone, Debug)]
pub(super) struct TargetPiece<'a> {
    pub(super) convex: &'a Convex,
    pub(super) core_from_world: Rigid,
}

impl TargetPiece<'_> {
    /// Whether a ball in the world certainly keeps `margin` from the piece.
    pub(super) fn clear_of(&self, ball: &Ball, margin: f64) -> bool {
        let reach = ball.radius + self.convex.radius + margin.max(0.0);
        self.convex.core.distance_bound(self.core_from_world.point(ball.center)) > reach
    }
}

impl<'a> Target<'a> {
    pub(super) fn new(obstacle: &'a Obstacle) -> Self {
        let world_from_obstacle = obstacle.world_from_obstacle;
        let piece = |convex: &'a Convex| TargetPiece {
            convex,
            core_from_world: (world_from_obstacle * convex.owner_from_core).inverse(),
        };
        Self {
            name: &obstacle.name,
            world_from_obstacle,
            ball: obstacle.surface.as_ref().map_or_else(
                || ball_around(obstacle.pieces.iter().map(|piece| moved(&world_from_obstacle, &piece.ball))),
                |surface| surface.ball,
            ),
            pieces: obstacle.pieces.iter().map(piece).collect(),
            surface: obstacle.surface.as_deref(),
            excused: Excused::default(),
        }
    }

    /// Whether a ball in the world certainly keeps `margin` from the obstacle.
    pub(super) fn clear_of(&self, ball: &Ball, margin: f64) -> bool {
        self.surface.is_none_or(|surface| apart(ball, &surface.ball, margin))
            && self.pieces.iter().all(|piece| piece.clear_of(ball, margin))
    }

    pub(super) fn closer_than(&self, body: &Body, world_from_body: &Rigid, margin: f64) -> bool {
        if let Some(surface) = self.surface {
            return surface.closer_than(body, world_from_body, margin, &self.excused);
        }
        if margin <= 0.0 {
            return matches!(self.separation(body, world_from_body, margin), Separation::Within(d) if d < margin);
        }
        body.pieces.iter().any(|piece| {
            let ball = moved(world_from_body, &piece.ball);
            self.pieces.iter().any(|other| {
                let quick = || {
                    convex::quickly_closer_than(other.convex, piece, &other.core_from_world, world_from_body, margin)
                };
                let exact =
                    || convex::closer_than(other.convex, piece, &self.world_from_obstacle, world_from_body, margin);
                !other.clear_of(&ball, margin) && quick().unwrap_or_else(exact)
            })
        })
    }

    pub(super) fn separation(&self, body: &Body, world_from_body: &Rigid, margin: f64) -> Separation {
        if let Some(surface) = self.surface {
            return surface.separation(body, world_from_body, margin, &self.excused);
        }
        let limit = margin.max(0.0);
        let mut nearest = Separation::Beyond;
        for piece in body.pieces {
            let ball = moved(world_from_body, &piece.ball);
            for other in &self.pieces {
                if !other.clear_of(&ball, limit) {
                    let found =
                        convex::separation(other.convex, piece, &self.world_from_obstacle, world_from_body, limit);
                    nearest = nearer(nearest, found);
                }
            }
        }
        nearest
    }
}

pub(super) fn bodies_closer_than(a: &Body, b: &Body, world_from_a: &Rigid, world_from_b: &Rigid, margin: f64) -> bool {
    if margin <= 0.0 {
        return matches!(bodies_separation(a, b, world_from_a, world_from_b, margin), Separation::Within(d) if d < margin);
    }
    a.pieces.iter().any(|piece| {
        let ball = moved(world_from_a, &piece.ball);
        b.pieces.iter().any(|other| {
            !apart(&ball, &moved(world_from_b, &other.ball), margin)
                && convex::closer_than(piece, other, world_from_a, world_from_b, margin)
        })
    })
}

pub(super) fn bodies_separation(
    a: &Body,
    b: &Body,
    world_from_a: &Rigid,
    world_from_b: &Rigid,
    margin: f64,
) -> Separation {
    let limit = margin.max(0.0);
    let mut nearest = Separation::Beyond;
    for piece in a.pieces {
        let ball = moved(world_from_a, &piece.ball);
        for other in b.pieces {
            if !apart(&ball, &moved(world_from_b, &other.ball), limit) {
                nearest = nearer(nearest, convex::separation(piece, other, world_from_a, world_from_b, limit));
            }
        }
    }
    nearest
}

pub(super) fn bodies<'a>(robot: &'a RobotShape, attached: Option<&'a Attached>, gripper_width: f64) -> Vec<Body<'a>> {
    let around = |frame_from_body: &Rigid, cover: &[CoverBall]| {
        ball_around(cover.iter().map(|ball| moved(frame_from_body, &ball.ball)))
    };
    let links = robot.links.iter().enumerate().filter(|(_, link)| !link.pieces.is_empty()).map(|(index, link)| {
        let (frame, frame_from_body) = robot.chain.link_mount(index, gripper_width);
        let ball = around(&frame_from_body, &link.cover);
        let LinkShape { name, pieces, cover, skeletons, planes } = link;
        Body { part: Part::Link(index), name, frame, frame_from_body, pieces, cover, skeletons, planes, ball }
    });
    let carried = attached.map(|attached| {
        let (frame, frame_from_tcp) = robot.chain.tcp_mount();
        let frame_from_body = frame_from_tcp * attached.tcp_from_object;
        let ball = around(&frame_from_body, &attached.cover);
        let Attached { name, pieces, cover, skeletons, planes, .. } = attached;
        Body { part: Part::Attached, name, frame, frame_from_body, pieces, cover, skeletons, planes, ball }
    });
    links.chain(carried).collect()
}

pub(super) fn body_pairs(robot: &RobotShape, bodies: &[Body], padding: f64) -> Vec<BodyPair> {
    let tested = |a: &Body, b: &Body| match (a.part, b.part) {
        (Part::Link(a), Part::Link(b)) => robot.pairs.contains(&(a, b)),
        (Part::Link(link), Part::Attached) => a.frame != b.frame && !robot.gripper_links.contains(&link),
        _ => false,
    };
    let count = bodies.len();
    (0..count)
        .flat_map(|a| (a + 1..count).map(move |b| (a, b)))
        .filter(|(a, b)| tested(&bodies[*a], &bodies[*b]))
        .map(|(first, second)| {
            // A joint that carries both moves neither against the other.
            let (a, b) = (reaches(robot, &bodies[first]), reaches(robot, &bodies[second]));
            let movers = (0..a.len()).filter(|joint| (a[*joint] > 0.0) != (b[*joint] > 0.0));
            let movers = movers.map(|joint| (joint, a[joint].max(b[joint]))).collect();
            let table = match (bodies[first].part, bodies[second].part) {
                (Part::Link(a), Part::Link(b)) => robot.pairs.iter().position(|pair| *pair == (a, b)),
                _ => None,
            };
            BodyPair { first, second, margin: padding, movers, table }
        })
        .collect()
}

/// Tables for the pairs of links that exactly two turning joints move; `fingers` move otherwise and have none.
pub(super) fn pair_tables(robot: &RobotShape, fingers: &[usize]) -> Vec<Option<PairTable>> {
    let bodies = bodies(robot, None, 0.0);
    let mut tables = vec![None; robot.pairs.len()];
    let joints = robot.chain.joints();
    let middle: Vec<f64> = joints.iter().map(|joint| 0.5 * (joint.lower + joint.upper)).collect();
    for pair in body_pairs(robot, &bodies, 0.0) {
        let (a, b) = (&bodies[pair.first], &bodies[pair.second]);
        let finger = fingers.iter().any(|link| [a.part, b.part].contains(&Part::Link(*link)));
        let (Some(index), [first, second], false) = (pair.table, pair.movers.as_slice(), finger) else { continue };
        let mover = |&(joint, reach): &(usize, f64)| (joint, [joints[joint].lower, joints[joint].upper], reach);
        let mut config = middle.clone();
        tables[index] = Some(PairTable::new([mover(first), mover(second)], |at| {
            (config[first.0], config[second.0]) = (at[0], at[1]);
            let frames = robot.chain.frames(&config);
            let [world_from_a, world_from_b] = [a, b].map(|body| frames[body.frame] * body.frame_from_body);
            match bodies_separation(a, b, &world_from_a, &world_from_b, LOOK) {
                Separation::Within(distance) => distance,
                Separation::Beyond => LOOK,
            }
        }));
    }
    tables
}

/// For each joint the largest speed that its unit speed can give to a point of the body; 0 when it does not move it.
pub(super) fn reaches(robot: &RobotShape, body: &Body) -> Vec<f64> {
    let joints = robot.chain.joints();
    let mut reach = vec![0.0_f64; joints.len()];
    let mut distance = body.ball.center.length() + body.ball.radius;
    let mut frame = body.frame;
    while frame > 0 {
        let joint = &joints[frame - 1];
        // The body's own joint turns about z; of the joints before only the distance of their origins is known.
        let own = body.ball.center.truncate().length() + body.ball.radius;
        let turning = if frame == body.frame { own } else { distance };
        reach[frame - 1] = if joint.slides { 1.0 } else { turning };
        let slide = if joint.slides { joint.lower.abs().max(joint.upper.abs()) } else { 0.0 };
        distance += joint.parent_from_joint.translation.length() + slide;
        frame = joint.parent_frame;
    }
    reach
}

/// A ball in the world that the body cannot leave, whatever the joints do.
pub(super) fn room(robot: &RobotShape, body: &Body) -> Ball {
    let mut room = body.ball;
    let mut frame = body.frame;
    while frame > 0 {
        let joint = &robot.chain.joints()[frame - 1];
        let slide = if joint.slides { joint.lower.abs().max(joint.upper.abs()) } else { 0.0 };
        let radius = room.center.length() + room.radius + slide;
        room = Ball { center: joint.parent_from_joint.translation, radius };
        frame = joint.parent_frame;
    }
    room
}

fn nearer(a: Separation, b: Separation) -> Separation {
    match (a, b) {
        (Separation::Within(a), Separation::Within(b)) => Separation::Within(a.min(b)),
        (Separation::Beyond, found) | (found, Separation::Beyond) => found,
    }
}

pub(super) fn moved(outer_from_inner: &Rigid, ball: &Ball) -> Ball {
    Ball { center: outer_from_inner.point(ball.center), radius: ball.radius }
}

pub(super) fn apart(a: &Ball, b: &Ball, margin: f64) -> bool {
    let reach = a.radius + b.radius + margin.max(0.0);
    a.center.distance_squared(b.center) > reach * reach
}
