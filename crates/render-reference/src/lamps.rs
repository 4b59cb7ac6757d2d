//! Light sources: the key light as a disc, and the studio environment.

use glam::{Vec2, Vec3A};

use genmanip_render::internals::Lighting;

/// Light sources of a scene, with their sampling.
#[derive(Debug)]
pub(crate) struct Lamps<'a> {
    lighting: &'a Lighting,
    /// Cosine of the key light's angular radius.
    edge: f32,
    key_radiance: Vec3A,
}

/// Sampled direction to a light source.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightSample {
    pub direction: Vec3A,
    pub radiance: Vec3A,
    /// Probability density of the direction per solid angle (1/sr).
    pub chance: f32,
}

/// Smallest angular radius of the key light (rad), since the radiance of a point light would be infinite.
const SMALLEST: f32 = 1e-3;
/// Probability of sampling the studio uniformly; otherwise one of its area lights is sampled.
const EVERYWHERE: f32 = 0.5;

impl<'a> Lamps<'a> {
    pub fn new(lighting: &'a Lighting, angular_radius: f32) -> Self {
        let edge = angular_radius.clamp(SMALLEST, 1.5).cos();
        // `key` is the irradiance over π, and a disc of radiance L that a surface faces causes the irradiance π L sin²
        // of its angular radius.
        let key_radiance = lighting.key / (1.0 - edge * edge);
        Self { lighting, edge, key_radiance }
    }

    /// Radiance of the studio from a unit direction, without the key light.
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
            // Von Mises-Fisher distribution, sampled by inverting the cumulative distribution of the height below the
            // pole.
            let height = -(1.0 - at.x * (1.0 - (-2.0 * sharpness).exp())).ln() / sharpness;
            on_cap(axis, height.clamp(0.0, 2.0), at.y)
        };
        LightSample { direction, radiance: self.studio(direction), chance: self.studio_chance(direction) }
    }

    /// Radiance of the key light from a unit direction; zero outside its disc.
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

/// Direction on the unit sphere, at the height 1 - `below` along `axis`; `turn` is the azimuth in turns.
fn on_cap(axis: Vec3A, below: f32, turn: f32) -> Vec3A {
    let cosine = 1.0 - below;
    let flat = Vec2::from_angle(std::f32::consts::TAU * turn) * (1.0 - cosine * cosine).max(0.0).sqrt();
    let (right, up) = axis.any_orthonormal_pair();
    right * flat.x + up * flat.y + axis * cosine
}
