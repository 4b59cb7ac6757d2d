//! Fixed slabs that things stand on.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Workspace;
use crate::{Aabb, Piece, Pose, Shape};

/// A fixed, level slab that things stand on: the table, a shelf, a side table.
///
/// Its frame has the origin in the middle of the top, z up, turned by `yaw_rad` against the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SupportSurface {
    /// What files call it; `table` for the first one. Tasks name a further one by it.
    pub id: String,
    /// What people call it, e.g. `side table`.
    pub name: String,
    /// Middle of the top in the world, metres.
    #[schemars(with = "[f64; 3]")]
    pub top_center_m: DVec3,
    /// Heading of its x axis, rad.
    #[serde(default)]
    pub yaw_rad: f64,
    /// Extent along its own x and y, and thickness, metres.
    #[schemars(with = "[f64; 3]")]
    pub size_m: DVec3,
    /// Sliding friction; in a contact the larger coefficient of the two counts.
    pub friction: f64,
    /// How far inside the edges of the top things may be put, metres.
    #[serde(default)]
    pub edge_margin_m: f64,
    /// Further fixed boxes of the same body, e.g. the sides of a shelf.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub boards: Vec<Board>,
    /// Whether four legs down to the floor are drawn. Only drawn: where the arm could touch a leg, make it a board.
    #[serde(default)]
    pub legs: bool,
}

/// A fixed box that belongs to a support surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Its middle in the surface's frame, metres.
    #[schemars(with = "[f64; 3]")]
    pub center_m: DVec3,
    /// Its extent along the surface's axes, metres.
    #[schemars(with = "[f64; 3]")]
    pub size_m: DVec3,
}

impl SupportSurface {
    /// `world_from_surface`; the origin is in the middle of the top.
    pub fn world_from_surface(&self) -> Pose {
        Pose::from_position_yaw(self.top_center_m, self.yaw_rad)
    }

    /// Collision bodies in the surface's frame, the slab first.
    pub fn pieces(&self) -> Vec<Piece> {
        let of = |center: DVec3, size: DVec3| Piece::at(center, Shape::Box { half_extents: size * 0.5 });
        let slab = of(DVec3::new(0.0, 0.0, -self.size_m.z * 0.5), self.size_m);
        std::iter::once(slab).chain(self.boards.iter().map(|board| of(board.center_m, board.size_m))).collect()
    }

    /// Bounds of the slab alone in the world.
    pub fn slab_bounds(&self) -> Aabb {
        Aabb::from_pieces(&self.world_from_surface(), self.pieces().iter().take(1))
    }

    /// Bounds of the top at least its margin, and `more_m`, inside its edges; a surface that is turned against the world's
    /// axes fills them in part, see [`SupportSurface::is_over_top`].
    pub fn area(&self, more_m: f64) -> Workspace {
        let (bounds, margin) = (self.slab_bounds(), self.edge_margin_m + more_m);
        let within = |low: f64, high: f64| [low + margin, high - margin];
        Workspace { x: within(bounds.min.x, bounds.max.x), y: within(bounds.min.y, bounds.max.y) }
    }

    /// Whether points of the world's plane are over the top and at least its margin, and `more_m`, inside its edges.
    pub fn is_over_top(&self, mut points: impl Iterator<Item = DVec2>, more_m: f64) -> bool {
        let surface_from_world = self.world_from_surface().inverse();
        let half = self.size_m.truncate() * 0.5 - DVec2::splat(self.edge_margin_m + more_m);
        points.all(|point| surface_from_world.transform_point(point.extend(0.0)).truncate().abs().cmple(half).all())
    }

    /// Bounds of all of it in the world.
    pub fn bounds(&self) -> Aabb {
        Aabb::from_pieces(&self.world_from_surface(), &self.pieces())
    }

    /// Corners of the top in the world, counter-clockwise, metres.
    pub fn top_corners(&self) -> [DVec3; 4] {
        let [x, y] = [self.size_m.x * 0.5, self.size_m.y * 0.5];
        let world_from_surface = self.world_from_surface();
        [[-x, -y], [x, -y], [x, y], [-x, y]].map(|[x, y]| world_from_surface.transform_point(DVec3::new(x, y, 0.0)))
    }
}
