//! Obstacles at their poses, and exact distances of bodies from them.

use super::body::Body;
use super::convex::{self, Ball, Convex, Separation};
use super::surface::{RelaxedFacets, Surface};
use super::world::Obstacle;
use crate::rigid::Rigid;

/// Obstacle at its pose, with its bounding sphere in the world frame and the poses of its convex pieces.
#[derive(Clone, Debug)]
pub(super) struct PlacedObstacle<'a> {
    pub(super) name: &'a str,
    pub(super) world_from_obstacle: Rigid,
    pub(super) ball: Ball,
    pub(super) pieces: Vec<PlacedPiece<'a>>,
    pub(super) surface: Option<&'a Surface>,
    /// Facets of the surface with a reduced clearance for some body.
    pub(super) relaxed_facets: RelaxedFacets,
}

/// Convex piece of an obstacle (a core inflated by a radius), with the pose that maps world points into the core's
/// frame.
#[derive(Clone, Debug)]
pub(super) struct PlacedPiece<'a> {
    pub(super) convex: &'a Convex,
    pub(super) core_from_world: Rigid,
}

impl PlacedPiece<'_> {
    /// True if a sphere certainly keeps `margin` (m) from the piece.
    pub(super) fn clear_of(&self, ball: &Ball, margin: f64) -> bool {
        let reach = ball.radius + self.convex.radius + margin.max(0.0);
        self.convex.core.distance_bound(self.core_from_world.point(ball.center)) > reach
    }
}

impl<'a> PlacedObstacle<'a> {
    pub(super) fn new(obstacle: &'a Obstacle) -> Self {
        let world_from_obstacle = obstacle.world_from_obstacle;
        let piece = |convex: &'a Convex| PlacedPiece {
            convex,
            core_from_world: (world_from_obstacle * convex.owner_from_core).inverse(),
        };
        Self {
            name: &obstacle.name,
            world_from_obstacle,
            ball: obstacle.surface.as_ref().map_or_else(
                || Ball::around(obstacle.pieces.iter().map(|piece| piece.ball.moved(&world_from_obstacle))),
                |surface| surface.ball,
            ),
            pieces: obstacle.pieces.iter().map(piece).collect(),
            surface: obstacle.surface.as_deref(),
            relaxed_facets: RelaxedFacets::default(),
        }
    }

    /// True if a sphere certainly keeps `margin` (m) from the obstacle.
    pub(super) fn clear_of(&self, ball: &Ball, margin: f64) -> bool {
        self.surface.is_none_or(|surface| ball.is_apart(&surface.ball, margin))
            && self.pieces.iter().all(|piece| piece.clear_of(ball, margin))
    }

    /// True if a body is closer than `margin` (m) to the obstacle.
    pub(super) fn closer_than(&self, body: &Body, world_from_body: &Rigid, margin: f64) -> bool {
        if let Some(surface) = self.surface {
            return surface.closer_than(body, world_from_body, margin, &self.relaxed_facets);
        }
        if margin <= 0.0 {
            return matches!(self.separation(body, world_from_body, margin), Separation::Within(d) if d < margin);
        }
        body.pieces.iter().any(|piece| {
            let ball = piece.ball.moved(world_from_body);
            self.pieces.iter().any(|other| {
                let quick =
                    || convex::try_closer_than(other.convex, piece, &other.core_from_world, world_from_body, margin);
                let exact =
                    || convex::closer_than(other.convex, piece, &self.world_from_obstacle, world_from_body, margin);
                !other.clear_of(&ball, margin) && quick().unwrap_or_else(exact)
            })
        })
    }

    /// Distance of a body (m) if it is at most `margin`.
    pub(super) fn separation(&self, body: &Body, world_from_body: &Rigid, margin: f64) -> Separation {
        if let Some(surface) = self.surface {
            return surface.separation(body, world_from_body, margin, &self.relaxed_facets);
        }
        let limit = margin.max(0.0);
        let mut nearest = Separation::Beyond;
        for piece in body.pieces {
            let ball = piece.ball.moved(world_from_body);
            for other in &self.pieces {
                if !other.clear_of(&ball, limit) {
                    let found =
                        convex::separation(other.convex, piece, &self.world_from_obstacle, world_from_body, limit);
                    nearest = nearest.nearer(found);
                }
            }
        }
        nearest
    }
}
