//! The colour of a surface: metallic-roughness reflection of the key light and of the surroundings.
//!
//! GGX distribution with Hammon's approximation of the Smith visibility and Schlick's Fresnel term;
//! the surroundings through Karis' analytic fit of the split sum ("Physically Based Shading on Mobile", 2014).
//! Four points at a time.

use glam::{Vec3A, Vec4};

use crate::assets::Surface;
use crate::lanes::Vec3x4;
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

/// Four points of one material and how much light reaches them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfacePoints {
    /// Linear base colour, texture included.
    pub base: Vec3x4,
    /// Unit, world frame, towards the viewer.
    pub normal: Vec3x4,
    /// Unit, world frame, from the point to the viewer.
    pub to_viewer: Vec3x4,
    /// Share of the key light that arrives.
    pub key_share: Vec4,
    /// Share of the ambient light that arrives.
    pub ambient_share: Vec4,
}

/// Light that leaves the points, linear, before the tone map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reflected {
    pub diffuse: Vec3x4,
    pub specular: Vec3x4,
    /// Schlick's weight at this viewing angle, 0 head-on and 1 at grazing.
    pub grazing: Vec4,
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
    #[inline]
    pub fn reflect(&self, surface: &Surface, points: &SurfacePoints) -> Reflected {
        let (normal, to_viewer) = (points.normal, points.to_viewer);
        let (reflectance, metallic) = (Vec4::splat(surface.reflectance), surface.metallic);
        let cosine = normal.dot(to_viewer);
        let facing = cosine.max(Vec4::splat(1e-3)).min(Vec4::ONE);
        let albedo = points.base * (1.0 - metallic);
        let f0 = points.base.map(|base| reflectance + (base - reflectance) * metallic);
        let mut diffuse = albedo * self.sky.diffuse(normal) * points.ambient_share;
        let mirrored = normal * (cosine + cosine) - to_viewer;
        // Corners that see little of the sky see little of it in their reflection, unless they are metal.
        let glossy_share = points.ambient_share + (Vec4::ONE - points.ambient_share) * (0.3 * metallic);
        let mut specular = self.sky.glossy(mirrored, surface.roughness)
            * ambient_fresnel(f0, surface.roughness, facing)
            * glossy_share;
        let lit = normal.dot(Vec3x4::splat(self.to_light)).max(Vec4::ZERO);
        let strength = lit * points.key_share;
        if strength.max_element() > 0.0 {
            let arriving = Vec3x4::splat(self.key) * strength;
            diffuse += albedo * arriving;
            let lobe = self.ggx(surface.roughness, points, facing, lit, f0);
            // `key` is the irradiance over π, hence the factor.
            specular += arriving * (lobe * std::f32::consts::PI).map(|lobe| lobe.min(Vec4::splat(12.0)));
        }
        Reflected { diffuse, specular, grazing: schlick_weight(facing) }
    }

    /// Linear display colours, 0-1, of light.
    #[inline]
    pub fn develop(&self, light: Vec3x4) -> Vec3x4 {
        tone_map(light * self.exposure)
    }

    #[inline]
    fn ggx(&self, roughness: f32, points: &SurfacePoints, facing: Vec4, lit: Vec4, f0: Vec3x4) -> Vec3x4 {
        let sum = points.to_viewer + Vec3x4::splat(self.to_light);
        let half = sum * sum.dot(sum).max(Vec4::splat(1e-12)).sqrt().recip();
        let n_h = points.normal.dot(half).max(Vec4::ZERO).min(Vec4::ONE);
        let alpha = roughness * roughness;
        let square = alpha * alpha;
        let denominator = n_h * n_h * (square - 1.0) + 1.0;
        let smith = (lit * facing * (2.0 * (1.0 - alpha)) + (lit + facing) * alpha).max(Vec4::splat(1e-4));
        let lobe = Vec4::splat(square * 0.5 / std::f32::consts::PI) / (denominator * denominator * smith);
        let weight = schlick_weight(points.to_viewer.dot(half));
        f0.map(|f0| f0 + (Vec4::ONE - f0) * weight) * lobe
    }
}

/// Khronos PBR Neutral: colours below 0.76 stay what they are, highlights are compressed towards white.
#[inline]
pub(crate) fn tone_map(color: Vec3x4) -> Vec3x4 {
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;
    let low = color.min_element();
    let offset = Vec4::select(low.cmplt(Vec4::splat(0.08)), low - low * low * 6.25, Vec4::splat(0.04));
    let color = color.map(|channel| channel - offset);
    let peak = color.max_element();
    let is_bright = peak.cmpge(Vec4::splat(START));
    if !is_bright.any() {
        return color;
    }
    let d = 1.0 - START;
    let new_peak = 1.0 - d * d / (peak + (d - START));
    let weight = 1.0 - ((peak - new_peak) * DESATURATION + 1.0).recip();
    let scale = new_peak / peak;
    let compressed = color.map(|channel| {
        let scaled = channel * scale;
        scaled + (new_peak - scaled) * weight
    });
    Vec3x4::select(is_bright, compressed, color)
}

#[inline]
fn schlick_weight(cosine: Vec4) -> Vec4 {
    let x = Vec4::ONE - cosine.max(Vec4::ZERO).min(Vec4::ONE);
    let square = x * x;
    square * square * x
}

#[inline]
fn ambient_fresnel(f0: Vec3x4, roughness: f32, facing: Vec4) -> Vec3x4 {
    let smoothness = 1.0 - roughness;
    let limit = Vec4::splat(smoothness * smoothness);
    let edge = limit.min(exp2_of_negative(facing)) * smoothness + (0.0425 - 0.0275 * roughness);
    let scale = edge * -1.04 + (1.04 - 0.572 * roughness);
    let bias = edge * 1.04 + (0.022 * roughness - 0.04);
    f0.map(|f0| (f0 * scale + bias).max(Vec4::ZERO))
}

/// 2 to the power of `-9.28 x` for `x` 0-1, to a thousandth of its value: the series of an eighth of it, squared thrice.
#[inline]
fn exp2_of_negative(x: Vec4) -> Vec4 {
    const RATE: f32 = -9.28 / 8.0 * std::f32::consts::LN_2;
    let u = x * RATE;
    let series =
        ((((u * (1.0 / 720.0) + 1.0 / 120.0) * u + 1.0 / 24.0) * u + 1.0 / 6.0) * u + 0.5) * u * u + u + Vec4::ONE;
    let square = series * series;
    let fourth = square * square;
    fourth * fourth
}

#[cfg(test)]
#[test]
fn the_series_is_good_to_a_thousandth() {
    for step in 0..=100 {
        let x = step as f32 / 100.0;
        let (got, expected) = (exp2_of_negative(Vec4::splat(x)).y, (-9.28 * x).exp2());
        assert!((got / expected - 1.0).abs() < 1e-3, "{got} instead of {expected} at {x}");
    }
}
