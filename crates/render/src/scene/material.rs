//! Materials ready for shading.

use std::sync::Arc;

use glam::Vec3A;

use crate::scene::texture::{MipTexture, linear_from_srgb};

/// A material ready for shading: linear colours, no optional parameters.
#[derive(Clone, Debug)]
pub struct Material {
    /// Linear base colour, multiplied with the texture.
    pub base: Vec3A,
    /// Perceptual roughness, 0.05-1.
    pub roughness: f32,
    /// 0 for a dielectric, 1 for a metal.
    pub metallic: f32,
    /// 1 for an opaque material.
    pub opacity: f32,
    /// Dielectric reflectance at normal incidence.
    pub reflectance: f32,
    /// Texture of the base colour.
    pub texture: Option<Arc<MipTexture>>,
}

impl Material {
    /// Share of light that one interface scatters diffusely; 1 for an opaque material. Most view rays cross two
    /// interfaces, whose opacities combine to the material's. Clear glass mostly tints, dense or rough glass mostly
    /// scatters. Chosen.
    pub fn scatters(&self) -> f32 {
        if self.opacity < 1.0 { self.held() * self.haze() } else { 1.0 }
    }

    /// Transmission colour of one interface of a transparent material with base colour `base`; darker at grazing angles
    /// for a shell, whose wall is crossed at a slant.
    pub fn tint(&self, base: Vec3A, cosine: f32, is_shell: bool) -> Vec3A {
        let depth = (2.0 * self.held()).min(1.0);
        let tint = Vec3A::ONE.lerp(base, depth).max(Vec3A::splat(1e-3));
        if is_shell { tint.powf(1.0 / cosine.max(0.2)) } else { tint }
    }

    /// Share of light that one interface transmits, before tinting: neither reflected (Fresnel) nor scattered.
    #[inline(always)]
    pub fn passing(&self, cosine: f32) -> f32 {
        let mirrored = self.reflectance + (1.0 - self.reflectance) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5);
        (1.0 - mirrored) * (1.0 - self.scatters())
    }

    /// Mean linear colour over the texture.
    pub fn mean_color(&self) -> Vec3A {
        self.base * self.texture.as_ref().map_or(Vec3A::ONE, |texture| texture.mean())
    }

    /// Index of refraction, from the reflectance at normal incidence.
    pub fn index_of_refraction(&self) -> f32 {
        let root = self.reflectance.sqrt();
        (1.0 + root) / (1.0 - root).max(1e-3)
    }

    /// Opacity of one of two interfaces.
    fn held(&self) -> f32 {
        1.0 - (1.0 - self.opacity).sqrt()
    }

    /// Share of the opacity that scatters.
    fn haze(&self) -> f32 {
        (self.opacity * self.opacity).max(2.0 * (self.roughness - 0.1)).clamp(0.0, 1.0)
    }

    /// The material of a visual part.
    pub fn new(material: &genmanip_core::Material) -> Self {
        let ior = material.ior.max(1.0);
        Self {
            base: linear_from_srgb(material.base_color),
            roughness: material.roughness.clamp(0.05, 1.0),
            metallic: material.metallic.clamp(0.0, 1.0),
            opacity: material.opacity.clamp(0.0, 1.0),
            reflectance: ((ior - 1.0) / (ior + 1.0)).powi(2),
            texture: material.texture.as_ref().and_then(MipTexture::shared),
        }
    }
}
