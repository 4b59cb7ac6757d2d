//! Materials ready for shading.

use std::sync::Arc;

use glam::Vec3A;

use crate::scene::texture::{MipTexture, linear_from_srgb};

/// Material in the form that shading needs: linear colours, no optional parameters.
#[derive(Clone, Debug)]
pub struct Material {
    /// Linear base colour (albedo or metal reflectance), multiplied with the texture.
    pub base: Vec3A,
    /// Perceptual roughness, 0.05-1.
    pub roughness: f32,
    /// Metallic parameter: 0 for a dielectric, 1 for a metal.
    pub metallic: f32,
    /// Opacity, 0-1; 1 for an opaque material.
    pub opacity: f32,
    /// Dielectric reflectance at normal incidence.
    pub reflectance: f32,
    /// Texture of the base colour.
    pub texture: Option<Arc<MipTexture>>,
}

impl Material {
    /// Share of light that one interface scatters diffusely; 1 for an opaque material. Most view rays cross two
    /// interfaces, which together have the material's opacity. The scattered share of the opacity (`haze`) is
    /// chosen by hand: clear glass mostly tints, dense or rough glass mostly scatters.
    pub fn scatters(&self) -> f32 {
        if self.opacity < 1.0 { self.held() * self.haze() } else { 1.0 }
    }

    /// Transmittance per colour channel of one interface of a transparent material with base colour `base`. A
    /// shell (`is_shell`) is a mesh that is not closed: its interface is a wall, which is darker at grazing angles,
    /// where the path through it is longer. `cosine` is that of the angle between view ray and normal.
    pub fn tint(&self, base: Vec3A, cosine: f32, is_shell: bool) -> Vec3A {
        let depth = (2.0 * self.held()).min(1.0);
        let tint = Vec3A::ONE.lerp(base, depth).max(Vec3A::splat(1e-3));
        if is_shell { tint.powf(1.0 / cosine.max(0.2)) } else { tint }
    }

    /// Share of light that one interface transmits before tinting: neither reflected (Fresnel) nor scattered.
    #[inline(always)]
    pub fn passing(&self, cosine: f32) -> f32 {
        let mirrored = self.reflectance + (1.0 - self.reflectance) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5);
        (1.0 - mirrored) * (1.0 - self.scatters())
    }

    /// Mean linear base colour over the texture.
    pub fn mean_color(&self) -> Vec3A {
        self.base * self.texture.as_ref().map_or(Vec3A::ONE, |texture| texture.mean())
    }

    /// Index of refraction, computed from the reflectance at normal incidence.
    pub fn index_of_refraction(&self) -> f32 {
        let root = self.reflectance.sqrt();
        (1.0 + root) / (1.0 - root).max(1e-3)
    }

    /// Opacity of each of two equal interfaces which together have the material's opacity.
    fn held(&self) -> f32 {
        1.0 - (1.0 - self.opacity).sqrt()
    }

    /// Share of the opacity that scatters light instead of tinting it, 0-1.
    fn haze(&self) -> f32 {
        (self.opacity * self.opacity).max(2.0 * (self.roughness - 0.1)).clamp(0.0, 1.0)
    }

    /// Rough dielectric of a linear base colour, without texture.
    pub fn matt(base: Vec3A) -> Self {
        Self { base, roughness: 0.8, metallic: 0.0, opacity: 1.0, reflectance: 0.04, texture: None }
    }

    /// Material of a visual part, with values clamped to their valid ranges.
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
