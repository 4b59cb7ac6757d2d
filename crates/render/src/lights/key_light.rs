//! Key light: axes of the light, and placement of its shadow map.

use glam::{Mat3A, Vec3A};

use crate::raster::Corner;
use crate::scene::variation::RenderVariation;

/// Largest penumbra radius (texels).
pub(crate) const MAX_RADIUS: f32 = 30.0;

/// Directional key light with the frame and scale of its shadow map.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct KeyLight {
    /// Texels along a side of the shadow map.
    pub size: usize,
    /// Rotation from the world to the light's axes: right, down and forward.
    pub light_from_world: Mat3A,
    pub center: Vec3A,
    pub radius: f32,
    pub texels_per_m: f32,
    /// Tangent of the light's angular radius.
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

    /// Normal bias (m) that hides the texel steps of the shadow map, and gradient of a surface's reversed z per texel
    /// along both axes of the map. The surface normal is given in the light's axes.
    #[inline(always)]
    pub fn lift_and_tilt(&self, [slope_x, slope_y, slope_z]: [f32; 3]) -> (f32, [f32; 2]) {
        let texel = 1.0 / self.texels_per_m;
        let longest = 2.0 * texel;
        let facing = if -slope_z > 0.05 { -slope_z } else { 0.05 };
        // The bias is larger at grazing angles.
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

    /// Radius of the blocker search (texels).
    pub fn search_radius(&self) -> f32 {
        (self.spread * 0.5 * self.texels_per_m).clamp(2.0, MAX_RADIUS)
    }
}
