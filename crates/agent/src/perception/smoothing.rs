//! Edge-preserving smoothing of measured depth.

use genmanip_core::RgbdImage;

/// Filter radius (px), a window of 9 × 9. Errors of stereo cameras are correlated over about three pixels, so a window
/// holds nine independent ones, and their mean has a third of the error.
const RADIUS: usize = 4;
/// Maximum inverse-depth difference within one surface, in standard deviations of a single depth; that is about three
/// standard deviations of the difference.
const SAME_SURFACE: f32 = 4.5;
/// Standard deviation after smoothing divided by that before, on surfaces without edges.
pub const RESIDUAL_NOISE: f64 = 1.0 / 3.0;

/// Replaces each depth by the harmonic mean of the pixels within `RADIUS` that lie on the same surface. `error_m` is
/// the standard deviation (m) of one pixel's depth at 1 m; it grows with the square of the depth.
///
/// Inverse depth is averaged because it is linear in pixel coordinates on a plane. Missing depths stay missing.
#[must_use]
pub fn smoothed(image: &RgbdImage, error_m: f64) -> RgbdImage {
    let (width, height) = (image.width() as usize, image.height() as usize);
    if image.depth_m.len() != width * height {
        return image.clone();
    }
    let inverse: Vec<f32> =
        image.depth_m.iter().map(|&depth| if depth > 0.0 && depth.is_finite() { 1.0 / depth } else { 0.0 }).collect();
    // The noise of inverse depth is the same at all depths.
    let most = SAME_SURFACE * error_m as f32;
    let mean = |index: usize| {
        let own = inverse[index];
        if own <= 0.0 {
            return 0.0;
        }
        let (column, row) = (index % width, index / width);
        // The window is symmetric, also at the image's border: an asymmetric one would bias slanted surfaces.
        let reach = |at: usize, count: usize| RADIUS.min(at).min(count - 1 - at);
        let (across, along) = (reach(column, width), reach(row, height));
        let (mut sum, mut count) = (0.0, 0.0);
        for y in 0..=2 * along {
            for x in 0..=2 * across {
                let place = (row + y - along) * width + column + x - across;
                let mirrored = (row + along - y) * width + column + across - x;
                let is_same = |place: usize| inverse[place] > 0.0 && (inverse[place] - own).abs() <= most;
                // Average symmetric pairs: on a slanted plane each pair has the right mean.
                if is_same(place) && is_same(mirrored) {
                    sum += inverse[place];
                    count += 1.0;
                }
            }
        }
        count / sum
    };
    RgbdImage { depth_m: (0..inverse.len()).map(mean).collect(), ..image.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_core::{Intrinsics, Pose};

    /// An image with depth as a function of column and row.
    fn picture(depth: impl Fn(usize, usize) -> f32) -> RgbdImage {
        let (width, height) = (48, 32);
        RgbdImage {
            rgb: Vec::new(),
            depth_m: (0..width * height).map(|index| depth(index % width, index / width)).collect(),
            ids: Vec::new(),
            normals: Vec::new(),
            points_m: Vec::new(),
            intrinsics: Intrinsics::from_vertical_fov(width as u32, height as u32, 0.8),
            world_from_camera: Pose::IDENTITY,
            distortion: None,
        }
    }

    #[test]
    fn noise_goes_planes_and_edges_stay() {
        let noise = |x: usize, y: usize| ((x * 7919 + y * 104_729) % 97) as f32 / 97.0 - 0.5;
        // A tilted table with a step of 8 cm and a hole.
        let exact = |x: usize, y: usize| 1.0 / (1.0 + 0.004 * y as f32 + if x < 24 { 0.0 } else { 0.08 });
        let hole = |x: usize, y: usize| (10..12).contains(&x) && (10..12).contains(&y);
        let measured = picture(|x, y| if hole(x, y) { 0.0 } else { 1.0 / (1.0 / exact(x, y) + 0.01 * noise(x, y)) });
        let error_m = 0.01 / 12.0_f64.sqrt();
        let smooth = smoothed(&measured, error_m);
        let worst = |image: &RgbdImage| {
            let mut worst = 0.0_f32;
            for (index, depth) in image.depth_m.iter().enumerate() {
                let (x, y) = (index % 48, index / 48);
                if !hole(x, y) && (6..42).contains(&x) && (6..26).contains(&y) {
                    worst = worst.max((depth - exact(x, y)).abs());
                }
            }
            worst
        };
        assert!(worst(&smooth) < 0.5 * worst(&measured), "{} {}", worst(&smooth), worst(&measured));
        assert_eq!(smooth.depth_m[10 * 48 + 10], 0.0, "a hole stays one");
        let plane = picture(exact);
        let kept = smoothed(&plane, error_m);
        let moved = plane.depth_m.iter().zip(&kept.depth_m).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(moved < 1e-4, "planes and edges stay where they are: {moved}");
    }
}
