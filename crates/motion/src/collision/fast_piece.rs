//! Bounding primitives of obstacle pieces, tested against points of eight configurations at a time (SIMD).

use super::convex::Core;
use super::lane_geometry::{Point, ROUNDING, Transform, dot, subtract};
use super::lanes::Lanes;
use crate::rigid::Rigid;

/// A primitive that contains a collision piece.
#[derive(Clone, Debug)]
pub(super) struct FastPiece {
    pub(super) core_from_world: Transform,
    shape: FastShape,
    pub(super) rounding: f32,
    /// True if the primitive equals the piece, so that being within it proves contact.
    pub(super) exact: bool,
}

#[derive(Clone, Debug)]
enum FastShape {
    Box([f32; 3]),
    Cylinder {
        radius: f32,
        half_height: f32,
    },
    /// A segment along z of this half length; a point if 0.
    Segment(f32),
}

impl FastPiece {
    pub(super) fn new(core: &Core, rounding: f64, core_from_world: &Rigid) -> Self {
        let mut core_from_world = *core_from_world;
        let shape = match core {
            Core::Point => FastShape::Segment(0.0),
            Core::Segment(half_length) => FastShape::Segment(*half_length as f32),
            Core::Box(half) | Core::Ellipsoid(half) => FastShape::Box(half.as_vec3().to_array()),
            Core::Cylinder { radius, half_height } => {
                FastShape::Cylinder { radius: *radius as f32, half_height: *half_height as f32 }
            }
            Core::Hull { center, half, .. } => {
                core_from_world.translation -= *center;
                FastShape::Box(half.as_vec3().to_array())
            }
        };
        let exact = !matches!(core, Core::Ellipsoid(_) | Core::Hull { .. });
        Self { core_from_world: Transform::from(&core_from_world), shape, rounding: rounding as f32, exact }
    }

    /// Bit mask of the lanes in which the primitive is within `reach` of a point.
    #[inline(always)]
    pub(super) fn near(&self, center: &Point, reach: f32) -> u8 {
        let reach = reach + self.rounding + ROUNDING;
        (self.squared_distance(center) - Lanes::all(reach * reach)).not_positive()
    }

    /// Squared distance of a point to the primitive without its rounding radius [m²].
    #[inline(always)]
    pub(super) fn squared_distance(&self, center: &Point) -> Lanes {
        let Transform { rows, translation } = &self.core_from_world;
        let local = |k: usize| {
            center[0] * rows[k][0] + center[1] * rows[k][1] + center[2] * rows[k][2] + Lanes::all(translation[k])
        };
        let point = [local(0), local(1), local(2)];
        let away = subtract(point, self.nearest(&point));
        dot(away, away)
    }

    /// Closest point of the primitive without its rounding radius, both in its frame.
    #[inline(always)]
    pub(super) fn nearest(&self, point: &Point) -> Point {
        let [x, y, z] = *point;
        let within = |value: Lanes, half: f32| value.clamp(-half, half);
        match self.shape {
            FastShape::Box([hx, hy, hz]) => [within(x, hx), within(y, hy), within(z, hz)],
            FastShape::Cylinder { radius, half_height } => {
                let shrink = Lanes::all(radius).over((x * x + y * y).sqrt().max(1e-9)).min(1.0);
                [x * shrink, y * shrink, within(z, half_height)]
            }
            FastShape::Segment(half_length) => [Lanes::all(0.0), Lanes::all(0.0), within(z, half_length)],
        }
    }
}
