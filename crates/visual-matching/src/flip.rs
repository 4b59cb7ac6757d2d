//! LDR-FLIP, a difference metric for alternating images (Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and
//! Fairchild, "FLIP: A Difference Evaluator for Alternating Images", 2020), implemented from the paper.
//!
//! Colours are filtered with the contrast sensitivity of the eye and compared in a perceptually uniform colour space.
//! Differences of edges and points then increase the result.

use glam::Vec3A;

use genmanip_render::color::linear_from_srgb8;

/// Pixels per degree of visual angle for the paper's observer: 0.7 m from a 0.7 m wide screen with 3840 pixels.
pub const PIXELS_PER_DEGREE: f32 = 0.7 * 3840.0 / 0.7 * (std::f32::consts::PI / 180.0);

/// Contrast sensitivity of the achromatic, red-green and blue-yellow channels as sums of Gaussians (table 1): height
/// and width.
const SENSITIVITY: [[(f32, f32); 2]; 3] =
    [[(1.0, 0.0047), (0.0, 1e-5)], [(1.0, 0.0053), (0.0, 1e-5)], [(34.1, 0.04), (13.5, 0.025)]];
/// Exponent of the colour difference. A difference of `SHARE_BEND` times the maximum is mapped to `VALUE_BEND`.
const COLOR_EXPONENT: f32 = 0.7;
const SHARE_BEND: f32 = 0.4;
const VALUE_BEND: f32 = 0.95;
/// Width of detected features, degrees of visual angle, and exponent of the feature difference.
const FEATURE_DEGREES: f32 = 0.082;
const FEATURE_EXPONENT: f32 = 0.5;
/// White point D65 in CIE XYZ.
pub(crate) const WHITE: Vec3A = Vec3A::new(0.950_428_5, 1.0, 1.088_900_3);

/// Difference per pixel, 0 to 1, between two 8-bit sRGB images with `width` pixels per row; `None` if their sizes
/// differ or are not whole rows.
pub fn flip(reference: &[u8], test: &[u8], width: usize, pixels_per_degree: f32) -> Option<Vec<f32>> {
    if reference.len() != test.len() || width == 0 || reference.is_empty() || !reference.len().is_multiple_of(width * 3)
    {
        return None;
    }
    let [reference, test] = [reference, test].map(|rgb| RgbImage::new(rgb, width));
    let [seen, tested] = [&reference, &test].map(|picture| picture.perceived(pixels_per_degree));
    let [features, tested_features] = [&reference, &test].map(|picture| picture.features(pixels_per_degree));
    let largest = distance(hunt(Vec3A::Y), hunt(Vec3A::Z)).powf(COLOR_EXPONENT);
    let colors = seen.iter().zip(&tested).map(|(a, b)| redistributed(distance(*a, *b).powf(COLOR_EXPONENT), largest));
    let features = features.iter().zip(&tested_features).map(|(a, b)| {
        let most = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
        (most * std::f32::consts::FRAC_1_SQRT_2).powf(FEATURE_EXPONENT)
    });
    Some(colors.zip(features).map(|(color, feature)| color.powf((1.0 - feature).max(0.0))).collect())
}

/// Mean of [`flip`] over all pixels for the paper's observer.
pub fn mean_flip(reference: &[u8], test: &[u8], width: usize) -> Option<f64> {
    let differences = flip(reference, test, width, PIXELS_PER_DEGREE)?;
    Some(differences.iter().map(|&value| f64::from(value)).sum::<f64>() / differences.len() as f64)
}

/// An image in the opponent colour space YCxCz.
struct RgbImage {
    width: usize,
    /// Achromatic, red-green and blue-yellow planes.
    channels: [Vec<f32>; 3],
}

impl RgbImage {
    fn new(rgb: &[u8], width: usize) -> Self {
        let mut channels: [Vec<f32>; 3] = std::array::from_fn(|_| Vec::with_capacity(rgb.len() / 3));
        for pixel in rgb.chunks_exact(3) {
            let xyz = xyz_from_linear(linear_from_srgb8([pixel[0], pixel[1], pixel[2]])) / WHITE;
            let opponent = [116.0 * xyz.y - 16.0, 500.0 * (xyz.x - xyz.y), 200.0 * (xyz.y - xyz.z)];
            channels.iter_mut().zip(opponent).for_each(|(channel, value)| channel.push(value));
        }
        Self { width, channels }
    }

    /// The image filtered with the contrast sensitivity function, in L*a*b* with the Hunt effect.
    fn perceived(&self, pixels_per_degree: f32) -> Vec<Vec3A> {
        let widest = SENSITIVITY.iter().flatten().fold(0.0_f32, |widest, (_, width)| widest.max(*width));
        let deviation = (widest / (2.0 * std::f32::consts::PI.powi(2))).sqrt();
        let radius = (3.0 * deviation * pixels_per_degree).ceil() as isize;
        let blurred: Vec<Vec<f32>> = SENSITIVITY
            .iter()
            .zip(&self.channels)
            .map(|(gaussians, channel)| {
                // The sum of two-dimensional Gaussians is not separable, but each one is: they are applied separately
                // and added with their weights.
                let mut sum = vec![0.0; channel.len()];
                let kernels: Vec<_> = gaussians
                    .iter()
                    .filter(|(height, _)| *height > 0.0)
                    .map(|&(height, width)| {
                        let at = |x: isize| {
                            let degrees = x as f32 / pixels_per_degree;
                            (-(std::f32::consts::PI * degrees).powi(2) / width).exp()
                        };
                        let kernel: Vec<f32> = (-radius..=radius).map(at).collect();
                        let total: f32 = kernel.iter().sum();
                        let weight = height * (std::f32::consts::PI / width).sqrt() * total * total;
                        (kernel.iter().map(|value| value / total).collect::<Vec<f32>>(), weight)
                    })
                    .collect();
                let whole: f32 = kernels.iter().map(|(_, weight)| weight).sum();
                for (kernel, weight) in kernels {
                    let part = filtered(channel, self.width, &kernel, &kernel);
                    sum.iter_mut().zip(part).for_each(|(sum, value)| *sum += value * weight / whole);
                }
                sum
            })
            .collect();
        (0..blurred[0].len())
            .map(|pixel| {
                let y = (blurred[0][pixel] + 16.0) / 116.0;
                let xyz = Vec3A::new(y + blurred[1][pixel] / 500.0, y, y - blurred[2][pixel] / 200.0) * WHITE;
                hunt(linear_from_xyz(xyz).clamp(Vec3A::ZERO, Vec3A::ONE))
            })
            .collect()
    }

    /// Edge and point strength of the achromatic channel per pixel.
    fn features(&self, pixels_per_degree: f32) -> Vec<[f32; 2]> {
        let brightness: Vec<f32> = self.channels[0].iter().map(|value| (value + 16.0) / 116.0).collect();
        let deviation = 0.5 * FEATURE_DEGREES * pixels_per_degree;
        let radius = (3.0 * deviation).ceil() as isize;
        let bell = |x: f32| (-x * x / (2.0 * deviation * deviation)).exp();
        let kernel = |shape: &dyn Fn(f32) -> f32| -> Vec<f32> {
            let values: Vec<f32> = (-radius..=radius).map(|x| shape(x as f32)).collect();
            let (up, down) = values
                .iter()
                .fold((0.0, 0.0), |(up, down): (f32, f32), &value| (up + value.max(0.0), down - value.min(0.0)));
            values.iter().map(|value| if *value > 0.0 { value / up } else { value / down.max(1e-12) }).collect()
        };
        let across = kernel(&bell);
        let shapes = [kernel(&|x| -x * bell(x)), kernel(&|x| (x * x / (deviation * deviation) - 1.0) * bell(x))];
        let [edges, points] = shapes.map(|along| {
            let horizontal = filtered(&brightness, self.width, &along, &across);
            let vertical = filtered(&brightness, self.width, &across, &along);
            horizontal.iter().zip(&vertical).map(|(x, y)| x.hypot(*y)).collect::<Vec<f32>>()
        });
        edges.into_iter().zip(points).map(|(edge, point)| [edge, point]).collect()
    }
}

/// Separable convolution with kernels of odd length; the border pixel is repeated.
fn filtered(values: &[f32], width: usize, across: &[f32], down: &[f32]) -> Vec<f32> {
    let height = values.len() / width;
    let cut = |place: isize, limit: usize| place.clamp(0, limit as isize - 1) as usize;
    let by_rows: Vec<f32> = values
        .chunks_exact(width)
        .flat_map(|line| {
            let radius = (across.len() / 2) as isize;
            (0..width as isize).map(move |column| {
                let taps = across.iter().zip(column - radius..);
                taps.map(|(weight, column)| weight * line[cut(column, width)]).sum()
            })
        })
        .collect();
    let radius = (down.len() / 2) as isize;
    let mut out = Vec::with_capacity(values.len());
    for row in 0..height as isize {
        let mut sums = vec![0.0; width];
        for (weight, row) in down.iter().zip(row - radius..) {
            let line = &by_rows[cut(row, height) * width..][..width];
            sums.iter_mut().zip(line).for_each(|(sum, value)| *sum += weight * value);
        }
        out.extend(sums);
    }
    out
}

/// HyAB colour distance (Abasi et al., 2020).
fn distance(a: Vec3A, b: Vec3A) -> f32 {
    let step = a - b;
    step.x.abs() + step.y.hypot(step.z)
}

/// Nonlinear map that gives small differences most of the scale from 0 to 1.
fn redistributed(difference: f32, largest: f32) -> f32 {
    let bend = SHARE_BEND * largest;
    if difference < bend {
        difference * VALUE_BEND / bend
    } else {
        VALUE_BEND + (difference - bend) / (largest - bend) * (1.0 - VALUE_BEND)
    }
}

/// L*a*b* of a linear sRGB colour, with chroma scaled by lightness (Hunt effect).
fn hunt(linear: Vec3A) -> Vec3A {
    const KNEE: f32 = 6.0 / 29.0;
    let curve = |value: f32| {
        if value > KNEE.powi(3) { value.cbrt() } else { value / (3.0 * KNEE * KNEE) + 4.0 / 29.0 }
    };
    let [x, y, z] = (xyz_from_linear(linear) / WHITE).to_array().map(curve);
    let brightness = 116.0 * y - 16.0;
    Vec3A::new(brightness, 500.0 * (x - y) * brightness * 0.01, 200.0 * (y - z) * brightness * 0.01)
}

/// XYZ from linear sRGB, IEC 61966-2-1.
const XYZ_FROM_LINEAR: glam::Mat3A = glam::Mat3A::from_cols(
    Vec3A::new(0.412_390_8, 0.212_639, 0.019_330_8),
    Vec3A::new(0.357_584_3, 0.715_168_7, 0.119_194_8),
    Vec3A::new(0.180_480_8, 0.072_192_3, 0.950_532_2),
);

pub(crate) fn xyz_from_linear(linear: Vec3A) -> Vec3A {
    XYZ_FROM_LINEAR * linear
}

fn linear_from_xyz(xyz: Vec3A) -> Vec3A {
    XYZ_FROM_LINEAR.inverse() * xyz
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(rgb: [u8; 3]) -> Vec<u8> {
        rgb.repeat(40 * 30)
    }

    fn mean(reference: &[u8], test: &[u8]) -> f64 {
        mean_flip(reference, test, 40).expect("whole rows of equal pictures")
    }

    /// The paper's formulas for uniform colours, where neither filter nor features matter.
    #[test]
    fn even_colors_differ_as_the_paper_says() {
        // (reference, test, expected): the largest difference is green to blue; black to white is HyAB 100 of 203.2.
        let black_white = {
            let (largest, own) = (203.2_f64.powf(0.7), 100_f64.powf(0.7));
            0.95 + (own - 0.4 * largest) / (0.6 * largest) * 0.05
        };
        for (reference, test, expected) in [
            ([0, 255, 0], [0, 0, 255], 1.0),
            ([0, 0, 0], [255, 255, 255], black_white),
            ([120, 80, 30], [120, 80, 30], 0.0),
        ] {
            let got = mean(&flat(reference), &flat(test));
            assert!((got - expected).abs() < 2e-3, "{reference:?} to {test:?}: {got}, expected {expected}");
        }
    }

    #[test]
    fn a_new_edge_counts_more_than_the_same_change_of_brightness() {
        let even = flat([120; 3]);
        let brighter = flat([130; 3]);
        let striped: Vec<u8> =
            (0..1200).flat_map(|pixel| if pixel % 40 / 4 % 2 == 0 { [110; 3] } else { [130; 3] }).collect();
        assert!(mean(&even, &striped) > mean(&even, &brighter));
        assert!((mean(&even, &striped) - mean(&striped, &even)).abs() < 1e-6, "either may be the reference");
    }

    #[test]
    fn pictures_of_other_sizes_have_no_difference() {
        assert_eq!(mean_flip(&flat([0; 3]), &[0; 3], 40), None);
        assert_eq!(mean_flip(&[0; 3], &[0; 3], 0), None);
        assert_eq!(mean_flip(&[0; 9], &[0; 9], 2), None);
    }
}
