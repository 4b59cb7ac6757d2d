//! Support surfaces: fixed slabs that objects stand on.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::workspace::Workspace;
use crate::{Aabb, NamedSurface, Piece, Pose, Shape, SurfaceId};

/// A fixed, level slab that objects stand on: the table, a shelf, a side table.
///
/// Its frame has the origin at the centre of the top, z up, rotated by `yaw_rad` relative to the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SupportSurface {
    /// Id in files; `table` for the first one. Tasks refer to the others by it.
    pub id: SurfaceId,
    /// Display name, e.g. `side table`.
    pub name: String,
    /// Centre of the top in the world, metres.
    #[schemars(with = "[f64; 3]")]
    pub top_center_m: DVec3,
    /// Yaw of the surface's x axis, rad.
    #[serde(default)]
    pub yaw_rad: f64,
    /// Extent along the surface's x and y axes, and thickness, metres.
    #[schemars(with = "[f64; 3]")]
    pub size_m: DVec3,
    /// Sliding friction coefficient; a contact uses the larger coefficient of the two bodies.
    pub friction: f64,
    /// Margin inside the top's edges in which no object is placed, metres.
    #[serde(default)]
    pub edge_margin_m: f64,
    /// Additional fixed boxes of the same body, e.g. the sides of a shelf.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub boards: Vec<Board>,
    /// True to render four legs down to the floor. They have no collision geometry: use boards where the arm could
    /// touch one.
    #[serde(default)]
    pub legs: bool,
}

/// A fixed box that belongs to a support surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Centre in the surface's frame, metres.
    #[schemars(with = "[f64; 3]")]
    pub center_m: DVec3,
    /// Extent along the surface's axes, metres.
    #[schemars(with = "[f64; 3]")]
    pub size_m: DVec3,
}

impl SupportSurface {
    /// The surface as tasks name it.
    pub fn named(&self) -> NamedSurface {
        NamedSurface { id: self.id.clone(), name: self.name.clone() }
    }

    /// `world_from_surface`; the origin is at the centre of the top.
    pub fn world_from_surface(&self) -> Pose {
        Pose::from_position_yaw(self.top_center_m, self.yaw_rad)
    }

    /// Collision pieces in the surface's frame, the slab first.
    pub fn pieces(&self) -> Vec<Piece> {
        let of = |center: DVec3, size: DVec3| Piece::at(center, Shape::Box { half_extents: size * 0.5 });
        let slab = of(DVec3::new(0.0, 0.0, -self.size_m.z * 0.5), self.size_m);
        std::iter::once(slab).chain(self.boards.iter().map(|board| of(board.center_m, board.size_m))).collect()
    }

    /// World bounds of the slab alone.
    pub fn slab_bounds(&self) -> Aabb {
        Aabb::from_pieces(&self.world_from_surface(), self.pieces().iter().take(1))
    }

    /// World bounds of the top, inset by the edge margin plus `more_m`; a rotated surface does not fill them, see
    /// [`SupportSurface::is_over_top`].
    pub fn area(&self, more_m: f64) -> Workspace {
        let (bounds, margin) = (self.slab_bounds(), self.edge_margin_m + more_m);
        let within = |low: f64, high: f64| [low + margin, high - margin];
        Workspace { x: within(bounds.min.x, bounds.max.x), y: within(bounds.min.y, bounds.max.y) }
    }

    /// True if all points of the world's xy plane lie over the top, inset by the edge margin plus `more_m`.
    pub fn is_over_top(&self, mut points: impl Iterator<Item = DVec2>, more_m: f64) -> bool {
        let surface_from_world = self.world_from_surface().inverse();
        let half = self.size_m.truncate() * 0.5 - DVec2::splat(self.edge_margin_m + more_m);
        points.all(|point| surface_from_world.transform_point(point.extend(0.0)).truncate().abs().cmple(half).all())
    }

    /// World bounds of the slab and the boards.
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
