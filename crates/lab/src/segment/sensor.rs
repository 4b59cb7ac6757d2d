//! Depth noise of a stereo camera: disparity noise, quantised disparity, and missing pixels.

use genmanip_core::{RgbdImage, Seed};
use rand::RngExt;

/// Model of a stereo depth camera.
#[derive(Clone, Copy, Debug)]
pub struct StereoDepth {
    /// Distance of the two cameras, m.
    pub baseline_m: f64,
    /// RMS error of the disparity, px.
    pub disparity_error_px: f64,
    /// Quantisation step of the disparity, px.
    pub disparity_step_px: f64,
    /// Minimum cosine between surface normal and view ray; surfaces at more grazing angles have no depth.
    pub grazing_cosine: f64,
    /// Relative depth step to a neighbouring pixel above which a pixel may be missing or show the neighbour's depth.
    pub edge_step: f64,
}

/// Intel RealSense D435.
///
/// Baseline of the D400 datasheet (337029); 0.08 px from "Best-known methods for tuning Intel RealSense D400 depth
/// cameras" (RMS error = z² · subpixel / (focal length · baseline)), with the focal length of the image; disparity
/// steps
/// of 1/32 px as in the D4 vision processor. The limits of 80 degrees and of a 2 % step at edges are chosen by hand.
pub const D435: StereoDepth = StereoDepth {
    baseline_m: 0.05,
    disparity_error_px: 0.08,
    disparity_step_px: 1.0 / 32.0,
    grazing_cosine: 0.17,
    edge_step: 0.02,
};

impl StereoDepth {
    /// The image with the depth that this camera would measure, m; 0 for no measurement.
    pub fn measure(&self, image: &RgbdImage, seed: Seed) -> RgbdImage {
        let rng = &mut seed.fork("stereo depth").rng();
        let (width, height) = (image.width() as usize, image.height() as usize);
        let disparity_m = image.intrinsics.fx * self.baseline_m;
        let at = |x: usize, y: usize| f64::from(image.depth_m[y * width + x]);
        let mut depth_m = Vec::with_capacity(image.depth_m.len());
        for y in 0..height {
            for x in 0..width {
                // Always draw the same random numbers per pixel, so that the noise of a pixel does not depend on other
                // pixels.
                let (coin, neighbour) = (rng.random::<f64>(), rng.random_range(0..4_usize));
                let normal = gaussian(rng.random(), rng.random());
                let around = [
                    at(x.saturating_sub(1), y),
                    at((x + 1).min(width - 1), y),
                    at(x, y.saturating_sub(1)),
                    at(x, (y + 1).min(height - 1)),
                ];
                let mut true_m = at(x, y);
                let is_edge = around.iter().any(|other| (other - true_m).abs() > self.edge_step * true_m);
                if is_edge && coin < 0.5 {
                    // Half of the affected pixels are missing, the others show the depth of a neighbour.
                    true_m = if coin < 0.25 { 0.0 } else { around[neighbour] };
                } else if is_grazing(image, [x, y], around, self.grazing_cosine) {
                    true_m = 0.0;
                }
                if true_m <= 0.0 {
                    depth_m.push(0.0);
                    continue;
                }
                let disparity = disparity_m / true_m + self.disparity_error_px * normal;
                let stepped = (disparity / self.disparity_step_px).round() * self.disparity_step_px;
                depth_m.push(if stepped > 0.0 { (disparity_m / stepped) as f32 } else { 0.0 });
            }
        }
        RgbdImage { depth_m, ..image.clone() }
    }
}

/// True if the surface through the neighbouring pixels is at a grazing angle to the view ray. `around` are the depths
/// to
/// the left, right, above and below, m; false if one is missing.
fn is_grazing(image: &RgbdImage, [x, y]: [usize; 2], around: [f64; 4], least_cosine: f64) -> bool {
    use genmanip_core::glam::DVec2;
    let [left, right, above, below] = around;
    if [left, right, above, below].iter().any(|depth| *depth <= 0.0) {
        return false;
    }
    let point =
        |dx: f64, dy: f64, depth: f64| image.intrinsics.unproject(DVec2::new(x as f64 + dx, y as f64 + dy), depth);
    let across = point(1.0, 0.0, right) - point(-1.0, 0.0, left);
    let down = point(0.0, 1.0, below) - point(0.0, -1.0, above);
    let view = point(0.0, 0.0, 1.0).normalize();
    across.cross(down).normalize_or_zero().dot(view).abs() < least_cosine
}

/// Standard normal deviate from two uniform ones in [0, 1) (Box-Muller).
fn gaussian(one: f64, other: f64) -> f64 {
    (-2.0 * (1.0 - one).ln()).sqrt() * (std::f64::consts::TAU * other).cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_core::{Intrinsics, Pose};

    #[test]
    fn noise_grows_with_the_square_of_the_distance() {
        for distance_m in [0.8_f64, 2.0] {
            let intrinsics = Intrinsics::from_vertical_fov(200, 150, 0.6);
            let flat = RgbdImage::of_depth(intrinsics, Pose::IDENTITY, vec![distance_m as f32; 30_000]);
            let seen = D435.measure(&flat, Seed::new(1));
            assert_eq!(seen, D435.measure(&flat, Seed::new(1)), "the same seed gives the same noise");
            let errors = seen.depth_m.iter().map(|depth| f64::from(*depth) - distance_m);
            let rms = (errors.map(|error| error * error).sum::<f64>() / 30_000.0).sqrt();
            let expected = distance_m * distance_m * 0.08 / (intrinsics.fx * 0.05);
            assert!((rms / expected - 1.0).abs() < 0.1, "{rms} m at {distance_m} m, expected {expected}");
        }
    }

    #[test]
    fn depth_is_missing_beside_steps() {
        let intrinsics = Intrinsics::from_vertical_fov(100, 100, 0.6);
        let step = (0..10_000).map(|index| if index % 100 < 50 { 1.0 } else { 1.2 }).collect();
        let seen = D435.measure(&RgbdImage::of_depth(intrinsics, Pose::IDENTITY, step), Seed::new(2));
        let missing =
            |column: usize| seen.depth_m.iter().skip(column).step_by(100).filter(|depth| **depth == 0.0).count();
        assert_eq!((missing(20), missing(80)), (0, 0));
        assert!(missing(49) > 10 && missing(50) > 10);
    }
}
