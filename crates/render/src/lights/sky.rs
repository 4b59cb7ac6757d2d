//! Sky light: a studio environment of a gradient, a reflecting ground and three large area lights.
//!
//! The area lights are spherical Gaussians, which are prefiltered for a roughness in closed form; that is cheaper than
//! looking up a prefiltered environment map.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::{Vec2, Vec3A};

use crate::scene::texture::linear_from_srgb;
use crate::scene::variation::RenderVariation;
use crate::simd::{dot, lerp, polynomial, smooth_step, within};

/// Brightness of the sky at the horizon and at the zenith, relative to its colour. Chosen by hand: a dark room with a
/// bright ceiling, so that metals and black surfaces have something to reflect.
const HORIZON: f32 = 0.4;
const ZENITH: f32 = 1.1;

/// Share of the lit support surface's radiance that objects above it receive, since they shade it: in diffuse and in
/// specular light. Fitted to path-traced images.
const GROUND_SEEN: [f32; 2] = [0.77, 0.85];
/// Additional share at contact, the height at which it halves (m), and the change of the share with the direction to
/// the key light: it is larger on lit sides, since an object shades the surface behind it. Fitted likewise.
const GROUND_NEAR: f32 = 0.6;
const NEAR_M: f32 = 0.055;
const NEAR_SIDE: f32 = 0.2;

/// Environment light for diffuse and glossy reflection.
#[derive(Debug)]
pub struct Sky {
    /// Spherical harmonics of the irradiance over π (Ramamoorthi and Hanrahan, 2001).
    harmonics: [[f32; 3]; 9],
    studio: Studio,
    /// Factor from the studio's radiance to the variation's ambient intensity.
    scale: f32,
    /// Radiance below the horizon in glossy reflections: of the support surface, or of the studio's ground, lit by key
    /// light and sky.
    lit_ground: Vec3A,
    /// Radiance of the support surface that lights objects close above it; zero without a support surface.
    near_ground: [f32; 3],
    /// Horizontal direction of the key light times [`NEAR_SIDE`].
    lamp_side: [f32; 2],
}

/// Environment prefiltered for one roughness.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Glossy {
    sky: [f32; 3],
    ground: [f32; 3],
    /// Inverse width of the transition from ground to sky, in z of the unit direction.
    sharpness: f32,
    /// Direction, sharpness and brightness of each area light.
    lamps: [([f32; 3], f32, f32); 3],
}

impl Sky {
    /// Environment of a variation; `support` is the mean linear colour of the support surfaces, `None` for the studio's
    /// bare ground.
    pub fn new(variation: &RenderVariation, support: Option<Vec3A>) -> Self {
        let studio = Studio::new(variation);
        let bare = project(&studio, |_| studio.ground);
        // The scale makes the luminance of the irradiance over π from above equal to the variation's ambient intensity.
        let scale = variation.ambient_intensity / luminance(irradiance_above(&bare)).max(1e-6);
        let to_light = Vec3A::from_array(variation.light_direction).normalize_or(Vec3A::Z);
        let key = linear_from_srgb(variation.light_color) * variation.light_intensity * to_light.z.max(0.0);
        let lit_ground = support.unwrap_or(studio.ground) * (key + variation.ambient_intensity);
        // Support surfaces are finite: a downward direction meets the support surface, a direction near the horizon the
        // studio's ground.
        let seen = lit_ground * GROUND_SEEN[0] / scale;
        let below = |direction: Vec3A| studio.ground.lerp(seen, smooth_step(-direction.z));
        let harmonics = support.map_or(bare, |_| project(&studio, below));
        let harmonics = harmonics.map(|coefficient| (coefficient * scale).to_array());
        let (share, near) = if support.is_some() { (GROUND_SEEN[1], lit_ground) } else { (1.0, Vec3A::ZERO) };
        let lamp_side = (to_light.truncate().normalize_or_zero() * NEAR_SIDE).to_array();
        Self { harmonics, studio, scale, lit_ground: lit_ground * share, near_ground: near.to_array(), lamp_side }
    }

    /// Ambient light on a white diffuse surface with this unit normal.
    #[inline(always)]
    pub fn diffuse(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let basis = harmonics_of(x, y, z);
        let mut out = [0.0; 3];
        for channel in 0..3 {
            let mut sum = self.harmonics[0][channel] * basis[0];
            for index in 1..9 {
                sum = self.harmonics[index][channel].mul_add(basis[index], sum);
            }
            out[channel] = if sum > 0.0 { sum } else { 0.0 };
        }
        out
    }

    /// Ambient light that the support surface adds on a white diffuse surface with this unit normal at a height above
    /// it (m).
    #[inline(always)]
    pub fn near_ground(&self, [x, y, z]: [f32; 3], height: f32) -> [f32; 3] {
        let side = self.lamp_side[0].mul_add(x, self.lamp_side[1].mul_add(y, GROUND_NEAR));
        let seen = z.mul_add(-0.5, 0.5) * side * NEAR_M / (height.abs() + NEAR_M);
        self.near_ground.map(|light| light * seen)
    }

    /// Unfiltered radiance from a unit direction, with the studio's ground below the horizon.
    pub fn radiance(&self, direction: Vec3A) -> Vec3A {
        self.studio.radiance(direction, self.studio.ground) * self.scale
    }

    /// Directions and sharpness of the area lights.
    pub fn lamps(&self) -> [(Vec3A, f32); 3] {
        self.studio.lamps.map(|(axis, sharpness, _)| (axis, sharpness))
    }

    /// Environment prefiltered for a perceptual roughness (0-1).
    pub(crate) fn glossy(&self, roughness: f32) -> Glossy {
        let lamps = self.studio.lamps.map(|(axis, sharpness, brightness)| {
            let blurred = sharpness / (1.0 + sharpness * 0.5 * roughness * roughness);
            (axis.to_array(), blurred, brightness * blurred / sharpness)
        });
        Glossy {
            sky: (self.studio.sky * self.scale).to_array(),
            ground: self.lit_ground.to_array(),
            sharpness: 0.5 / (0.06 + 0.9 * roughness),
            lamps,
        }
    }
}

impl Glossy {
    /// Prefiltered radiance from a unit direction.
    #[inline(always)]
    pub fn at(&self, direction: [f32; 3]) -> [f32; 3] {
        let z = direction[2];
        let above = smooth_step(z.mul_add(self.sharpness, 0.5));
        let overhead = (if z > 0.0 { z } else { 0.0 }).mul_add(ZENITH - HORIZON, HORIZON);
        let mut lamps = 0.0;
        for (axis, sharpness, brightness) in self.lamps {
            lamps = exp(sharpness * (dot(direction, axis) - 1.0)).mul_add(brightness, lamps);
        }
        let mut out = [0.0; 3];
        for channel in 0..3 {
            let (sky, ground) = (self.sky[channel], self.ground[channel]);
            out[channel] = sky.mul_add(lamps, lerp(ground, sky * overhead, above));
        }
        out
    }
}

/// Exponential function for `x` ≤ 0 with a relative error of 10⁻⁵, without a call to the mathematics library.
#[inline(always)]
fn exp(x: f32) -> f32 {
    let scaled = within(x * std::f32::consts::LOG2_E, -126.0, 0.0);
    // Adding 1.5 · 2²³ rounds to an integer, which is then stored in the low bits.
    let shifted = scaled + 12_582_912.0;
    let whole = shifted - 12_582_912.0;
    let u = (scaled - whole) * std::f32::consts::LN_2;
    polynomial([1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0], u)
        * f32::from_bits(shifted.to_bits().wrapping_add(127) << 23)
}

#[derive(Debug)]
struct Studio {
    sky: Vec3A,
    ground: Vec3A,
    /// Direction, sharpness and brightness of each area light.
    lamps: [(Vec3A, f32, f32); 3],
}

impl Studio {
    fn new(variation: &RenderVariation) -> Self {
        let key = Vec3A::from_array(variation.light_direction).normalize_or(Vec3A::Z);
        let side = Vec3A::new(-key.y, key.x, 0.0).normalize_or(Vec3A::Y);
        Self {
            sky: linear_from_srgb(variation.sky_color),
            ground: linear_from_srgb(variation.ground_color) * 0.55,
            lamps: [
                ((key + Vec3A::Z * 0.3).normalize(), 14.0, 2.0),
                ((side + Vec3A::Z * 0.45).normalize(), 24.0, 2.8),
                ((-side - key.with_z(0.0) * 0.6 + Vec3A::Z * 0.35).normalize(), 30.0, 2.0),
            ],
        }
    }

    /// Radiance from a unit direction, with this ground radiance below the horizon.
    fn radiance(&self, direction: Vec3A, ground: Vec3A) -> Vec3A {
        let above = smooth_step((direction.z / 0.06 + 1.0) * 0.5);
        let overhead = HORIZON + (ZENITH - HORIZON) * direction.z.max(0.0);
        let gradient = ground.lerp(self.sky * overhead, above);
        let lamp = |&(axis, sharpness, brightness): &(Vec3A, f32, f32)| {
            brightness * (sharpness * (direction.dot(axis) - 1.0)).exp()
        };
        gradient + self.sky * self.lamps.iter().map(lamp).sum::<f32>()
    }
}

/// Spherical-harmonics coefficients of irradiance over π, for a ground radiance that depends on the direction.
fn project(studio: &Studio, ground: impl Fn(Vec3A) -> Vec3A) -> [Vec3A; 9] {
    const DIRECTIONS: usize = 2048;
    let mut sums = [Vec3A::ZERO; 9];
    for index in 0..DIRECTIONS {
        let z = 1.0 - (2 * index + 1) as f32 / DIRECTIONS as f32;
        let flat = Vec2::from_angle(index as f32 * 2.399_963) * (1.0 - z * z).sqrt();
        let direction = Vec3A::from(flat.extend(z));
        let light = studio.radiance(direction, ground(direction));
        for (sum, basis) in sums.iter_mut().zip(harmonics_of(direction.x, direction.y, direction.z)) {
            *sum += light * basis;
        }
    }
    let weight = 4.0 * std::f32::consts::PI / DIRECTIONS as f32;
    // Convolution with the cosine lobe, divided by π.
    let band = [1.0, 2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0, 0.25, 0.25, 0.25, 0.25, 0.25];
    std::array::from_fn(|index| sums[index] * weight * band[index])
}

/// Irradiance over π on a surface facing up.
fn irradiance_above(harmonics: &[Vec3A; 9]) -> Vec3A {
    harmonics
        .iter()
        .zip(harmonics_of(0.0, 0.0, 1.0))
        .fold(Vec3A::ZERO, |sum, (&coefficient, basis)| sum + coefficient * basis)
}

#[inline(always)]
fn harmonics_of(x: f32, y: f32, z: f32) -> [f32; 9] {
    [
        0.282_095,
        y * 0.488_603,
        z * 0.488_603,
        x * 0.488_603,
        x * y * 1.092_548,
        y * z * 1.092_548,
        (z * z * 3.0 - 1.0) * 0.315_392,
        x * z * 1.092_548,
        (x * x - y * y) * 0.546_274,
    ]
}

/// Relative luminance of a linear colour.
pub fn luminance(color: Vec3A) -> f32 {
    color.dot(Vec3A::new(0.2126, 0.7152, 0.0722))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The support surface lights objects close above it from below, more when closer, most on the lit side.
    #[test]
    fn a_support_lights_what_is_close_above_it() {
        let variation = RenderVariation::default();
        let sky = Sky::new(&variation, Some(Vec3A::splat(0.6)));
        let to_light = Vec3A::from_array(variation.light_direction).with_z(0.0).normalize().to_array();
        let [down, up, away] = [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], to_light.map(|value| -value)];
        let seen = |normal, height| sky.near_ground(normal, height)[1];
        assert!(seen(down, 0.0) > 2.0 * seen(down, 0.1), "{} at 0.1 m", seen(down, 0.1));
        assert!(
            seen(down, 0.0) > seen(to_light, 0.0) && seen(to_light, 0.0) > seen(away, 0.0) && seen(away, 0.0) > 0.0
        );
        assert_eq!(seen(up, 0.0), 0.0);
        assert_eq!(Sky::new(&variation, None).near_ground(down, 0.0), [0.0; 3]);
    }
}
