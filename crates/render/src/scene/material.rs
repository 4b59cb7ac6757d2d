//! Materials ready for shading.

use std::sync::Arc;

use glam::Vec3A;

use crate::scene::texture::{MipTexture, linear_from_srgb};

/// A material ready for shading: linear colour, no optional parameters.
#[derive(Clone, Debug)]
pub struct Material {
    pub base: Vec3A,
    pub roughness: f32,
    pub metallic: f32,
    pub opacity: f32,
    /// Reflectance of a dielectric seen head-on.
    pub reflectance: f32,
    pub texture: Option<Arc<MipTexture>>,
    /// Whether it is the table's top, which a [`crate::RenderVariation`] makes of something else.
    pub is_table: bool,
}

impl Material {
    /// Share of the light that one side scatters; the others of a transparent thing mirror and let pass. Most sights
    /// pass two sides, which hold back the material's opacity together: what is clear mostly colours the light, what is
    /// dense or rough mostly scatters it. Chosen.
    pub fn scatters(&self) -> f32 {
        if self.opacity < 1.0 { self.held() * self.haze() } else { 1.0 }
    }

    /// Colour of the light that passes one side of a transparent thing, of a material that looks like `base`: deeper where
    /// a shell is met at a slant, since the way through it is longer there.
    pub fn tint(&self, base: Vec3A, cosine: f32, is_shell: bool) -> Vec3A {
        let depth = (2.0 * self.held()).min(1.0);
        let tint = Vec3A::ONE.lerp(base, depth).max(Vec3A::splat(1e-3));
        if is_shell { tint.powf(1.0 / cosine.max(0.2)) } else { tint }
    }

    /// Share of the light that passes one side, whatever its colour: neither mirrored nor scattered.
    #[inline(always)]
    pub fn passing(&self, cosine: f32) -> f32 {
        let mirrored = self.reflectance + (1.0 - self.reflectance) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5);
        (1.0 - mirrored) * (1.0 - self.scatters())
    }

    /// Linear colour on average over the texture.
    pub fn mean_color(&self) -> Vec3A {
        self.base * self.texture.as_ref().map_or(Vec3A::ONE, |texture| texture.mean())
    }

    pub fn index_of_refraction(&self) -> f32 {
        let root = self.reflectance.sqrt();
        (1.0 + root) / (1.0 - root).max(1e-3)
    }

    /// Share of the light that one side does not let pass as it is, mirrors apart.
    fn held(&self) -> f32 {
        1.0 - (1.0 - self.opacity).sqrt()
    }

    /// Share of that which is scattered.
    fn haze(&self) -> f32 {
        (self.opacity * self.opacity).max(2.0 * (self.roughness - 0.1)).clamp(0.0, 1.0)
    }

    pub fn new(material: &genmanip_core::Material) -> Self {
        let ior = material.ior.max(1.0);
        Self {
            base: linear_from_srgb(material.base_color),
            roughness: material.roughness.clamp(0.05, 1.0),
            metallic: material.metallic.clamp(0.0, 1.0),
            opacity: material.opacity.clamp(0.0, 1.0),
            reflectance: ((ior - 1.0) / (ior + 1.0)).powi(2),
            texture: material.texture.as_ref().and_then(MipTexture::shared),
            is_table: false,
        }
    }
}
