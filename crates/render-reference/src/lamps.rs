//! Where light comes from: the key light as a disc, and the studio around the scene.

use glam::{Vec2, Vec3A};

use genmanip_render::internals::Lighting;

/// All light of a scene, to be drawn by chance.
#[derive(Debug)]
pub(crate) struct Lamps<'a> {
    lighting: &'a Lighting,
    /// Cosine of the key light's angular radius.
    edge: f32,
    key_radiance: Vec3A,
}

/// A direction from which light may come.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arrival {
    pub direction: Vec3A,
    pub radiance: Vec3A,
    /// Chance per solid angle.
    pub chance: f32,
}

/// Smallest angular radius of the key light, radians: a point has no radiance.
const SMALLEST: f32 = 1e-3;
/// Share of the studio's samples that go everywhere alike; the others go to its lamps.
const EVERYWHERE: f32 = 0.5;

impl<'a> Lamps<'a> {
    pub fn new(lighting: &'a Lighting, angular_radius: f32) -> Self {
        let edge = angular_radius.clamp(SMALLEST, 1.5).cos();
        // A surface that faces the disc receives π times the brightness of a white one.
        let key_radiance = lighting.key / (1.0 - edge * edge);
        Self { lighting, edge, key_radiance }
    }

    /// Light of the studio from a direction, without the key light.
    pub fn studio(&self, direction: Vec3A) -> Vec3A {
        self.lighting.sky.radiance(direction)
    }

    /// Chance per solid angle with which [`Lamps::draw_studio`] draws a direction.
    pub fn studio_chance(&self, direction: Vec3A) -> f32 {
        let lamps = self.lighting.sky.lamps();
        let of_lamp = |(axis, sharpness): (Vec3A, f32)| {
            sharpness * (sharpness * (direction.dot(axis) - 1.0)).exp()
                / (std::f32::consts::TAU * (1.0 - (-2.0 * sharpness).exp()))
        };
        let mean = lamps.map(of_lamp).iter().sum::<f32>() / lamps.len() as f32;
        EVERYWHERE / (4.0 * std::f32::consts::PI) + (1.0 - EVERYWHERE) * mean
    }

    pub fn draw_studio(&self, choice: f32, at: Vec2) -> Arrival {
        let direction = if choice < EVERYWHERE {
            on_cap(Vec3A::Z, 2.0 * at.x, at.y)
        } else {
            let lamps = self.lighting.sky.lamps();
            let share = (choice - EVERYWHERE) / (1.0 - EVERYWHERE);
            let (axis, sharpness) = lamps[((share * lamps.len() as f32) as usize).min(lamps.len() - 1)];
            // A von Mises-Fisher distribution: height over the cap by inversion.
            let height = -(1.0 - at.x * (1.0 - (-2.0 * sharpness).exp())).ln() / sharpness;
            on_cap(axis, height.clamp(0.0, 2.0), at.y)
        };
        Arrival { direction, radiance: self.studio(direction), chance: self.studio_chance(direction) }
    }

    /// Light of the key light from a direction.
    pub fn key(&self, direction: Vec3A) -> Vec3A {
        if direction.dot(self.lighting.to_light) >= self.edge { self.key_radiance } else { Vec3A::ZERO }
    }

    /// Chance per solid angle with which [`Lamps::draw_key`] draws a direction.
    pub fn key_chance(&self, direction: Vec3A) -> f32 {
        let inside = direction.dot(self.lighting.to_light) >= self.edge;
        if inside { 1.0 / (std::f32::consts::TAU * (1.0 - self.edge)) } else { 0.0 }
    }

    pub fn draw_key(&self, at: Vec2) -> Arrival {
        Arrival {
            direction: on_cap(self.lighting.to_light, at.x * (1.0 - self.edge), at.y),
            radiance: self.key_radiance,
            chance: 1.0 / (std::f32::consts::TAU * (1.0 - self.edge)),
        }
    }
}

/// The direction so much below the tip of the unit sphere around an axis.
fn on_cap(axis: Vec3A, below: f32, turn: f32) -> Vec3A {
    let cosine = 1.0 - below;
    let flat = Vec2::from_angle(std::f32::consts::TAU * turn) * (1.0 - cosine * cosine).max(0.0).sqrt();
    let (right, up) = axis.any_orthonormal_pair();
    right * flat.x + up * flat.y + axis * cosine
}
