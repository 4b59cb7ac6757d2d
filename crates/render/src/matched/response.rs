//! Camera response from radiance to display-linear colours.

use genmanip_core::CameraResponse;
use glam::{DMat3, DVec3, Mat3A, Vec3A};

use crate::scene::texture::linear_from_srgb8;

/// Intervals of the tabulated tone curve, over the square root of the value. Errors stay below a tenth of an 8-bit step.
const STEPS: usize = 2048;

/// A [`CameraResponse`] prepared for images.
#[derive(Debug)]
pub struct Response {
    given: CameraResponse,
    /// From radiance to values before the tone curve.
    linear: Mat3A,
    /// The largest value before the tone curve, and the display value at each step up to it.
    white: f32,
    curve: Vec<f32>,
}

impl Response {
    /// Prepared response; `None` if its tone curve does not rise or its matrix is not invertible.
    pub fn new(given: &CameraResponse) -> Option<Self> {
        let tone = given.tone()?;
        let matrix = DMat3::from_cols_array_2d(&given.matrix).transpose();
        if matrix.determinant().abs() < 1e-6 {
            return None;
        }
        let linear = (matrix * DMat3::from_diagonal(DVec3::from_array(given.gains()))).as_mat3();
        let at = |step: usize| tone.display((step as f64 / STEPS as f64).powi(2) * given.white) as f32;
        let curve = (0..=STEPS).map(at).collect();
        Some(Self { given: given.clone(), linear: linear.into(), white: given.white as f32, curve })
    }

    /// Display-linear colour, 0-1, of a radiance (linear RGB).
    #[inline]
    pub fn display(&self, radiance: Vec3A) -> Vec3A {
        let value = (self.linear * radiance / self.white).clamp(Vec3A::ZERO, Vec3A::ONE);
        let toned = value.to_array().map(|value| {
            let place = value.sqrt() * STEPS as f32;
            let step = (place as usize).min(STEPS - 1);
            let (low, high) = (self.curve[step], self.curve[step + 1]);
            low + (high - low) * (place - step as f32)
        });
        Vec3A::from_array(toned)
    }

    /// Radiance of the pixels of an 8-bit sRGB image; what was clipped gives the radiance at which clipping begins.
    pub fn radiance(&self, rgb: &[u8]) -> Vec<Vec3A> {
        let tone = self.given.tone();
        let back = glam::Mat3::from(self.linear).as_dmat3().inverse();
        let scene = |linear: Vec3A| linear.as_dvec3().to_array().map(|it| tone.map_or(it, |tone| tone.scene(it)));
        let radiance = |pixel: &[u8]| {
            let scene = DVec3::from_array(scene(linear_from_srgb8([pixel[0], pixel[1], pixel[2]])));
            (back * scene).max(DVec3::ZERO).as_vec3a()
        };
        rgb.chunks_exact(3).map(radiance).collect()
    }
}
