//! Noise of a camera from repeated images of a still scene.
//!
//! Differences of successive images hold noise alone, even while the light drifts. Colours: the variance of linear
//! light is a constant, from reading, plus a part in proportion to the light, from photons (photon transfer curve;
//! Janesick, 2007). Depth: the variance of the disparity is the same at every depth. Rounding to 8 bits, to steps of the
//! disparity and to steps of the depth file is subtracted (Sheppard's correction).

use genmanip_core::{ColorSensor, DepthSensor};
use genmanip_render::color::linear_from_srgb8;
use serde::Serialize;

/// Fewest images of a still scene.
pub const FEWEST_IMAGES: usize = 4;
/// Fewest pixels that are a measurement.
const FEWEST_PIXELS: usize = 1000;
/// Codes nearer to black or white than this are left out, since they may be clipped.
const CLIPPED: f64 = 10.0;
/// Side of a tile, pixels: noise of a stereo matcher is correlated over less.
const TILE: usize = 16;
/// Number of groups of tiles, of which every one is left out once (jackknife).
const GROUPS: usize = 16;
/// Quantile of Student's distribution with 15 degrees of freedom for a two-sided 95 % interval.
const T: f64 = 2.131;
/// Change of a pixel's disparity between images, in typical standard deviations, above which it lies on an edge.
const EDGE: f64 = 8.0;
/// Largest half-width of the interval of an identified figure, as a share of its value or of its typical size.
const WIDEST: f64 = 0.5;

/// Noise of a camera, in the keys of a world's `cameras[].sensor`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CameraNoise {
    /// Identified figures.
    pub estimates: Vec<NoiseEstimate>,
    /// Figures that the images do not determine.
    pub unidentified: Vec<UnseenNoise>,
}

/// One identified figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NoiseEstimate {
    /// Key of the sensor, such as `color.full_well_e`.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Value.
    pub value: f64,
    /// 95 % interval.
    pub interval: [f64; 2],
}

/// One figure that the images do not determine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UnseenNoise {
    /// Key of the sensor.
    pub name: &'static str,
    /// Reason, and images that would show it.
    pub reason: String,
}

/// Key of the full-well capacity.
pub const FULL_WELL: &str = "color.full_well_e";
/// Key of the read noise.
pub const READ_NOISE: &str = "color.read_noise_e";
/// Key of the disparity's noise.
pub const DISPARITY: &str = "depth.disparity_error_px";

impl CameraNoise {
    /// Identified value of a key.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.estimates.iter().find(|it| it.name == name).map(|it| it.value)
    }

    /// Colour sensor with the identified values.
    #[must_use]
    pub fn color(&self, own: ColorSensor) -> ColorSensor {
        ColorSensor {
            full_well_e: self.value(FULL_WELL).unwrap_or(own.full_well_e),
            read_noise_e: self.value(READ_NOISE).unwrap_or(own.read_noise_e),
            ..own
        }
    }

    /// Depth sensor with the identified values.
    #[must_use]
    pub fn depth(&self, own: DepthSensor) -> DepthSensor {
        DepthSensor { disparity_error_px: self.value(DISPARITY).unwrap_or(own.disparity_error_px), ..own }
    }

    fn add(&mut self, name: &'static str, unit: &'static str, [value, half]: [f64; 2], typical: f64, advice: &str) {
        if half <= WIDEST * value.max(typical) {
            let interval = [(value - half).max(0.0), value + half];
            self.estimates.push(NoiseEstimate { name, unit, value, interval });
        } else {
            self.unseen(name, format!("known to ± {half:.2} {unit} only; {advice}"));
        }
    }

    fn unseen(&mut self, name: &'static str, reason: String) {
        self.unidentified.push(UnseenNoise { name, reason });
    }

    /// Adds the noise of 8-bit sRGB images of one width, row by row.
    pub fn add_color(&mut self, width: usize, images: &[Vec<u8>]) {
        let curve = Curve::of(width, images);
        let advice = "show bright and dark surfaces, in more images";
        let all = curve.line(GROUPS);
        let Some((slope, _)) = all.filter(|(slope, _)| *slope > 0.0) else {
            for name in [FULL_WELL, READ_NOISE] {
                self.unseen(name, format!("the noise does not grow with the light; {advice}"));
            }
            return;
        };
        let each: Vec<(f64, f64)> = (0..GROUPS).filter_map(|group| curve.line(group)).collect();
        self.add(FULL_WELL, "e", jackknife(1.0 / slope, each.iter().map(|(slope, _)| 1.0 / slope)), 0.0, advice);
        let read = |(slope, constant): (f64, f64)| constant / (slope * slope);
        let [square, half] = jackknife(all.map_or(0.0, read), each.into_iter().map(read));
        // The square may be negative by chance; the interval is that of the square.
        let value = square.max(0.0).sqrt();
        let half = ((square + half).max(0.0).sqrt() - value).max(value - (square - half).max(0.0).sqrt());
        self.add(READ_NOISE, "e", [value, half], 5.0, advice);
    }

    /// Adds the noise of depth images (m; 0 for no measurement) of one width, whose file rounds to a step (m).
    /// Focal length, baseline and disparity step are those of the sensor.
    pub fn add_depth(&mut self, width: usize, images: &[Vec<f32>], sensor: &DepthSensor, step_m: f64) {
        let disparity_m = sensor.focal_length_px * sensor.baseline_m.abs();
        // Group, variance, largest change, and variance of the rounding of each pixel.
        let mut pixels: Vec<(usize, [f64; 3])> = Vec::new();
        for index in 0..images.first().map_or(0, Vec::len) {
            let depth = images.iter().map(|image| f64::from(image[index]));
            let nearest = depth.clone().fold(f64::INFINITY, f64::min);
            if nearest <= 0.0 {
                continue;
            }
            let disparity: Vec<f64> = depth.map(|depth| disparity_m / depth).collect();
            let (low, high) = disparity.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), it| (a.min(*it), b.max(*it)));
            let rounding = step_m * disparity_m / (nearest * nearest);
            let steps = (sensor.disparity_step_px.powi(2) + rounding * rounding) / 12.0;
            pixels.push((group(index, width), [successive(&disparity), high - low, steps]));
        }
        let mut variances: Vec<f64> = pixels.iter().map(|(_, [variance, ..])| *variance).collect();
        variances.sort_by(f64::total_cmp);
        let typical = variances.get(variances.len() / 2).map_or(0.0, |variance| variance.sqrt());
        let mut sums = [[0.0; 2]; GROUPS];
        for (group, [variance, change, steps]) in pixels {
            if change <= EDGE * typical {
                sums[group][0] += variance - steps;
                sums[group][1] += 1.0;
            }
        }
        let all = sums.iter().fold([0.0; 2], |all, it| [all[0] + it[0], all[1] + it[1]]);
        if all[1] < FEWEST_PIXELS as f64 || all[0] <= 0.0 {
            let reason = match all[0] > 0.0 || all[1] == 0.0 {
                true => "too few pixels have a depth in every image; show a matt surface",
                false => "the noise is smaller than a step of the depth images",
            };
            return self.unseen(DISPARITY, reason.into());
        }
        let error = |[sum, count]: [f64; 2]| (sum / count).max(0.0).sqrt();
        let each = sums.iter().map(|it| error([all[0] - it[0], all[1] - it[1]]));
        self.add(DISPARITY, "px", jackknife(error(all), each), 0.0, "take more images");
    }
}

/// Half the mean square of successive differences: the variance of independent noise (von Neumann, 1941).
fn successive(values: &[f64]) -> f64 {
    let squares = values.windows(2).map(|two| (two[1] - two[0]).powi(2)).sum::<f64>();
    squares / (2.0 * values.len().saturating_sub(1).max(1) as f64)
}

/// Group of the tile of a pixel.
fn group(index: usize, width: usize) -> usize {
    let (column, row) = (index % width / TILE, index / width / TILE);
    // Neighbours belong to different groups, and no group is a column of the image.
    (column + 7 * row) % GROUPS
}

/// A value with the half-width of its 95 % interval, from values without one group each.
fn jackknife(value: f64, without: impl Iterator<Item = f64>) -> [f64; 2] {
    let each: Vec<f64> = without.collect();
    let count = each.len().max(1) as f64;
    let mean = each.iter().sum::<f64>() / count;
    let variance = each.iter().map(|it| (it - mean).powi(2)).sum::<f64>() * (count - 1.0) / count;
    [value, if each.len() < GROUPS { f64::INFINITY } else { T * variance.sqrt() }]
}

/// Variance of linear light against the light, by code and group of tiles.
struct Curve(Vec<[Bin; GROUPS]>);

/// Sums over pixels: their number, light, and variance.
type Bin = [f64; 3];

impl Curve {
    fn of(width: usize, images: &[Vec<u8>]) -> Self {
        let light: Vec<f64> = (0..=255_u8).map(|code| f64::from(linear_from_srgb8([code; 3]).x)).collect();
        let mut bins = vec![[[0.0; 3]; GROUPS]; 256];
        for index in 0..images.first().map_or(0, Vec::len) {
            let codes: Vec<u8> = images.iter().map(|image| image[index]).collect();
            let mean = codes.iter().map(|code| f64::from(*code)).sum::<f64>() / codes.len() as f64;
            if !(CLIPPED..=255.0 - CLIPPED).contains(&mean) {
                continue;
            }
            let values: Vec<f64> = codes.iter().map(|code| light[usize::from(*code)]).collect();
            let code = mean.round() as usize;
            let step = 0.5 * (light[code + 1] - light[code - 1]);
            let bin = &mut bins[code][group(index / 3, width)];
            bin[0] += 1.0;
            bin[1] += values.iter().sum::<f64>() / values.len() as f64;
            bin[2] += successive(&values) - step * step / 12.0;
        }
        Self(bins)
    }

    /// Slope and constant of the variance against the light without one group; `None` without a range of light.
    fn line(&self, without: usize) -> Option<(f64, f64)> {
        let bins: Vec<Bin> = self
            .0
            .iter()
            .map(|groups| {
                let kept = groups.iter().enumerate().filter(|(group, _)| *group != without);
                kept.fold([0.0; 3], |sum, (_, it)| [sum[0] + it[0], sum[1] + it[1], sum[2] + it[2]])
            })
            .filter(|bin| bin[0] > 0.0)
            .map(|[count, light, variance]| [count, light / count, variance / count])
            .collect();
        if bins.iter().map(|bin| bin[0]).sum::<f64>() < FEWEST_PIXELS as f64 {
            return None;
        }
        // A variance is known to a share of itself: first that of a proportion to the light, then that of the line.
        let mut expected: Vec<f64> = bins.iter().map(|bin| bin[1]).collect();
        let mut line = None;
        for _ in 0..3 {
            let mut sums = [0.0; 5];
            for ([count, light, variance], expected) in bins.iter().zip(&expected) {
                let weight = count / (expected * expected);
                let terms = [1.0, *light, light * light, *variance, light * variance];
                sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
            }
            let [n, x, xx, y, xy] = sums;
            let spread = n * xx - x * x;
            if spread <= 1e-9 * n * xx {
                return None;
            }
            let (slope, constant) = ((n * xy - x * y) / spread, (xx * y - x * xy) / spread);
            let least = 1e-3 * slope.abs().max(1e-9);
            expected = bins.iter().map(|bin| (slope * bin[1] + constant).max(least)).collect();
            line = Some((slope, constant));
        }
        line
    }
}
