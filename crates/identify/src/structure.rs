//! Test of the model's structure: residuals of the right model are white noise.

use serde::Serialize;

/// Number of moments per block: long enough that their mean is ten times as sensitive as a single residual to slow
/// errors, short enough for structure within one reversal.
const BLOCK: usize = 12;
/// Ratio of slow to fast residuals above which the structure counts as wrong, beyond chance and resolution. Chosen:
/// slow errors as large as the noise of one moment divided by three.
const RATIO: f64 = 2.0;

/// Residuals of one channel against white noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Whiteness {
    /// Standard deviation of the noise, from differences of successive residuals, rad or m.
    pub noise: f64,
    /// Standard deviation of all residuals, rad or m.
    pub residual: f64,
    /// Variance of the means over blocks of moments, times the length of a block, over the variance of the noise: 1 for
    /// white noise.
    pub slow_ratio: f64,
    /// True if the ratio is above what noise and resolution explain.
    pub is_structured: bool,
}

/// Whiteness of successive residuals, measured with a given resolution (step between two possible values).
pub fn whiteness(residuals: &[f64], resolution: f64) -> Whiteness {
    let count = residuals.len().max(2) as f64;
    let noise = noise(residuals);
    let square = residuals.iter().map(|it| it * it).sum::<f64>() / count;
    let blocks: Vec<f64> =
        residuals.chunks_exact(BLOCK).map(|block| block.iter().sum::<f64>() / BLOCK as f64).collect();
    let slow = blocks.iter().map(|mean| mean * mean).sum::<f64>() / blocks.len().max(1) as f64;
    // While a joint stands still, rounding is a constant error of up to half a step.
    let expected = noise * noise / BLOCK as f64 + resolution * resolution / 12.0;
    let slow_ratio = slow / (noise * noise / BLOCK as f64).max(f64::MIN_POSITIVE);
    // Relative standard deviation of a chi-square variable: four of them for chance.
    let chance = 1.0 + 4.0 * (2.0 / blocks.len().max(1) as f64).sqrt();
    Whiteness { noise, residual: square.sqrt(), slow_ratio, is_structured: slow > RATIO.max(chance) * expected }
}

/// Standard deviation of the noise of successive values, from their differences (von Neumann, 1941).
pub fn noise(values: &[f64]) -> f64 {
    let differences = values.windows(2).map(|two| (two[1] - two[0]).powi(2)).sum::<f64>();
    (differences / (2.0 * values.len().saturating_sub(1).max(1) as f64)).sqrt()
}

/// Smallest step between two values of a channel: the resolution of its sensor; 0 for fewer than two values.
pub fn resolution(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    // Rounding of decimal files is no resolution.
    let steps = sorted.windows(2).map(|two| two[1] - two[0]).filter(|step| *step > 1e-9);
    let smallest = steps.fold(f64::INFINITY, f64::min);
    if smallest.is_finite() { smallest } else { 0.0 }
}

/// Noise of each channel from the differences of its successive residuals.
pub fn noise_of(residuals: &[f64], channels: usize, least: f64) -> Vec<f64> {
    (0..channels).map(|channel| noise(&channel_of(residuals, channels, channel)).max(least)).collect()
}

/// Residuals of one channel.
pub fn channel_of(residuals: &[f64], channels: usize, channel: usize) -> Vec<f64> {
    residuals.iter().skip(channel).step_by(channels).copied().collect()
}
