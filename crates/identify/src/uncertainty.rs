//! Uncertainty of a least-squares solution: intervals, and directions that the recordings do not show.

use genmanip_real::linear::Square;

use crate::problem::{Evaluation, PRIOR_SD};

/// Quantile of the normal distribution for a two-sided 95 % interval.
pub const Z: f64 = 1.959_963_984_540_054;
/// Largest half-width of the 95 % interval of an identified parameter, as a share of its value or, if that is smaller,
/// of its typical size. Chosen: a wider interval does not improve on the robot's own value.
pub const WIDEST: f64 = 0.5;
/// Share of a flat direction above which a parameter takes part in it.
const PART: f64 = 0.05;

/// Uncertainty of all unknowns, in typical sizes.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// Standard deviation of each unknown.
    pub sd: Vec<f64>,
    /// Ratio of the largest to the smallest singular value of the Jacobian, in typical sizes and units of the noise;
    /// infinite if an unknown changes nothing.
    pub condition_number: f64,
    /// Directions that the recordings do not show: indices of the unknowns that take part, and standard deviation.
    pub flat: Vec<(Vec<usize>, f64)>,
}

impl Uncertainty {
    /// Uncertainty at a solution with channels of given noise.
    ///
    /// The variance of an unknown is the larger of two estimates: that of independent noise, and that of residuals whose
    /// correlation over time is estimated from themselves (sandwich with the kernel of Newey and West, 1987).
    pub fn of(evaluation: &Evaluation, noise: &[f64], point: &[f64]) -> Option<Self> {
        let count = point.len();
        let mut data = evaluation.normal.hessian.clone();
        (0..count).for_each(|index| data.add(index, index, -PRIOR_SD.powi(-2)));
        let inverse = evaluation.normal.hessian.cholesky()?.inverse_block(count);
        let sandwich = sandwich(evaluation, noise, &inverse);
        let sd = (0..count).map(|index| inverse.get(index, index).max(sandwich.get(index, index)).sqrt()).collect();
        let pairs = data.eigen();
        let largest = pairs.last().map_or(0.0, |pair| pair.0);
        let smallest = pairs.first().map_or(0.0, |pair| pair.0);
        let condition_number = if smallest > 1e-12 * largest { (largest / smallest).sqrt() } else { f64::INFINITY };
        let flat = pairs.iter().filter_map(|(value, vector)| {
            let sd = (value.max(0.0) + PRIOR_SD.powi(-2)).powf(-0.5);
            let members: Vec<usize> = (0..count).filter(|&index| vector[index].powi(2) > PART).collect();
            let widest = members.iter().map(|&index| WIDEST * point[index].abs().max(1.0)).fold(0.0, f64::max);
            (Z * sd > widest).then_some((members, sd))
        });
        let flat = flat.collect();
        Some(Self { sd, condition_number, flat })
    }
}

/// Covariance of the unknowns from the residuals, whose correlation over up to `(4 n / 100)^(2/9)` moments counts.
fn sandwich(evaluation: &Evaluation, noise: &[f64], inverse: &Square) -> Square {
    let (count, channels) = (inverse.size(), noise.len());
    let moments = evaluation.residuals.len() / channels.max(1);
    // Score of a moment: sum over the channels of derivative times residual over variance.
    let score = |moment: usize| -> Vec<f64> {
        let of = |column: &Vec<f64>| {
            let rows = moment * channels..(moment + 1) * channels;
            let terms = rows
                .filter(|_| !column.is_empty())
                .map(|row| column[row] * evaluation.residuals[row] / noise[row % channels].powi(2));
            terms.sum()
        };
        evaluation.columns.iter().map(of).collect()
    };
    let scores: Vec<Vec<f64>> = (0..moments).map(score).collect();
    let lags = ((4.0 * (moments as f64 / 100.0).powf(2.0 / 9.0)).floor() as usize).max(1);
    let mut meat = Square::zero(count);
    for lag in 0..=lags {
        let weight = 1.0 - lag as f64 / (lags + 1) as f64;
        for moment in lag..moments {
            let (now, before) = (&scores[moment], &scores[moment - lag]);
            for i in 0..count {
                for j in 0..count {
                    let both = if lag == 0 { now[i] * now[j] } else { now[i] * before[j] + before[i] * now[j] };
                    meat.add(i, j, weight * both);
                }
            }
        }
    }
    let mut covariance = Square::zero(count);
    let product = |a: &dyn Fn(usize, usize) -> f64, b: &dyn Fn(usize, usize) -> f64, i: usize, j: usize| {
        (0..count).map(|k| a(i, k) * b(k, j)).sum::<f64>()
    };
    let mut half = Square::zero(count);
    for i in 0..count {
        for j in 0..count {
            half.add(i, j, product(&|i, k| inverse.get(i, k), &|k, j| meat.get(k, j), i, j));
        }
    }
    for i in 0..count {
        for j in 0..count {
            covariance.add(i, j, product(&|i, k| half.get(i, k), &|k, j| inverse.get(k, j), i, j));
        }
    }
    covariance
}
