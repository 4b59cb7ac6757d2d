//! Metallic-roughness BSDF of the rasteriser, with importance sampling.

use glam::{Vec2, Vec3A};

use genmanip_render::color::luminance;

/// Opaque BSDF in a local frame whose z axis is the normal.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reflection {
    /// Diffuse albedo.
    pub albedo: Vec3A,
    /// Reflectance at normal incidence.
    pub f0: Vec3A,
    /// Squared perceptual roughness.
    pub alpha: f32,
}

impl Reflection {
    /// BSDF times cosine, and the probability density with which [`Reflection::sample`] samples `into`. Directions are
    /// unit vectors in the local frame: `out` to the viewer, `into` to the light.
    pub fn evaluate(&self, out: Vec3A, into: Vec3A) -> (Vec3A, f32) {
        if out.z <= 0.0 || into.z <= 0.0 {
            return (Vec3A::ZERO, 0.0);
        }
        let half = (out + into).normalize_or(Vec3A::Z);
        let square = self.alpha * self.alpha;
        let denominator = half.z * half.z * (square - 1.0) + 1.0;
        let distribution = square / (std::f32::consts::PI * denominator * denominator);
        // Hammon's approximation of the Smith term, as in the rasteriser.
        let smith = into.z * out.z * 2.0 * (1.0 - self.alpha) + (into.z + out.z) * self.alpha;
        let fresnel = self.fresnel(out.dot(half));
        let value = self.albedo / std::f32::consts::PI + fresnel * (distribution * 0.5 / smith.max(1e-6));
        let mirror_chance = self.mirror_chance(out.z);
        let mirror = distribution / (2.0 * (out.z + (square + (1.0 - square) * out.z * out.z).sqrt()));
        let diffuse = into.z / std::f32::consts::PI;
        (value * into.z, mirror_chance * mirror + (1.0 - mirror_chance) * diffuse)
    }

    /// Sampled direction to the light for the direction `out` to the viewer, from three uniform random numbers.
    /// Directions below the surface may occur; their contribution is zero.
    pub fn sample(&self, out: Vec3A, choice: f32, at: Vec2) -> Vec3A {
        if choice >= self.mirror_chance(out.z) {
            let radius = at.x.sqrt();
            return Vec3A::from((Vec2::from_angle(std::f32::consts::TAU * at.y) * radius).extend((1.0 - at.x).sqrt()));
        }
        // Sampling of visible normals (Dupuy and Benyoub, "Sampling Visible GGX Normals with Spherical Caps", 2023).
        let stretched = (out * Vec3A::new(self.alpha, self.alpha, 1.0)).normalize();
        let z = (1.0 - at.x) * (1.0 + stretched.z) - stretched.z;
        let flat = Vec2::from_angle(std::f32::consts::TAU * at.y) * (1.0 - z * z).max(0.0).sqrt();
        let cap = Vec3A::from(flat.extend(z)) + stretched;
        let half = (cap * Vec3A::new(self.alpha, self.alpha, 1.0)).normalize_or(Vec3A::Z);
        half * (2.0 * out.dot(half)) - out
    }

    fn fresnel(&self, cosine: f32) -> Vec3A {
        self.f0 + (1.0 - self.f0) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
    }

    /// Probability of sampling the specular lobe, from the cosine between normal and direction to the viewer.
    fn mirror_chance(&self, cosine: f32) -> f32 {
        let (mirror, diffuse) = (luminance(self.fresnel(cosine)), luminance(self.albedo));
        if diffuse <= 0.0 { 1.0 } else { (mirror / (mirror + diffuse)).clamp(0.1, 0.9) }
    }
}

/// Fresnel reflectance of a smooth interface for unpolarised light, from the cosine of the angle of incidence. `ratio`
/// is the index of refraction before the interface divided by that behind it.
pub(crate) fn dielectric(cosine: f32, ratio: f32) -> f32 {
    let behind = 1.0 - ratio * ratio * (1.0 - cosine * cosine);
    if behind <= 0.0 {
        return 1.0;
    }
    let behind = behind.sqrt();
    let along = (cosine - ratio * behind) / (cosine + ratio * behind);
    let across = (ratio * cosine - behind) / (ratio * cosine + behind);
    (along * along + across * across) * 0.5
}
