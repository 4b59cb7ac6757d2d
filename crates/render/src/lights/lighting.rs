//! The lights of a scene.

use glam::Vec3A;

use crate::lights::sky::Sky;
use crate::scene::material::Material;
use crate::scene::texture::linear_from_srgb;
use crate::scene::variation::RenderVariation;

/// All light of a scene.
#[derive(Debug)]
pub struct Lighting {
    pub sky: Sky,
    pub to_light: Vec3A,
    /// Brightness of a white diffuse surface that faces the light.
    pub key: Vec3A,
    /// How far a mirror turns from the lamp's centre to its edge, squared radians: half the lamp's angular radius.
    pub key_turn_squared: f32,
    pub exposure: f32,
}

impl Lighting {
    /// The light of a variation on things made of some surfaces: the table among them throws light back.
    pub fn new(variation: &RenderVariation, surfaces: &[Material]) -> Self {
        let table = surfaces.iter().find(|surface| surface.is_table).map(Material::mean_color);
        Self {
            sky: Sky::new(variation, table),
            to_light: Vec3A::from_array(variation.light_direction).normalize_or(Vec3A::Z),
            key: linear_from_srgb(variation.light_color) * variation.light_intensity,
            key_turn_squared: (variation.light_angular_radius.clamp(0.0, 1.0) / 2.0).powi(2),
            exposure: variation.exposure,
        }
    }

    /// Brightness of a white diffuse surface with a unit normal in the ambient light.
    pub fn around(&self, normal: Vec3A) -> Vec3A {
        Vec3A::from_array(self.sky.diffuse(normal.to_array()))
    }
}
