//! The light that is everywhere: a soft studio of sky, reflecting ground and three large lamps.
//!
//! Made of a gradient and spherical Gaussians, so that its blurred copies for rough surfaces have closed forms.
//! Tables are filled once per light setting and only read while shading.

use std::ops::{Add, Mul, Sub};

use glam::{Vec2, Vec3A, Vec4};

use crate::lanes::{Vec3x4, each};
use crate::texture::linear_from_srgb;
use crate::variation::RenderVariation;

const LEVELS: usize = 12;
const SIDE: usize = 48;

/// Ambient light for diffuse and for glossy surfaces.
#[derive(Debug)]
pub(crate) struct Sky {
    /// Nine coefficients of the irradiance over π (Ramamoorthi and Hanrahan, 2001).
    harmonics: [Vec3x4; 9],
    /// Blurred surroundings per roughness level, octahedral maps of `SIDE`².
    glossy: Vec<Vec3A>,
}

impl Sky {
    pub fn new(variation: &RenderVariation) -> Self {
        let studio = Studio::new(variation);
        let mut harmonics = project(&studio);
        // The mean over the upper half is what the settings call ambient intensity.
        let scale = variation.ambient_intensity / luminance(irradiance_above(&harmonics)).max(1e-6);
        harmonics.iter_mut().for_each(|coefficient| *coefficient *= scale);
        let mut glossy = Vec::with_capacity(LEVELS * SIDE * SIDE);
        for level in 0..LEVELS {
            let roughness = level as f32 / (LEVELS - 1) as f32;
            for y in 0..SIDE {
                for x in 0..SIDE {
                    let place = Vec2::new(x as f32, y as f32) / (SIDE - 1) as f32;
                    glossy.push(studio.radiance(from_octahedron(place), roughness) * scale);
                }
            }
        }
        Self { harmonics: harmonics.map(Vec3x4::splat), glossy }
    }

    /// Brightness of white diffuse surfaces with these normals.
    #[inline]
    pub fn diffuse(&self, normal: Vec3x4) -> Vec3x4 {
        let [x, y, z] = [normal.x, normal.y, normal.z];
        let sum = self
            .harmonics
            .iter()
            .zip(harmonics_of(x, y, z))
            .fold(Vec3x4::splat(Vec3A::ZERO), |sum, (&coefficient, basis)| sum + coefficient * basis);
        sum.map(|value| value.max(Vec4::ZERO))
    }

    /// Light from unit directions, blurred as a surface of that roughness reflects it.
    #[inline]
    pub fn glossy(&self, direction: Vec3x4, roughness: f32) -> Vec3x4 {
        let level = (roughness * (LEVELS - 1) as f32 + 0.5) as usize;
        let map = &self.glossy[level.min(LEVELS - 1) * SIDE * SIDE..][..SIDE * SIDE];
        let [x, y] = to_octahedron(direction);
        let (x, y) = ((x * (SIDE - 1) as f32).to_array(), (y * (SIDE - 1) as f32).to_array());
        Vec3x4::from_lanes(each(|lane| {
            let (column, row) = ((x[lane] as i32 as usize).min(SIDE - 2), (y[lane] as i32 as usize).min(SIDE - 2));
            let (fx, fy) = (x[lane] - column as i32 as f32, y[lane] - row as i32 as f32);
            let first = row * SIDE + column;
            let ([a, b], [c, d]) = ([map[first], map[first + 1]], [map[first + SIDE], map[first + SIDE + 1]]);
            a.lerp(b, fx).lerp(c.lerp(d, fx), fy)
        }))
    }
}

struct Studio {
    sky: Vec3A,
    ground: Vec3A,
    /// Direction, sharpness, brightness.
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
                ((key + Vec3A::Z * 0.3).normalize(), 9.0, 1.0),
                ((side + Vec3A::Z * 0.45).normalize(), 14.0, 1.3),
                ((-side - key.with_z(0.0) * 0.6 + Vec3A::Z * 0.35).normalize(), 18.0, 0.9),
            ],
        }
    }

    fn radiance(&self, direction: Vec3A, roughness: f32) -> Vec3A {
        let blur = 0.06 + 0.9 * roughness;
        let t = ((direction.z / blur + 1.0) * 0.5).clamp(0.0, 1.0);
        let above = t * t * (3.0 - 2.0 * t);
        let overhead = 0.75 + 0.35 * direction.z.max(0.0);
        let gradient = self.ground.lerp(self.sky * overhead, above);
        let lamps: f32 = self
            .lamps
            .iter()
            .map(|&(axis, sharpness, brightness)| {
                let blurred = sharpness / (1.0 + sharpness * 0.5 * roughness * roughness);
                brightness * blurred / sharpness * (blurred * (direction.dot(axis) - 1.0)).exp()
            })
            .sum();
        gradient + self.sky * lamps
    }
}

fn project(studio: &Studio) -> [Vec3A; 9] {
    const DIRECTIONS: usize = 2048;
    let mut sums = [Vec3A::ZERO; 9];
    for index in 0..DIRECTIONS {
        let z = 1.0 - (2 * index + 1) as f32 / DIRECTIONS as f32;
        let flat = Vec2::from_angle(index as f32 * 2.399_963) * (1.0 - z * z).sqrt();
        let direction = Vec3A::from(flat.extend(z));
        let light = studio.radiance(direction, 0.0);
        for (sum, basis) in sums.iter_mut().zip(harmonics_of(direction.x, direction.y, direction.z)) {
            *sum += light * basis;
        }
    }
    let weight = 4.0 * std::f32::consts::PI / DIRECTIONS as f32;
    // Convolution with the cosine, divided by π.
    let band = [1.0, 2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0, 0.25, 0.25, 0.25, 0.25, 0.25];
    std::array::from_fn(|index| sums[index] * weight * band[index])
}

/// What a white diffuse surface that faces up receives.
fn irradiance_above(harmonics: &[Vec3A; 9]) -> Vec3A {
    harmonics
        .iter()
        .zip(harmonics_of(0.0, 0.0, 1.0))
        .fold(Vec3A::ZERO, |sum, (&coefficient, basis)| sum + coefficient * basis)
}

/// For one direction or for four.
#[inline]
fn harmonics_of<T>(x: T, y: T, z: T) -> [T; 9]
where
    T: Copy
        + Mul<T, Output = T>
        + Mul<f32, Output = T>
        + Sub<T, Output = T>
        + Sub<f32, Output = T>
        + Add<f32, Output = T>,
{
    [
        x * 0.0 + 0.282_095,
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

/// Brightness of a linear colour.
pub(crate) fn luminance(color: Vec3A) -> f32 {
    color.dot(Vec3A::new(0.2126, 0.7152, 0.0722))
}

/// Unit vectors → columns and rows in the unit square.
#[inline]
fn to_octahedron(direction: Vec3x4) -> [Vec4; 2] {
    let Vec3x4 { x, y, z } = direction;
    let inverse = (x.abs() + y.abs() + z.abs()).max(Vec4::splat(1e-12)).recip();
    let (x, y) = (x * inverse, y * inverse);
    let is_above = z.cmpge(Vec4::ZERO);
    let sign = |value: Vec4| Vec4::select(value.cmpge(Vec4::ZERO), Vec4::ONE, Vec4::NEG_ONE);
    let folded_x = Vec4::select(is_above, x, (Vec4::ONE - y.abs()) * sign(x));
    let folded_y = Vec4::select(is_above, y, (Vec4::ONE - x.abs()) * sign(y));
    let place = |value: Vec4| (value * 0.5 + 0.5).max(Vec4::ZERO).min(Vec4::ONE);
    [place(folded_x), place(folded_y)]
}

/// Unit square → unit vector.
fn from_octahedron(place: Vec2) -> Vec3A {
    let flat = place * 2.0 - 1.0;
    let z = 1.0 - flat.x.abs() - flat.y.abs();
    let unfolded = if z >= 0.0 { flat } else { fold(flat) };
    Vec3A::from(unfolded.extend(z)).normalize_or(Vec3A::Z)
}

#[inline]
fn fold(flat: Vec2) -> Vec2 {
    let sign = |value: f32| if value >= 0.0 { 1.0 } else { -1.0 };
    Vec2::new((1.0 - flat.y.abs()) * sign(flat.x), (1.0 - flat.x.abs()) * sign(flat.y))
}
