//! Lens distortion: the Brown-Conrady model with OpenCV's coefficient order and signs.

use glam::{DMat2, DVec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Intrinsics;

/// Maximum number of Newton iterations; realistic lenses converge in three or four.
const MAX_ITERATIONS: usize = 20;
/// Number of samples along each image edge when testing that the whole image can be undistorted.
const EDGE_SAMPLES: u32 = 33;
/// Largest ratio of the undistorted image's width or height to the distorted image's.
const MAX_STRETCH: f64 = 2.0;

/// Radial (`k1`, `k2`, `k3`) and tangential (`p1`, `p2`) coefficients, on the image plane at a distance of 1.
///
/// With r² = x² + y²: x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and likewise y' with p1 and p2
/// exchanged. Pixels are fx x' + cx and fy y' + cy. Barrel distortion has a negative `k1`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Distortion {
    /// Coefficient of r².
    pub k1: f64,
    /// Coefficient of r⁴.
    pub k2: f64,
    /// Coefficient of 2 x y in x', of r² + 2 y² in y'.
    pub p1: f64,
    /// Coefficient of r² + 2 x² in x', of 2 x y in y'.
    pub p2: f64,
    /// Coefficient of r⁶.
    #[serde(default)]
    pub k3: f64,
}

impl Distortion {
    /// Distorts a point of the normalised image plane (x / z, y / z in the camera frame).
    pub fn distort(&self, pinhole: DVec2) -> DVec2 {
        let DVec2 { x, y } = pinhole;
        let r2 = pinhole.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let cross = 2.0 * x * y;
        pinhole * radial
            + DVec2::new(self.p1 * cross + self.p2 * (r2 + 2.0 * x * x), self.p1 * (r2 + 2.0 * y * y) + self.p2 * cross)
    }

    /// Inverse of [`Distortion::distort`]; `None` beyond the radius at which the distortion folds over and has no
    /// unique inverse.
    ///
    /// ```
    /// use genmanip_core::{Distortion, glam::DVec2};
    /// let lens = Distortion { k1: -0.2, k2: 0.03, p1: 0.001, p2: -0.002, k3: 0.0 };
    /// let seen = DVec2::new(0.4, -0.3);
    /// assert!((lens.undistort(lens.distort(seen)).unwrap() - seen).length() < 1e-12);
    /// ```
    pub fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        let mut pinhole = distorted;
        for _ in 0..MAX_ITERATIONS {
            let jacobian = self.jacobian(pinhole);
            // The mapping preserves orientation while both axes and the determinant stay positive.
            let is_upright = jacobian.determinant() > 0.0 && jacobian.x_axis.x > 0.0 && jacobian.y_axis.y > 0.0;
            if !is_upright {
                return None;
            }
            let miss = self.distort(pinhole) - distorted;
            pinhole -= jacobian.inverse() * miss;
            if miss.length_squared() < 1e-26 {
                break;
            }
        }
        ((self.distort(pinhole) - distorted).length_squared() < 1e-20).then_some(pinhole)
    }

    /// Intrinsics of the smallest pinhole image, with the same focal lengths and whole extra pixels on each side, that
    /// covers everything a distorted image shows. `None` if the lens folds over within the image or stretches an edge
    /// more than twofold.
    pub fn pinhole(&self, image: &Intrinsics) -> Option<Intrinsics> {
        let Intrinsics { width, height, fx, fy, cx, cy } = *image;
        let (right, bottom) = (f64::from(width) - 1.0, f64::from(height) - 1.0);
        let (mut low, mut high) = (DVec2::ZERO, DVec2::new(right, bottom));
        for step in 0..EDGE_SAMPLES {
            let share = f64::from(step) / f64::from(EDGE_SAMPLES - 1);
            let (x, y) = (share * right, share * bottom);
            for at in [DVec2::new(x, 0.0), DVec2::new(x, bottom), DVec2::new(0.0, y), DVec2::new(right, y)] {
                let pinhole = self.undistort(DVec2::new((at.x - cx) / fx, (at.y - cy) / fy))?;
                let pixel = pinhole * DVec2::new(fx, fy) + DVec2::new(cx, cy);
                (low, high) = (low.min(pixel), high.max(pixel));
            }
        }
        // One more pixel per side, for bilinear interpolation.
        let before = (-low).ceil() + 1.0;
        let after = (high - DVec2::new(right, bottom)).ceil() + 1.0;
        let size = DVec2::new(f64::from(width), f64::from(height));
        let all = size + before + after;
        let fits = all.is_finite() && all.cmple(size * MAX_STRETCH + 4.0).all();
        fits.then_some(Intrinsics {
            width: all.x as u32,
            height: all.y as u32,
            fx,
            fy,
            cx: cx + before.x,
            cy: cy + before.y,
        })
    }

    /// Jacobian of [`Distortion::distort`].
    fn jacobian(&self, at: DVec2) -> DMat2 {
        let DVec2 { x, y } = at;
        let r2 = at.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        // Twice the derivative of the radial factor with respect to r².
        let change = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3));
        let mixed = change * x * y + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        DMat2::from_cols(
            DVec2::new(radial + change * x * x + 2.0 * self.p1 * y + 6.0 * self.p2 * x, mixed),
            DVec2::new(mixed, radial + change * y * y + 6.0 * self.p1 * y + 2.0 * self.p2 * x),
        )
    }
}
