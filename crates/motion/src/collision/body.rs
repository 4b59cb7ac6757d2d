//! Moving bodies: links and the attached object, and exact distances between two of them.

use super::convex::{self, Ball, Convex, Separation};
use super::cover::CoverBall;
use super::narrow::Skeleton;
use super::probe::FacePlanes;
use crate::rigid::Rigid;

/// A link or the attached object in its moving frame.
#[derive(Clone, Debug)]
pub(super) struct Body<'a> {
    pub(super) id: MovingBody,
    pub(super) name: &'a str,
    pub(super) frame: usize,
    pub(super) frame_from_body: Rigid,
    pub(super) pieces: &'a [Convex],
    pub(super) cover: &'a [CoverBall],
    pub(super) skeletons: &'a [Skeleton],
    pub(super) planes: &'a [FacePlanes],
    /// Bounding sphere, in the moving frame.
    pub(super) ball: Ball,
}

/// A moving body: a link or the attached object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MovingBody {
    /// A link, by its index in the robot model.
    Link(usize),
    /// The object attached to the gripper.
    Attached,
}

/// Two bodies that may collide.
#[derive(Clone, Debug)]
pub(super) struct BodyPair {
    pub(super) first: usize,
    pub(super) second: usize,
    /// Required clearance between the bodies (m).
    pub(super) margin: f64,
    /// Joints that move one body relative to the other, each with its motion bound: the maximum speed of a point per
    /// unit joint velocity.
    pub(super) movers: Vec<(usize, f64)>,
    /// Index of the pair's distance table in `RobotShape::tables`; `None` with the attached object.
    pub(super) table: Option<usize>,
}

/// Maximum distance evaluated in conservative advancement (m): a larger one counts as this. Chosen by hand.
pub(super) const MAX_DISTANCE_M: f64 = 0.1;

/// True if two bodies are closer than `margin` (m); a negative margin allows that much penetration.
pub(super) fn bodies_closer_than(a: &Body, b: &Body, world_from_a: &Rigid, world_from_b: &Rigid, margin: f64) -> bool {
    if margin <= 0.0 {
        return matches!(bodies_separation(a, b, world_from_a, world_from_b, margin), Separation::Within(d) if d < margin);
    }
    a.pieces.iter().any(|piece| {
        let ball = piece.ball.moved(world_from_a);
        b.pieces.iter().any(|other| {
            !ball.is_apart(&other.ball.moved(world_from_b), margin)
                && convex::closer_than(piece, other, world_from_a, world_from_b, margin)
        })
    })
}

/// Distance of two bodies if it is at most `margin` (m).
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
        let ball = piece.ball.moved(world_from_a);
        for other in b.pieces {
            if !ball.is_apart(&other.ball.moved(world_from_b), limit) {
                nearest = nearest.nearer(convex::separation(piece, other, world_from_a, world_from_b, limit));
            }
        }
    }
    nearest
}
