//! Reflectance: Fresnel terms and interreflection.

use crate::simd::{polynomial, within};

/// Share of the ambient light that reaches a point, including light that bounces between surfaces of this albedo
/// (Jimenez, Wu, Pesce and Jarabo, "Practical Realtime Strategies for Accurate Indirect Occlusion", 2016); at least
/// `open`, the unoccluded share of the hemisphere (0-1).
#[inline(always)]
pub(crate) fn multibounce_ao(open: f32, albedo: f32) -> f32 {
    let cubic = albedo.mul_add(2.0404, -0.3324);
    let square = albedo.mul_add(-4.7951, 0.6417);
    let linear = albedo.mul_add(2.7552, 0.6903);
    let share = polynomial([cubic, square, linear, 0.0], open);
    if share > open { share } else { open }
}

/// Light that a cavity's walls reflect after at least one reflection off other walls, relative to the entering light: a
/// geometric series, as in an integrating sphere. `open` is the share of the hemisphere above a wall that the opening
/// fills (0-1).
#[inline(always)]
pub(crate) fn cavity_interreflection(albedo: f32, open: f32) -> f32 {
    let walls = 1.0 - open;
    albedo * albedo * open * walls / albedo.mul_add(-walls, 1.0)
}

/// Schlick's weight between the reflectance at normal incidence and 1.
#[inline(always)]
pub(crate) fn schlick_weight(cosine: f32) -> f32 {
    let x = 1.0 - within(cosine, 0.0, 1.0);
    let square = x * x;
    square * square * x
}

/// Scale and bias, so that `f0 * scale + bias` is the specular reflectance for ambient light (Karis, "Physically Based
/// Shading on Mobile", 2014). `roughness` is perceptual (0-1); `facing` is the cosine between normal and viewer.
#[inline(always)]
pub(crate) fn ambient_fresnel(roughness: f32, facing: f32) -> (f32, f32) {
    let smoothness = 1.0 - roughness;
    let limit = smoothness * smoothness;
    let power = exp2_of_negative(facing);
    let edge = (if limit < power { limit } else { power }).mul_add(smoothness, 0.0425 - 0.0275 * roughness);
    (edge.mul_add(-1.04, 1.04 - 0.572 * roughness), edge.mul_add(1.04, 0.022 * roughness - 0.04))
}

/// 2 to the power of `-9.28 x` for `x` in 0-1, with a relative error of 10⁻³: Taylor series of an eighth of the
/// exponent, squared three times.
#[inline(always)]
fn exp2_of_negative(x: f32) -> f32 {
    const RATE: f32 = -9.28 / 8.0 * std::f32::consts::LN_2;
    let u = x * RATE;
    let series = polynomial([1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0], u);
    let square = series * series;
    let fourth = square * square;
    fourth * fourth
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unoccluded points and black corners keep their share; white corners reflect nearly all light.
    #[test]
    fn bright_corners_are_brighter() {
        for (open, albedo, low, high) in
            [(1.0, 0.5, 0.99, 1.01), (0.4, 0.0, 0.4, 0.4), (0.4, 0.9, 0.7, 0.85), (0.2, 0.5, 0.2, 0.35)]
        {
            let got = multibounce_ao(open, albedo);
            assert!((low..=high).contains(&got), "{got} of a corner open to {open} with an albedo of {albedo}");
        }
    }

    /// A black or an open cavity interreflects nothing; a white one as much as the share that is not open.
    #[test]
    fn hollows_throw_back_what_their_walls_do_not_absorb() {
        for (albedo, open, expected) in [(0.0, 0.3, 0.0), (1.0, 0.2, 0.8), (0.5, 1.0, 0.0), (0.5, 0.2, 0.04 / 0.6)] {
            let got = cavity_interreflection(albedo, open);
            assert!((got - expected).abs() < 1e-6, "{got} with an albedo of {albedo}, open to {open}");
        }
    }

    #[test]
    fn the_series_is_good_to_a_thousandth() {
        for step in 0..=100 {
            let x = step as f32 / 100.0;
            let (got, expected) = (exp2_of_negative(x), (-9.28 * x).exp2());
            assert!((got / expected - 1.0).abs() < 1e-3, "{got} instead of {expected} at {x}");
        }
    }
}
