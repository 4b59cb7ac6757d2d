//! Light sources: the key light as a disc, and the studio environment.

use glam::{Vec2, Vec3A};

use genmanip_render::internals::Lighting;

/// Light sources of a scene, to be sampled.
#[derive(Debug)]
pub(crate) struct Lamps<'a> {
    lighting: &'a Lighting,
    /// Cosine of the key light's angular radius.
    edge: f32,
    key_radiance: Vec3A,
}

/// Sample of a light source.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightSample {
    pub direction: Vec3A,
    pub radiance: Vec3A,
    /// Probability density per solid angle.
    pub chance: f32,
}

/// Smallest angular radius of the key light [rad]: a point has infinite radiance.
const SMALLEST: f32 = 1e-3;
/// Probability of uniform sampling of the studio; otherwise its area lights are sampled.
const EVERYWHERE: f32 = 0.5;

impl<'a> Lamps<'a> {
    pub fn new(lighting: &'a Lighting, angular_radius: f32) -> Self {
        let edge = angular_radius.clamp(SMALLEST, 1.5).cos();
        // A surface that faces the disc has π times the radiosity of a white one.
        let key_radiance = lighting.key / (1.0 - edge * edge);
        Self { lighting, edge, key_radiance }
    }

    /// Radiance of the studio, without the key light.
    pub fn studio(&self, direction: Vec3A) -> Vec3A {
        self.lighting.sky.radiance(direction)
    }

    /// Probability density with which [`Lamps::draw_studio`] samples a direction.
    pub fn studio_chance(&self, direction: Vec3A) -> f32 {
        let lamps = self.lighting.sky.lamps();
        let of_lamp = |(axis, sharpness): (Vec3A, f32)| {
            sharpness * (sharpness * (direction.dot(axis) - 1.0)).exp()
                / (std::f32::consts::TAU * (1.0 - (-2.0 * sharpness).exp()))
        };
        let mean = lamps.map(of_lamp).iter().sum::<f32>() / lamps.len() as f32;
        EVERYWHERE / (4.0 * std::f32::consts::PI) + (1.0 - EVERYWHERE) * mean
    }

    pub fn draw_studio(&self, choice: f32, at: Vec2) -> LightSample {
        let direction = if choice < EVERYWHERE {
            on_cap(Vec3A::Z, 2.0 * at.x, at.y)
        } else {
            let lamps = self.lighting.sky.lamps();
            let share = (choice - EVERYWHERE) / (1.0 - EVERYWHERE);
            let (axis, sharpness) = lamps[((share * lamps.len() as f32) as usize).min(lamps.len() - 1)];
            // Von Mises-Fisher distribution by inversion of the height.
            let height = -(1.0 - at.x * (1.0 - (-2.0 * sharpness).exp())).ln() / sharpness;
            on_cap(axis, height.clamp(0.0, 2.0), at.y)
        };
        LightSample { direction, radiance: self.studio(direction), chance: self.studio_chance(direction) }
    }

    /// Radiance of the key light from a direction.
    pub fn key(&self, direction: Vec3A) -> Vec3A {
        if direction.dot(self.lighting.to_light) >= self.edge { self.key_radiance } else { Vec3A::ZERO }
    }

    /// Probability density with which [`Lamps::draw_key`] samples a direction.
    pub fn key_chance(&self, direction: Vec3A) -> f32 {
        let inside = direction.dot(self.lighting.to_light) >= self.edge;
        if inside { 1.0 / (std::f32::consts::TAU * (1.0 - self.edge)) } else { 0.0 }
    }

    pub fn draw_key(&self, at: Vec2) -> LightSample {
        LightSample {
            direction: on_cap(self.lighting.to_light, at.x * (1.0 - self.edge), at.y),
            radiance: self.key_radiance,
            chance: 1.0 / (std::f32::consts::TAU * (1.0 - self.edge)),
        }
    }
}

/// Direction at a height below the pole of the unit sphere around an axis.
fn on_cap(axis: Vec3A, below: f32, turn: f32) -> Vec3A {
    let cosine = 1.0 - below;
    let flat = Vec2::from_angle(std::f32::consts::TAU * turn) * (1.0 - cosine * cosine).max(0.0).sqrt();
    let (right, up) = axis.any_orthonormal_pair();
    right * flat.x + up * flat.y + axis * cosine
}
