//! Key light: its axes, and the placement of its shadow map in the world.

use glam::{Mat3A, Vec3A};

use crate::raster::Corner;
use crate::scene::variation::RenderVariation;

/// Largest penumbra radius (texels).
pub(crate) const MAX_RADIUS: f32 = 30.0;

/// A horizontal plane on the shadow map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    /// Texel column and row as linear functions of world x, y (m) and 1.
    pub x: [f32; 3],
    pub y: [f32; 3],
    /// Reversed z of the plane at the first texel, and its change per column and row.
    pub reversed_z: [f32; 3],
}

/// Axes of the light and scale of its shadow map.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct KeyLight {
    /// Texels per side.
    pub size: usize,
    /// Rows: right, down and forward axes of the light in the world.
    pub light_from_world: Mat3A,
    pub center: Vec3A,
    pub radius: f32,
    pub texels_per_m: f32,
    /// Tangent of the angular radius.
    pub spread: f32,
}

impl KeyLight {
    pub fn new(variation: &RenderVariation, size: usize) -> Self {
        let forward = -Vec3A::from_array(variation.light_direction).normalize_or(Vec3A::Z);
        let hint = if forward.z.abs() > 0.99 { Vec3A::X } else { Vec3A::Z };
        let right = forward.cross(hint).normalize();
        let light_from_world = Mat3A::from_cols(right, forward.cross(right), forward).transpose();
        let radius = variation.shadow_radius_m.max(0.01);
        Self {
            size,
            light_from_world,
            center: light_from_world * Vec3A::from_array(variation.shadow_center),
            radius,
            texels_per_m: size as f32 / (2.0 * radius),
            spread: variation.light_angular_radius.clamp(0.0, 1.0).tan(),
        }
    }

    /// Normal bias (m) that hides the map's texel steps, and change of reversed z per texel along both axes, of a
    /// surface with a normal in the light's axes.
    #[inline(always)]
    pub fn lift_and_tilt(&self, [slope_x, slope_y, slope_z]: [f32; 3]) -> (f32, [f32; 2]) {
        let texel = 1.0 / self.texels_per_m;
        let longest = 2.0 * texel;
        let facing = if -slope_z > 0.05 { -slope_z } else { 0.05 };
        // Larger at grazing angles.
        let lift = texel * (0.6 + 1.4 * (1.0 - facing));
        let (tilt_x, tilt_y) = (slope_x / -facing * texel, slope_y / -facing * texel);
        let length = (tilt_x * tilt_x + tilt_y * tilt_y).sqrt();
        let shrink = if length > longest { longest / length } else { 1.0 };
        (lift, [tilt_x * shrink, tilt_y * shrink])
    }

    pub fn on_map(&self, in_light: Vec3A) -> Corner {
        let local = in_light - self.center;
        Corner {
            x: (local.x + self.radius) * self.texels_per_m - 0.5,
            y: (local.y + self.radius) * self.texels_per_m - 0.5,
            reversed_z: 3.0 * self.radius - local.z,
        }
    }

    /// A horizontal plane at a height (m), with normal bias in its reversed z only; `None` if it faces away from the
    /// light.
    pub fn plane(&self, height: f32) -> Option<Plane> {
        let slope = self.light_from_world * Vec3A::Z;
        if slope.z > -0.01 {
            return None;
        }
        let (lift, _) = self.lift_and_tilt(slope.to_array());
        let at = |x: f32, y: f32, z: f32| self.on_map(self.light_from_world * Vec3A::new(x, y, z));
        let middle = at(0.0, 0.0, height);
        let lifted = height + lift;
        let (origin, right, up) = (at(0.0, 0.0, lifted), at(1.0, 0.0, lifted), at(0.0, 1.0, lifted));
        let step = |to: Corner| [to.x - origin.x, to.y - origin.y, to.reversed_z - origin.reversed_z];
        let ([a, b, e], [c, d, f]) = (step(right), step(up));
        let area = a * d - b * c;
        let (tilt_x, tilt_y) = ((e * d - f * b) / area, (a * f - c * e) / area);
        Some(Plane {
            x: [right.x - origin.x, up.x - origin.x, middle.x],
            y: [right.y - origin.y, up.y - origin.y, middle.y],
            reversed_z: [origin.reversed_z - origin.x * tilt_x - origin.y * tilt_y, tilt_x, tilt_y],
        })
    }

    /// Penumbra radius per metre between occluder and receiver [texels/m].
    pub fn radius_per_m(&self) -> f32 {
        self.spread * self.texels_per_m
    }

    /// Radius of the blocker search (texels).
    pub fn search_radius(&self) -> f32 {
        (self.spread * 0.5 * self.texels_per_m).clamp(2.0, MAX_RADIUS)
    }
}
