//! How a lens bends a picture: the model of Brown and Conrady in the order and signs of OpenCV.

use glam::{DMat2, DVec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Intrinsics;

/// Steps of Newton's method; from the distorted point itself, lenses that people use need three or four.
const STEPS: usize = 20;
/// Points along each edge of a picture that are tried before it is believed that the lens shows all of it.
const TRIED: u32 = 33;
/// How many times as wide or high as the picture the pinhole picture behind it may be.
const WIDEST: f64 = 2.0;

/// Radial (`k1`, `k2`, `k3`) and tangential (`p1`, `p2`) coefficients, on the image plane at a distance of 1.
///
/// With r² = x² + y²: x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and y' the same way with p1 and p2
/// exchanged. Pixels are then fx x' + cx and fy y' + cy. A barrel has a negative `k1`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Distortion {
    /// Of r².
    pub k1: f64,
    /// Of r⁴.
    pub k2: f64,
    /// Of x y in x', of r² + 2 y² in y'.
    pub p1: f64,
    /// Of r² + 2 x² in x', of x y in y'.
    pub p2: f64,
    /// Of r⁶.
    #[serde(default)]
    pub k3: f64,
}

impl Distortion {
    /// Where the lens shows what a pinhole shows at a point of the image plane (x / z, y / z in the camera's frame).
    pub fn distort(&self, pinhole: DVec2) -> DVec2 {
        let DVec2 { x, y } = pinhole;
        let r2 = pinhole.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let cross = 2.0 * x * y;
        pinhole * radial
            + DVec2::new(self.p1 * cross + self.p2 * (r2 + 2.0 * x * x), self.p1 * (r2 + 2.0 * y * y) + self.p2 * cross)
    }

    /// Where a pinhole shows what the lens shows at a point of the image plane; `None` beyond the point where the lens
    /// folds its picture over, so that no single point belongs there.
    ///
    /// ```
    /// use genmanip_core::{Distortion, glam::DVec2};
    /// let lens = Distortion { k1: -0.2, k2: 0.03, p1: 0.001, p2: -0.002, k3: 0.0 };
    /// let seen = DVec2::new(0.4, -0.3);
    /// assert!((lens.undistort(lens.distort(seen)).unwrap() - seen).length() < 1e-12);
    /// ```
    pub fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        let mut pinhole = distorted;
        for _ in 0..STEPS {
            let slope = self.slope(pinhole);
            // The picture is upright as long as both axes and the area keep their signs.
            let is_upright = slope.determinant() > 0.0 && slope.x_axis.x > 0.0 && slope.y_axis.y > 0.0;
            if !is_upright {
                return None;
            }
            let miss = self.distort(pinhole) - distorted;
            pinhole -= slope.inverse() * miss;
            if miss.length_squared() < 1e-26 {
                break;
            }
        }
        ((self.distort(pinhole) - distorted).length_squared() < 1e-20).then_some(pinhole)
    }

    /// The pinhole picture that holds all that a lens shows in a picture: of the same focal lengths, with more pixels
    /// around it, by whole numbers. `None` when the lens folds the picture over, or stretches an edge more than twice.
    pub fn pinhole(&self, picture: &Intrinsics) -> Option<Intrinsics> {
        let Intrinsics { width, height, fx, fy, cx, cy } = *picture;
        let (right, bottom) = (f64::from(width) - 1.0, f64::from(height) - 1.0);
        let (mut low, mut high) = (DVec2::ZERO, DVec2::new(right, bottom));
        for step in 0..TRIED {
            let share = f64::from(step) / f64::from(TRIED - 1);
            let (x, y) = (share * right, share * bottom);
            for at in [DVec2::new(x, 0.0), DVec2::new(x, bottom), DVec2::new(0.0, y), DVec2::new(right, y)] {
                let pinhole = self.undistort(DVec2::new((at.x - cx) / fx, (at.y - cy) / fy))?;
                let pixel = pinhole * DVec2::new(fx, fy) + DVec2::new(cx, cy);
                (low, high) = (low.min(pixel), high.max(pixel));
            }
        }
        // A pixel more on each side, which the look-up between pixels needs.
        let before = (-low).ceil() + 1.0;
        let after = (high - DVec2::new(right, bottom)).ceil() + 1.0;
        let size = DVec2::new(f64::from(width), f64::from(height));
        let all = size + before + after;
        let fits = all.is_finite() && all.cmple(size * WIDEST + 4.0).all();
        fits.then_some(Intrinsics {
            width: all.x as u32,
            height: all.y as u32,
            fx,
            fy,
            cx: cx + before.x,
            cy: cy + before.y,
        })
    }

    /// Derivative of [`Distortion::distort`].
    fn slope(&self, at: DVec2) -> DMat2 {
        let DVec2 { x, y } = at;
        let r2 = at.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        // Twice the derivative of the radial factor by r².
        let change = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3));
        let mixed = change * x * y + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        DMat2::from_cols(
            DVec2::new(radial + change * x * x + 2.0 * self.p1 * y + 6.0 * self.p2 * x, mixed),
            DVec2::new(mixed, radial + change * y * y + 6.0 * self.p1 * y + 2.0 * self.p2 * x),
        )
    }
}
