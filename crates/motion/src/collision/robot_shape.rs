//! Compiled collision bodies of a robot.

use std::collections::BTreeSet;

use genmanip_core::RobotModel;

use super::body::{Body, BodyPair, MAX_DISTANCE_M, MovingBody, bodies_separation};
use super::convex::{Ball, Convex, GeometryError, Separation};
use super::cover::{CoverBall, cover};
use super::narrow::Skeleton;
use super::pair_table::{Mover, PairTable};
use super::probe::FacePlanes;
use super::world::Attached;
use crate::chain::{Chain, ChainJoint, ModelError};
use crate::rigid::Rigid;

/// Distance (m): pairs of links that never come nearer than this are not checked. Chosen by hand.
const NEVER_NEAR_M: f64 = 0.02;

/// Exact convex bodies of a robot's links and the link pairs to check.
#[derive(Clone, Debug)]
pub struct RobotShape {
    pub(crate) chain: Chain,
    pub(crate) links: Vec<LinkShape>,
    /// Link pairs that may collide: not in the same moving frame, not declared as never colliding, not always apart.
    pub(crate) pairs: Vec<(usize, usize)>,
    pub(crate) gripper_links: [usize; 3],
    /// Distance tables, one per entry of `pairs`; `None` for fingers and where not exactly two joints move the pair.
    pub(crate) tables: Vec<Option<PairTable>>,
}

#[derive(Clone, Debug)]
pub(crate) struct LinkShape {
    pub(crate) name: String,
    pub(crate) pieces: Vec<Convex>,
    /// Sphere cover, link frame.
    pub(crate) cover: Vec<CoverBall>,
    /// Vertices for the SIMD narrow phase.
    pub(crate) skeletons: Vec<Skeleton>,
    /// Face planes for tests against the points and triangles of surfaces.
    pub(crate) planes: Vec<FacePlanes>,
}

/// Error of compiling a robot for collision checking.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// The kinematics are invalid, such as an empty joint range.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A collision piece is invalid.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

impl RobotShape {
    /// Compiles kinematics and collision pieces.
    pub fn new(robot: &RobotModel) -> Result<Self, RobotError> {
        let mut shape = Self::without_tables(robot)?;
        shape.tables = shape.pair_tables(&robot.gripper.fingers);
        // Pairs with a table that never come near each other are dropped.
        let kept: Vec<bool> = shape
            .tables
            .iter()
            .map(|table| table.as_ref().is_none_or(|table| table.nearest() < NEVER_NEAR_M))
            .collect();
        let mut keep = kept.iter();
        shape.pairs.retain(|_| keep.next() == Some(&true));
        let mut keep = kept.iter();
        shape.tables.retain(|_| keep.next() == Some(&true));
        Ok(shape)
    }

    /// Like [`RobotShape::new`] without the distance tables, which only speed up many checks.
    pub(super) fn without_tables(robot: &RobotModel) -> Result<Self, RobotError> {
        let chain = Chain::new(robot)?;
        let links = robot
            .links
            .iter()
            .map(|link| {
                let pieces = Convex::all(&link.name, &link.pieces)?;
                let cover = pieces.iter().flat_map(cover).collect();
                let skeletons = pieces.iter().map(Skeleton::new).collect();
                let planes = pieces.iter().map(FacePlanes::new).collect();
                Ok(LinkShape { name: link.name.clone(), pieces, cover, skeletons, planes })
            })
            .collect::<Result<Vec<_>, GeometryError>>()?;
        let frame = |link: usize| chain.link_mount(link, 0.0).0;
        let allowed: BTreeSet<(usize, usize)> =
            robot.never_colliding.iter().map(|&(a, b)| (a.min(b), a.max(b))).collect();
        let never = |a: usize, b: usize| frame(a) == frame(b) || allowed.contains(&(a, b));
        let count = links.len();
        let pairs = (0..count)
            .flat_map(|a| (a + 1..count).map(move |b| (a, b)))
            .filter(|(a, b)| !links[*a].pieces.is_empty() && !links[*b].pieces.is_empty() && !never(*a, *b))
            .collect();
        let [left, right] = robot.gripper.fingers;
        let pairs: Vec<(usize, usize)> = pairs;
        let tables = vec![None; pairs.len()];
        Ok(Self { chain, links, pairs, gripper_links: [robot.hand, left, right], tables })
    }

    /// Kinematic chain of the robot.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// The links with collision pieces and the attached object, at a gripper opening (m).
    pub(super) fn bodies<'a>(&'a self, attached: Option<&'a Attached>, gripper_width: f64) -> Vec<Body<'a>> {
        let around = |frame_from_body: &Rigid, cover: &[CoverBall]| {
            Ball::around(cover.iter().map(|ball| ball.ball.moved(frame_from_body)))
        };
        let links = self.links.iter().enumerate().filter(|(_, link)| !link.pieces.is_empty()).map(|(index, link)| {
            let (frame, frame_from_body) = self.chain.link_mount(index, gripper_width);
            let ball = around(&frame_from_body, &link.cover);
            let LinkShape { name, pieces, cover, skeletons, planes } = link;
            Body { id: MovingBody::Link(index), name, frame, frame_from_body, pieces, cover, skeletons, planes, ball }
        });
        let carried = attached.map(|attached| {
            let (frame, frame_from_tcp) = self.chain.tcp_mount();
            let frame_from_body = frame_from_tcp * attached.tcp_from_object;
            let ball = around(&frame_from_body, &attached.cover);
            let Attached { name, pieces, cover, skeletons, planes, .. } = attached;
            Body { id: MovingBody::Attached, name, frame, frame_from_body, pieces, cover, skeletons, planes, ball }
        });
        links.chain(carried).collect()
    }

    /// Body pairs that may collide, each with a clearance of `padding` (m).
    pub(super) fn body_pairs(&self, bodies: &[Body], padding: f64) -> Vec<BodyPair> {
        let tested = |a: &Body, b: &Body| match (a.id, b.id) {
            (MovingBody::Link(a), MovingBody::Link(b)) => self.pair(a, b).is_some(),
            (MovingBody::Link(link), MovingBody::Attached) => a.frame != b.frame && !self.gripper_links.contains(&link),
            _ => false,
        };
        let count = bodies.len();
        (0..count)
            .flat_map(|a| (a + 1..count).map(move |b| (a, b)))
            .filter(|(a, b)| tested(&bodies[*a], &bodies[*b]))
            .map(|(first, second)| {
                let movers = self.movers(&bodies[first], &bodies[second]);
                let table = match (bodies[first].id, bodies[second].id) {
                    (MovingBody::Link(a), MovingBody::Link(b)) => self.pair(a, b),
                    _ => None,
                };
                BodyPair { first, second, margin: padding, movers, table }
            })
            .collect()
    }

    /// Index of a link pair (smaller index first) in `pairs`, which is sorted; `None` for a pair that is not checked.
    fn pair(&self, a: usize, b: usize) -> Option<usize> {
        self.pairs.binary_search(&(a, b)).ok()
    }

    /// Distance tables of link pairs that exactly two revolute joints move; `fingers` have none.
    fn pair_tables(&self, fingers: &[usize]) -> Vec<Option<PairTable>> {
        let bodies = self.bodies(None, 0.0);
        let mut tables = vec![None; self.pairs.len()];
        let joints = self.chain.joints();
        let middle: Vec<f64> = joints.iter().map(|joint| 0.5 * (joint.lower + joint.upper)).collect();
        let range = |joint: &ChainJoint| [*joint.sampled().start(), *joint.sampled().end()];
        for pair in self.body_pairs(&bodies, 0.0) {
            let (a, b) = (&bodies[pair.first], &bodies[pair.second]);
            let finger = fingers.iter().any(|link| [a.id, b.id].contains(&MovingBody::Link(*link)));
            let (Some(index), [first, second], false) = (pair.table, pair.movers.as_slice(), finger) else { continue };
            let mover = |&(joint, bound): &(usize, f64)| Mover {
                joint,
                range: range(&joints[joint]),
                continuous: joints[joint].continuous,
                bound,
            };
            let mut config = middle.clone();
            tables[index] = Some(PairTable::new([mover(first), mover(second)], |at| {
                (config[first.0], config[second.0]) = (at[0], at[1]);
                let frames = self.chain.frames(&config);
                let [world_from_a, world_from_b] = [a, b].map(|body| frames[body.frame] * body.frame_from_body);
                match bodies_separation(a, b, &world_from_a, &world_from_b, MAX_DISTANCE_M) {
                    Separation::Within(distance) => distance,
                    Separation::Beyond => MAX_DISTANCE_M,
                }
            }));
        }
        tables
    }

    /// Degrees of freedom that move one body relative to the other, each with its motion bound.
    fn movers(&self, first: &Body, second: &Body) -> Vec<(usize, f64)> {
        let (a, b) = (self.joint_bounds(first), self.joint_bounds(second));
        let mut movers: Vec<(usize, f64)> = Vec::new();
        for (index, joint) in self.chain.moving().iter().enumerate() {
            // A joint that carries both bodies moves neither relative to the other.
            if (a[index] > 0.0) == (b[index] > 0.0) {
                continue;
            }
            let bound = a[index].max(b[index]) * joint.ratio();
            match movers.iter_mut().find(|(driver, _)| *driver == joint.driver) {
                Some((_, sum)) => *sum += bound,
                None => movers.push((joint.driver, bound)),
            }
        }
        movers
    }

    /// Motion bounds per degree of freedom: maximum speed of a point of the body per unit joint velocity [m/rad] (1 for
    /// prismatic joints); 0 if it does not move the body.
    pub(super) fn motion_bounds(&self, body: &Body) -> Vec<f64> {
        let mut bounds = vec![0.0; self.chain.dof()];
        for (joint, bound) in self.chain.moving().iter().zip(self.joint_bounds(body)) {
            bounds[joint.driver] += bound * joint.ratio();
        }
        bounds
    }

    /// Like [`RobotShape::motion_bounds`], per joint, coupled ones included.
    fn joint_bounds(&self, body: &Body) -> Vec<f64> {
        let joints = self.chain.moving();
        let mut bounds = vec![0.0_f64; joints.len()];
        let mut distance = body.ball.center.length() + body.ball.radius;
        let mut frame = body.frame;
        while frame > 0 {
            let joint = &joints[frame - 1];
            // The body's own joint rotates about z; for earlier joints only the distance of their origins is known.
            let own = body.ball.center.truncate().length() + body.ball.radius;
            let turning = if frame == body.frame { own } else { distance };
            bounds[frame - 1] = if joint.is_prismatic { 1.0 } else { turning };
            let slide = if joint.is_prismatic { joint.lower.abs().max(joint.upper.abs()) } else { 0.0 };
            distance += joint.parent_from_joint.translation.length() + slide;
            frame = joint.parent_frame;
        }
        bounds
    }

    /// Sphere that contains the body at every configuration, world frame.
    pub(super) fn reachable_ball(&self, body: &Body) -> Ball {
        let mut ball = body.ball;
        let mut frame = body.frame;
        while frame > 0 {
            let joint = &self.chain.moving()[frame - 1];
            let slide = if joint.is_prismatic { joint.lower.abs().max(joint.upper.abs()) } else { 0.0 };
            let radius = ball.center.length() + ball.radius + slide;
            ball = Ball { center: joint.parent_from_joint.translation, radius };
            frame = joint.parent_frame;
        }
        ball
    }
}
