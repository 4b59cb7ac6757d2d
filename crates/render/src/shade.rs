//! The colour of a surface: metallic-roughness reflection of the key light and of the surroundings.
//!
//! GGX distribution with Hammon's approximation of the Smith visibility and Schlick's Fresnel term;
//! the surroundings through Karis' analytic fit of the split sum ("Physically Based Shading on Mobile", 2014).

use glam::Vec3A;

use crate::assets::Surface;
use crate::sky::Sky;
use crate::texture::linear_from_srgb;
use crate::variation::RenderVariation;

/// All light of a scene.
#[derive(Debug)]
pub(crate) struct Lighting {
    pub sky: Sky,
    to_light: Vec3A,
    /// Brightness of a white diffuse surface that faces the light.
    key: Vec3A,
    exposure: f32,
}

/// A surface point and how much light reaches it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfacePoint {
    /// Linear base colour, texture included.
    pub base: Vec3A,
    /// Unit, world frame, towards the viewer.
    pub normal: Vec3A,
    /// Unit, world frame, from the point to the viewer.
    pub to_viewer: Vec3A,
    /// Share of the key light that arrives.
    pub key_share: f32,
    /// Share of the ambient light that arrives.
    pub ambient_share: f32,
}

/// Light that leaves a point, linear, before the tone map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reflected {
    pub diffuse: Vec3A,
    pub specular: Vec3A,
    /// Schlick's weight at this viewing angle, 0 head-on and 1 at grazing.
    pub grazing: f32,
}

impl Lighting {
    pub fn new(variation: &RenderVariation) -> Self {
        Self {
            sky: Sky::new(variation),
            to_light: Vec3A::from_array(variation.light_direction).normalize_or(Vec3A::Z),
            key: linear_from_srgb(variation.light_color) * variation.light_intensity,
            exposure: variation.exposure,
        }
    }

    /// Light reflected towards the viewer.
    pub fn reflect(&self, surface: &Surface, point: &SurfacePoint) -> Reflected {
        let (normal, to_viewer) = (point.normal, point.to_viewer);
        let facing = normal.dot(to_viewer).clamp(1e-3, 1.0);
        let albedo = point.base * (1.0 - surface.metallic);
        let f0 = Vec3A::splat(surface.reflectance).lerp(point.base, surface.metallic);
        let mut diffuse = albedo * self.sky.diffuse(normal) * point.ambient_share;
        let mirrored = normal * (2.0 * normal.dot(to_viewer)) - to_viewer;
        // Corners that see little of the sky see little of it in their reflection, unless they are metal.
        let glossy_share = point.ambient_share + (1.0 - point.ambient_share) * 0.3 * surface.metallic;
        let mut specular = self.sky.glossy(mirrored, surface.roughness)
            * ambient_fresnel(f0, surface.roughness, facing)
            * glossy_share;
        let lit = normal.dot(self.to_light);
        if lit > 0.0 && point.key_share > 0.0 {
            let arriving = self.key * (lit * point.key_share);
            diffuse += albedo * arriving;
            // `key` is the irradiance over π, hence the factor.
            let lobe = ggx(surface.roughness, normal, to_viewer, self.to_light, facing, lit, f0) * std::f32::consts::PI;
            specular += arriving * lobe.min(Vec3A::splat(12.0));
        }
        Reflected { diffuse, specular, grazing: schlick_weight(facing) }
    }

    /// Linear display colour, 0-1, of light.
    #[inline]
    pub fn develop(&self, light: Vec3A) -> Vec3A {
        tone_map(light * self.exposure)
    }
}

/// Khronos PBR Neutral: colours below 0.76 stay what they are, highlights are compressed towards white.
pub(crate) fn tone_map(color: Vec3A) -> Vec3A {
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;
    let low = color.min_element();
    let offset = if low < 0.08 { low - 6.25 * low * low } else { 0.04 };
    let color = color - offset;
    let peak = color.max_element();
    if peak < START {
        return color;
    }
    let d = 1.0 - START;
    let new_peak = 1.0 - d * d / (peak + d - START);
    let weight = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    (color * (new_peak / peak)).lerp(Vec3A::splat(new_peak), weight)
}

#[inline]
fn schlick_weight(cosine: f32) -> f32 {
    let x = 1.0 - cosine.clamp(0.0, 1.0);
    let square = x * x;
    square * square * x
}

#[inline]
fn ggx(roughness: f32, normal: Vec3A, to_viewer: Vec3A, to_light: Vec3A, facing: f32, lit: f32, f0: Vec3A) -> Vec3A {
    let half = (to_viewer + to_light).normalize_or(normal);
    let n_h = normal.dot(half).clamp(0.0, 1.0);
    let alpha = roughness * roughness;
    let square = alpha * alpha;
    let denominator = n_h * n_h * (square - 1.0) + 1.0;
    let distribution = square / (std::f32::consts::PI * denominator * denominator);
    let smith = 0.5 / (2.0 * lit * facing * (1.0 - alpha) + (lit + facing) * alpha).max(1e-4);
    let fresnel = f0 + (Vec3A::ONE - f0) * schlick_weight(to_viewer.dot(half));
    fresnel * (distribution * smith)
}

#[inline]
fn ambient_fresnel(f0: Vec3A, roughness: f32, facing: f32) -> Vec3A {
    let smoothness = 1.0 - roughness;
    let edge = (smoothness * smoothness).min((-9.28 * facing).exp2()) * smoothness + 0.0425 - 0.0275 * roughness;
    let scale = -1.04 * edge + 1.04 - 0.572 * roughness;
    let bias = 1.04 * edge - 0.04 + 0.022 * roughness;
    (f0 * scale + bias).max(Vec3A::ZERO)
}
