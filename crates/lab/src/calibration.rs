//! How true scores are that mean chances.

use serde::Serialize;

/// Whether a grasp with score p holds in a share p of the cases.
#[derive(Serialize)]
pub struct Calibration {
    /// Mean squared difference of score and outcome.
    pub brier: f64,
    /// The same for the constant share of grasps that held, which nobody knows beforehand.
    pub brier_of_base_rate: f64,
    /// Equal intervals of the score; those without a grasp are left out.
    pub bins: Vec<Bin>,
}

/// Grasps whose scores are in an interval.
#[derive(Serialize, Default)]
pub struct Bin {
    /// Lower end of the interval.
    pub from: f64,
    /// Grasps.
    pub count: usize,
    /// Mean of their scores.
    pub mean_score: f64,
    /// Share that held.
    pub held: f64,
}

impl Calibration {
    /// Of scores with whether each grasp held, in so many bins.
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
