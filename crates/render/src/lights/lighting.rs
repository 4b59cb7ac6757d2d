//! Lights of a scene: key light, sky and exposure.

use glam::Vec3A;

use crate::lights::sky::Sky;
use crate::scene::texture::linear_from_srgb;
use crate::scene::variation::RenderVariation;

/// Lights and exposure of a rendering.
#[derive(Debug)]
pub struct Lighting {
    /// Environment light.
    pub sky: Sky,
    /// Unit direction to the key light, world frame.
    pub to_light: Vec3A,
    /// Radiance of a white diffuse surface that faces the key light (irradiance over π), linear RGB before exposure.
    pub key: Vec3A,
    /// Squared half angular radius of the key light (rad²): the rotation of a mirror between reflecting its centre and
    /// its edge.
    pub key_turn_squared: f32,
    /// Factor applied before tone mapping.
    pub exposure: f32,
}

impl Lighting {
    /// Lights of a variation; `ground` is the mean linear colour of the support surfaces, which reflect light upwards.
    pub fn new(variation: &RenderVariation, ground: Option<Vec3A>) -> Self {
        Self {
            sky: Sky::new(variation, ground),
            to_light: Vec3A::from_array(variation.light_direction).normalize_or(Vec3A::Z),
            key: linear_from_srgb(variation.light_color) * variation.light_intensity,
            key_turn_squared: (variation.light_angular_radius.clamp(0.0, 1.0) / 2.0).powi(2),
            exposure: variation.exposure,
        }
    }

    /// Ambient light on a white diffuse surface with this unit normal, as radiance before exposure (linear RGB).
    pub fn around(&self, normal: Vec3A) -> Vec3A {
        Vec3A::from_array(self.sky.diffuse(normal.to_array()))
    }
}
