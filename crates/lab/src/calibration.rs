//! Calibration of scores as success probabilities.

use serde::Serialize;

/// Reliability of predicted probabilities: a grasp with score p should hold in a share p of the trials.
#[derive(Serialize)]
pub struct Calibration {
    /// Brier score: mean squared difference of score and outcome (0 or 1); lower is better.
    pub brier: f64,
    /// Brier score of always predicting the base rate, for comparison; the base rate is not known in advance.
    pub brier_of_base_rate: f64,
    /// Equal-width bins of the score; empty ones are omitted.
    pub bins: Vec<Bin>,
}

/// Grasps whose score lies in one bin.
#[derive(Serialize, Default)]
pub struct Bin {
    /// Lower end of the bin; all bins have equal width.
    pub from: f64,
    /// Number of grasps in the bin.
    pub count: usize,
    /// Mean score of these grasps.
    pub mean_score: f64,
    /// Share of these grasps that held, 0 to 1.
    pub held: f64,
}

impl Calibration {
    /// Calibration of pairs of score (0 to 1) and outcome, in `bin_count` bins.
    pub fn of(outcomes: &[(f64, bool)], bin_count: usize) -> Self {
        let outcomes: Vec<(f64, f64)> =
            outcomes.iter().map(|&(score, held)| (score, f64::from(u8::from(held)))).collect();
        let count = outcomes.len().max(1) as f64;
        let base = outcomes.iter().map(|(_, held)| held).sum::<f64>() / count;
        let brier = |score: &dyn Fn(f64) -> f64| {
            outcomes.iter().map(|&(p, held)| (score(p) - held).powi(2)).sum::<f64>() / count
        };
        let mut bins: Vec<Bin> =
            (0..bin_count).map(|bin| Bin { from: bin as f64 / bin_count as f64, ..Bin::default() }).collect();
        for &(score, held) in &outcomes {
            let bin = &mut bins[((score * bin_count as f64) as usize).min(bin_count - 1)];
            bin.count += 1;
            bin.mean_score += score;
            bin.held += held;
        }
        bins.retain(|bin| bin.count > 0);
        for bin in &mut bins {
            bin.mean_score /= bin.count as f64;
            bin.held /= bin.count as f64;
        }
        Self { brier: brier(&|p| p), brier_of_base_rate: brier(&|_| base), bins }
    }
}
