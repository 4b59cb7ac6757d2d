//! Rates and means with confidence intervals.

use genmanip_core::Seed;
use rand::RngExt;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

use super::StatisticsSettings;

/// A rate with its Wilson score interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Rate {
    /// Number of successes.
    pub successes: usize,
    /// Number of trials.
    pub trials: usize,
    /// Rate, 0 to 1; 0 without trials.
    pub value: f64,
    /// Lower end of the interval, 0 to 1.
    pub low: f64,
    /// Upper end of the interval, 0 to 1.
    pub high: f64,
}

impl Rate {
    /// Rate from counts; successes are clamped to the trials.
    ///
    /// ```
    /// use genmanip_benchmark::statistics::{Rate, StatisticsSettings};
    /// let rate = Rate::new(45, 48, &StatisticsSettings::default());
    /// assert_eq!(rate.to_string(), "93.8 % (95 % CI 83.2-97.9 %)");
    /// ```
    pub fn new(successes: usize, trials: usize, settings: &StatisticsSettings) -> Self {
        let successes = successes.min(trials);
        let [low, high] = wilson_interval(successes, trials, settings.z);
        Self { successes, trials, value: successes as f64 / trials.max(1) as f64, low, high }
    }

    /// Rate of true among the flags.
    pub fn of(flags: impl IntoIterator<Item = bool>, settings: &StatisticsSettings) -> Self {
        let (successes, trials) =
            flags.into_iter().fold((0, 0), |(successes, trials), flag| (successes + usize::from(flag), trials + 1));
        Self::new(successes, trials, settings)
    }

    /// Rate from successes and trials per scenario, with correlated episodes within a scenario.
    ///
    /// The Wilson interval uses the effective sample size of Korn and Graubard (1998) with their correction for few
    /// scenarios: at least the number of scenarios, at most the number of trials. Without any success, or any failure,
    /// the correlation is unknown, and the number of scenarios is used.
    pub fn clustered(scenarios: &[(usize, usize)], settings: &StatisticsSettings) -> Self {
        let (successes, trials) = scenarios.iter().fold((0, 0), |(s, n), scenario| (s + scenario.0, n + scenario.1));
        let count = scenarios.iter().filter(|scenario| scenario.1 > 0).count();
        if count == trials || count < 2 {
            return Self::new(successes, trials, settings);
        }
        let (clusters, all) = (count as f64, trials as f64);
        let value = successes as f64 / all;
        let squares = scenarios.iter().map(|&(s, n)| (s as f64 - value * n as f64).powi(2)).sum::<f64>();
        let variance = clusters / (clusters - 1.0) * squares / (all * all);
        let is_certain = successes == 0 || successes == trials;
        let effective = if is_certain { clusters } else { value * (1.0 - value) / variance.max(f64::MIN_POSITIVE) };
        let shrunk = (settings.z / student_quantile(count, settings.coverage)).powi(2);
        let [low, high] = wilson(value, effective.clamp(clusters, all) * shrunk, settings.z);
        Self { successes, trials, value, low, high }
    }
}

impl std::fmt::Display for Rate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.trials == 0 {
            return f.write_str("no trials");
        }
        write!(f, "{:.1} % (95 % CI {:.1}-{:.1} %)", 100.0 * self.value, 100.0 * self.low, 100.0 * self.high)
    }
}

/// A mean with its bootstrap interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Mean {
    /// Number of values.
    pub count: usize,
    /// Mean of the values, in their unit; 0 without values.
    pub value: f64,
    /// Lower end of the interval, in the unit of the values.
    pub low: f64,
    /// Upper end of the interval, in the unit of the values.
    pub high: f64,
}

/// Wilson score interval of a rate, without continuity correction (Wilson 1927); 0 to 1 without trials.
pub fn wilson_interval(successes: usize, trials: usize, z: f64) -> [f64; 2] {
    match trials {
        0 => [0.0, 1.0],
        trials => wilson(successes as f64 / trials as f64, trials as f64, z),
    }
}

fn wilson(share: f64, n: f64, z: f64) -> [f64; 2] {
    let z2 = z * z;
    let center = (share + z2 / (2.0 * n)) / (1.0 + z2 / n);
    let half = z / (1.0 + z2 / n) * (share * (1.0 - share) / n + z2 / (4.0 * n * n)).sqrt();
    // For a rate of 0 or 1 the end is exactly 0 or 1; rounding errors would give about 1e-17.
    let low = if share <= 0.0 { 0.0 } else { (center - half).max(0.0) };
    let high = if share >= 1.0 { 1.0 } else { (center + half).min(1.0) };
    [low, high]
}

/// Two-sided quantile of Student's t distribution with `count - 1` degrees of freedom.
pub(super) fn student_quantile(count: usize, coverage: f64) -> f64 {
    let freedom = count.saturating_sub(1).max(1) as f64;
    let student = StudentsT::new(0.0, 1.0, freedom).expect("positive degrees of freedom");
    student.inverse_cdf(0.5 + coverage.clamp(0.0, 1.0 - 1e-9) / 2.0)
}

/// Tail probability at which to cut the bootstrap distribution of `count` values for an interval of `coverage`: widened
/// by √(count / (count − 1)) for the bias of the variance, and by Student's t (Hesterberg 2015).
pub(crate) fn expanded_tail(count: usize, coverage: f64) -> f64 {
    let few = count.max(2) as f64;
    Normal::standard().cdf(-(few / (few - 1.0)).sqrt() * student_quantile(count, coverage))
}

/// Mean and percentile bootstrap interval (Efron 1979); deterministic for the same values in the same order.
///
/// Non-finite values are dropped. With one value, or equal values, the interval is that value.
pub fn mean_with_interval(values: &[f64], settings: &StatisticsSettings, seed: Seed) -> Mean {
    let values: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let count = values.len();
    if count == 0 {
        return Mean { count, value: 0.0, low: 0.0, high: 0.0 };
    }
    let value = values.iter().sum::<f64>() / count as f64;
    let mut rng = seed.rng();
    let means = (0..settings.resamples.max(1))
        .map(|_| (0..count).map(|_| values[rng.random_range(0..count)]).sum::<f64>() / count as f64)
        .collect();
    let [low, high] = percentiles(means, (1.0 - settings.coverage.clamp(0.0, 1.0)) / 2.0);
    Mean { count, value, low: low.min(value), high: high.max(value) }
}

/// Interval from the values of a bootstrap statistic, one per resample and at least one: `tail` of them lie beyond each
/// end.
pub(crate) fn percentiles(mut resampled: Vec<f64>, tail: f64) -> [f64; 2] {
    resampled.sort_by(f64::total_cmp);
    let quantile = |share: f64| resampled[((resampled.len() - 1) as f64 * share).round() as usize];
    [quantile(tail), quantile(1.0 - tail)]
}
