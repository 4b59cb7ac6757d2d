//! The robot's collision bodies, compiled once.

use genmanip_core::RobotModel;
use glam::DVec3;

use super::convex::{Ball, Convex, GeometryError};
use super::cover::{CoverBall, cover};
use super::narrow::Skeleton;
use super::pair_table::PairTable;
use super::probe::Planes;
use super::world::compile;
use crate::chain::{Chain, ModelError};

/// Links that stay farther apart than this within the joint limits are not tested against each other, m.
const NEVER_NEAR: f64 = 0.02;

/// Exact convex bodies of a robot's links and the pairs of links that are tested against each other.
#[derive(Clone, Debug)]
pub struct RobotShape {
    pub(crate) chain: Chain,
    pub(crate) links: Vec<LinkShape>,
    /// Pairs of links that may meet: not in the same moving frame, not declared as never colliding, not always apart.
    pub(crate) pairs: Vec<(usize, usize)>,
    pub(crate) gripper_links: [usize; 3],
    /// For each of `pairs` that only two joints move: lower bounds on its distance.
    pub(crate) tables: Vec<Option<PairTable>>,
}

#[derive(Clone, Debug)]
pub(crate) struct LinkShape {
    pub(crate) name: String,
    pub(crate) pieces: Vec<Convex>,
    /// Balls that hold the pieces, in the link's frame.
    pub(crate) cover: Vec<CoverBall>,
    /// The pieces for the closer look.
    pub(crate) skeletons: Vec<Skeleton>,
    /// The pieces against points and triangles.
    pub(crate) planes: Vec<Planes>,
}

/// A robot model that cannot be compiled for collision checks.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// Its kinematics are broken.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// One of its collision pieces is broken.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

impl RobotShape {
    /// Compiles chain and pieces.
    pub fn new(robot: &RobotModel) -> Result<Self, RobotError> {
        let chain = Chain::new(robot)?;
        let links = robot
            .links
            .iter()
            .map(|link| {
                let pieces = compile(&link.name, &link.pieces)?;
                let cover = pieces.iter().flat_map(cover).collect();
                let skeletons = pieces.iter().map(Skeleton::new).collect();
                let planes = pieces.iter().map(Planes::new).collect();
                Ok(LinkShape { name: link.name.clone(), pieces, cover, skeletons, planes })
            })
            .collect::<Result<Vec<_>, GeometryError>>()?;
        let frame = |link: usize| chain.link_mount(link, 0.0).0;
        let never = |a: usize, b: usize| {
            frame(a) == frame(b) || robot.never_colliding.iter().any(|pair| *pair == (a, b) || *pair == (b, a))
        };
        let count = links.len();
        let pairs = (0..count)
            .flat_map(|a| (a + 1..count).map(move |b| (a, b)))
            .filter(|(a, b)| !links[*a].pieces.is_empty() && !links[*b].pieces.is_empty() && !never(*a, *b))
            .collect();
        let [left, right] = robot.gripper.fingers;
        let mut shape = Self { chain, links, pairs, gripper_links: [robot.hand, left, right], tables: vec![] };
        shape.tables = super::bodies::pair_tables(&shape, &[left, right]);
        // Many pairs never come near each other, whatever the two joints do.
        let kept: Vec<bool> =
            shape.tables.iter().map(|table| table.as_ref().is_none_or(|table| table.nearest() < NEVER_NEAR)).collect();
        let mut keep = kept.iter();
        shape.pairs.retain(|_| keep.next() == Some(&true));
        let mut keep = kept.iter();
        shape.tables.retain(|_| keep.next() == Some(&true));
        Ok(shape)
    }

    /// The arm's kinematics.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }
}

/// A ball around balls: centred in the middle of their bounds, not the smallest possible.
pub(crate) fn ball_around(balls: impl Iterator<Item = Ball> + Clone) -> Ball {
    let bounds = balls.clone().fold(genmanip_core::Aabb::EMPTY, |bounds, ball| {
        bounds.including(ball.center - DVec3::splat(ball.radius)).including(ball.center + DVec3::splat(ball.radius))
    });
    let center = bounds.center();
    let radius = balls.map(|ball| ball.center.distance(center) + ball.radius).fold(0.0, f64::max);
    Ball { center: if center.is_finite() { center } else { DVec3::ZERO }, radius }
}
