//! A coefficient of friction from the track of a block.
//!
//! Contacts make the simulated track a little erratic: a change of the coefficient by a millionth can shift the block by
//! a tenth of a millimetre. Derivatives are therefore slopes over a window, and the scatter about them counts as
//! uncertainty.

use crate::problem::Problem;
use crate::search::SearchSettings;
use crate::structure::{Whiteness, channel_of, noise_of, whiteness};

/// Half-widths of the windows about the best value so far, as shares of it.
const WINDOWS: [f64; 2] = [0.2, 0.06];
/// Number of values per window.
const POINTS: usize = 9;

/// Solution for a single coefficient, in typical sizes.
pub struct FrictionFit {
    /// Best value.
    pub value: f64,
    /// Standard deviation; infinite if the track does not depend on the coefficient.
    pub sd: f64,
    /// Residuals of each axis at the best simulated value.
    pub channels: Vec<Whiteness>,
    /// Root-mean-square residuals on the grid of starts, m.
    pub starts_rms: Vec<f64>,
}

/// Best coefficient; `None` when nothing can be simulated.
pub fn fit(problem: &Problem, settings: &SearchSettings) -> Option<FrictionFit> {
    let ([low, high], count) = settings.frictions;
    let scale = problem.unknowns.first()?.members.first()?.1;
    let grid = (0..count).map(|index| low * (high / low).powf(index as f64 / (count - 1).max(1) as f64) / scale);
    let rms =
        |residuals: &[f64]| (residuals.iter().map(|it| it * it).sum::<f64>() / residuals.len().max(1) as f64).sqrt();
    let starts: Vec<(f64, f64)> = grid.filter_map(|at| Some((rms(&problem.residuals(&[at])?), at))).collect();
    let (_, mut value) = starts.iter().copied().min_by(|a, b| a.0.total_cmp(&b.0))?;
    let mut window = None;
    for half_width in WINDOWS {
        let next = Window::of(problem, value, half_width * value, settings.least_noise)?;
        let [least, most] = problem.unknowns[0].bounds;
        value = next.value.clamp((value * (1.0 - half_width)).max(least), (value * (1.0 + half_width)).min(most));
        window = Some(next);
    }
    let Window { sd, residuals, scatter, .. } = window?;
    let channels = problem.channels();
    let whiteness = (0..channels).map(|axis| {
        // Scatter of the simulation widens what counts as noise, as a coarse resolution does.
        let coarse = problem.resolution(axis).hypot(12.0_f64.sqrt() * scatter);
        whiteness(&channel_of(&residuals, channels, axis), coarse)
    });
    let whiteness: Vec<Whiteness> = whiteness.collect();
    // A track that no coefficient explains to the noise says less than its scatter promises (Birge, 1932).
    let birge = whiteness.iter().map(|axis| axis.slow_ratio).fold(1.0, f64::max).sqrt();
    Some(FrictionFit {
        value,
        sd: sd * birge,
        channels: whiteness,
        starts_rms: starts.into_iter().map(|(rms, _)| rms).collect(),
    })
}

/// Straight lines through simulated tracks over a window of values.
struct Window {
    value: f64,
    sd: f64,
    /// Residuals of the best simulated track.
    residuals: Vec<f64>,
    /// Root-mean-square distance of the tracks from the lines, m.
    scatter: f64,
}

impl Window {
    fn of(problem: &Problem, center: f64, half_width: f64, least_noise: f64) -> Option<Self> {
        let offsets: Vec<f64> =
            (0..POINTS).map(|index| half_width * (2.0 * index as f64 / (POINTS - 1) as f64 - 1.0)).collect();
        let mut tracks = Vec::new();
        for offset in &offsets {
            tracks.push((*offset, problem.residuals(&[center + offset])?));
        }
        let square = |residuals: &[f64]| residuals.iter().map(|it| it * it).sum::<f64>();
        let best = tracks.iter().min_by(|a, b| square(&a.1).total_cmp(&square(&b.1)))?.1.clone();
        let noise = noise_of(&best, problem.channels(), least_noise);
        let weight = |row: usize| noise[row % noise.len()].powi(-2);
        let rows = best.len();
        let spread = offsets.iter().map(|offset| offset * offset).sum::<f64>();
        // Residual of a row: mean - slope · offset.
        let mean: Vec<f64> =
            (0..rows).map(|row| tracks.iter().map(|(_, it)| it[row]).sum::<f64>() / POINTS as f64).collect();
        let slope: Vec<f64> =
            (0..rows).map(|row| -tracks.iter().map(|(offset, it)| offset * it[row]).sum::<f64>() / spread).collect();
        let information: f64 = (0..rows).map(|row| weight(row) * slope[row] * slope[row]).sum();
        let onto = |residuals: &dyn Fn(usize) -> f64| {
            (0..rows).map(|row| weight(row) * slope[row] * residuals(row)).sum::<f64>() / information
        };
        if information <= 0.0 {
            return Some(Self { value: center, sd: f64::INFINITY, residuals: best, scatter: 0.0 });
        }
        let off = |offset: f64, it: &[f64], row: usize| it[row] - (mean[row] - slope[row] * offset);
        let shifts: Vec<f64> = tracks.iter().map(|(offset, it)| onto(&|row| off(*offset, it, row))).collect();
        // Two degrees of freedom went into mean and slope; the truth is one more simulation.
        let erratic = square(&shifts) / (POINTS - 2) as f64 * (1.0 + 1.0 / POINTS as f64);
        let scatter = tracks
            .iter()
            .map(|(offset, it)| (0..rows).map(|row| off(*offset, it, row).powi(2)).sum::<f64>())
            .sum::<f64>();
        Some(Self {
            value: center + onto(&|row| mean[row]),
            sd: (1.0 / information + erratic).sqrt(),
            residuals: best,
            scatter: (scatter / (rows * POINTS) as f64).sqrt(),
        })
    }
}
