//! The key light's axes, and how its map of shadows lies in the world.

use glam::{Mat3A, Vec3A};

use crate::raster::Corner;
use crate::scene::variation::RenderVariation;

/// Largest radius of a soft edge, texels.
pub(crate) const MAX_RADIUS: f32 = 30.0;

/// A level plane of the world on the map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    /// From x and y in the world, metres, and 1 to a column and to a row.
    pub x: [f32; 3],
    pub y: [f32; 3],
    /// Reversed z at the first texel, and what a column and a row add.
    pub reversed_z: [f32; 3],
}

/// The light's axes and the scale of the map.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct KeyLight {
    /// Texels per side of the map.
    pub size: usize,
    /// Rows: the light's right, down and forward axes in the world.
    pub light_from_world: Mat3A,
    pub center: Vec3A,
    pub radius: f32,
    pub texels_per_m: f32,
    /// Tangent of its angular radius.
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

    /// How far points of a surface are lifted along its normal, metres, so that the steps of the map do not show, and how
    /// much nearer to the light the surface is per texel along both axes; from its normal in the light's axes.
    #[inline(always)]
    pub fn lift_and_tilt(&self, [slope_x, slope_y, slope_z]: [f32; 3]) -> (f32, [f32; 2]) {
        let texel = 1.0 / self.texels_per_m;
        let longest = 2.0 * texel;
        let facing = if -slope_z > 0.05 { -slope_z } else { 0.05 };
        // More where the light grazes the surface.
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

    /// A level plane at a height, metres, as the map sees it, lifted only to compare its reversed_z; `None` where it is not lit.
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

    /// Radius of a soft edge per metre between what casts it and what it falls on, texels.
    pub fn radius_per_m(&self) -> f32 {
        self.spread * self.texels_per_m
    }

    /// Texels around a point within which it looks for blockers.
    pub fn search_radius(&self) -> f32 {
        (self.spread * 0.5 * self.texels_per_m).clamp(2.0, MAX_RADIUS)
    }

    /// Size of a texel, metres.
    pub fn texel_m(&self) -> f32 {
        1.0 / self.texels_per_m
    }
}
