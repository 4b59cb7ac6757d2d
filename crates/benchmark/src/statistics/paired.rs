//! Comparison of two policies on the same episodes.

use std::collections::BTreeMap;

use genmanip_core::{EpisodeResult, Seed};
use rand::RngExt;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::interval::{Mean, Rate, expanded_tail, percentiles};
use super::power::detectable_difference;
use super::sequential::{Sequential, sequential};
use super::{StatisticsError, StatisticsSettings};

/// Two policies compared on their common episodes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PairedComparison {
    /// Label of the first policy.
    pub first: String,
    /// Label of the second policy.
    pub second: String,
    /// Number of common scenarios.
    pub scenarios: usize,
    /// Number of common episodes (same scenario and seed).
    pub pairs: usize,
    /// Number of episodes that only one policy has; they are not compared.
    pub unpaired: usize,
    /// Number of common episodes in which both succeeded.
    pub both: usize,
    /// Number of common episodes in which only the first succeeded.
    pub only_first: usize,
    /// Number of common episodes in which only the second succeeded.
    pub only_second: usize,
    /// Number of common episodes in which neither succeeded.
    pub neither: usize,
    /// Success rate of the first on the common episodes.
    pub first_success: Rate,
    /// Success rate of the second on the common episodes.
    pub second_success: Rate,
    /// Success rate of the first minus that of the second; see [`paired_difference`].
    pub difference: Mean,
    /// Two-sided exact p-value: McNemar's test, by scenario where scenarios have several episodes; see
    /// [`permutation_test`].
    pub p_value: f64,
    /// Sequential test, valid at any stopping time.
    pub sequential: Sequential,
    /// Smallest difference of success rates detectable with 80 % power; `None` if even the largest is not.
    pub detectable_difference: Option<f64>,
}

/// Compares two policies episode by episode; pairs share scenario and seed.
///
/// # Errors
/// [`StatisticsError::RepeatedEpisode`] when one policy has two results for a pair.
pub fn compare(
    first: &[EpisodeResult],
    second: &[EpisodeResult],
    settings: &StatisticsSettings,
) -> Result<PairedComparison, StatisticsError> {
    let name = |results: &[EpisodeResult]| results.first().map_or(String::new(), |result| result.policy.clone());
    let (first_by_episode, second_by_episode) = (by_episode(first)?, by_episode(second)?);
    let mut outcomes: Vec<(bool, bool)> = Vec::new();
    let mut by_scenario: BTreeMap<&str, Vec<i8>> = BTreeMap::new();
    for (episode, &success) in &first_by_episode {
        let Some(&other) = second_by_episode.get(episode) else { continue };
        outcomes.push((success, other));
        by_scenario.entry(episode.0).or_default().push(i8::from(success) - i8::from(other));
    }
    let clusters: Vec<Vec<i8>> = by_scenario.into_values().collect();
    let sums: Vec<i64> = clusters.iter().map(|cluster| cluster.iter().map(|&d| i64::from(d)).sum()).collect();
    let count = |wanted: (bool, bool)| outcomes.iter().filter(|outcome| **outcome == wanted).count();
    let (only_first, only_second) = (count((true, false)), count((false, true)));
    let discordant_share = (only_first + only_second) as f64 / outcomes.len().max(1) as f64;
    Ok(PairedComparison {
        first: name(first),
        second: name(second),
        scenarios: clusters.len(),
        pairs: outcomes.len(),
        unpaired: first_by_episode.len() + second_by_episode.len() - 2 * outcomes.len(),
        both: count((true, true)),
        only_first,
        only_second,
        neither: count((false, false)),
        first_success: Rate::of(outcomes.iter().map(|outcome| outcome.0), settings),
        second_success: Rate::of(outcomes.iter().map(|outcome| outcome.1), settings),
        difference: paired_difference(&clusters, settings, settings.seed.fork("paired difference")),
        p_value: permutation_test(&sums),
        sequential: sequential(&sums, 1.0 - settings.coverage),
        detectable_difference: detectable_difference(clusters.len(), discordant_share, 1.0 - settings.coverage),
    })
}

fn by_episode(results: &[EpisodeResult]) -> Result<BTreeMap<(&str, Seed), bool>, StatisticsError> {
    let mut episodes = BTreeMap::new();
    for result in results {
        if episodes.insert((result.scenario_id.as_str(), result.seed), result.success).is_some() {
            return Err(StatisticsError::RepeatedEpisode {
                policy: result.policy.clone(),
                scenario: result.scenario_id.clone(),
                seed: result.seed,
            });
        }
    }
    Ok(episodes)
}

/// Mean difference of success over all episodes, with its interval; each inner list holds the differences (-1, 0, 1) of
/// the episodes of one scenario.
///
/// With one episode per scenario: Bonett and Price (2012), a Wald interval with one pseudo-pair added on each side.
/// With several: a bootstrap over scenarios with expanded percentiles for few of them (Hesterberg 2015); if all
/// scenarios agree, where a bootstrap has no width, the first interval over scenarios.
pub fn paired_difference(scenarios: &[Vec<i8>], settings: &StatisticsSettings, seed: Seed) -> Mean {
    let sizes: Vec<f64> = scenarios.iter().map(|scenario| scenario.len() as f64).collect();
    let sums: Vec<f64> = scenarios.iter().map(|scenario| scenario.iter().map(|&d| f64::from(d)).sum::<f64>()).collect();
    let episodes: f64 = sizes.iter().sum();
    if episodes == 0.0 {
        return Mean { count: 0, value: 0.0, low: -1.0, high: 1.0 };
    }
    let value = sums.iter().sum::<f64>() / episodes;
    let means: Vec<f64> = sums.iter().zip(&sizes).map(|(sum, size)| sum / size.max(1.0)).collect();
    let agree = means.windows(2).all(|pair| pair[0] == pair[1]);
    let is_single = sizes.iter().all(|&size| size <= 1.0);
    let [low, high] = match is_single || agree {
        true => bonett_price(&means, settings),
        false => bootstrap_by_scenario(&sums, &sizes, settings, seed),
    };
    Mean { count: episodes as usize, value, low: low.min(value), high: high.max(value) }
}

/// Interval of the mean of differences between -1 and 1, one per scenario.
fn bonett_price(differences: &[f64], settings: &StatisticsSettings) -> [f64; 2] {
    let n = differences.len() as f64 + 2.0;
    let mean = differences.iter().sum::<f64>() / n;
    let square = (differences.iter().map(|d| d * d).sum::<f64>() + 2.0) / n;
    let half = settings.z * ((square - mean * mean).max(0.0) / n).sqrt();
    [(mean - half).max(-1.0), (mean + half).min(1.0)]
}

fn bootstrap_by_scenario(sums: &[f64], sizes: &[f64], settings: &StatisticsSettings, seed: Seed) -> [f64; 2] {
    let mut rng = seed.rng();
    let means = (0..settings.resamples.max(1))
        .map(|_| {
            let (mut sum, mut size) = (0.0, 0.0);
            for _ in 0..sums.len() {
                let drawn = rng.random_range(0..sums.len());
                sum += sums[drawn];
                size += sizes[drawn];
            }
            sum / size
        })
        .collect();
    percentiles(means, expanded_tail(sums.len(), settings.coverage))
}

/// Two-sided exact p-value of the null hypothesis that the two policies are exchangeable within every scenario.
///
/// `sums` are the differences of success, summed per scenario. The permutation distribution is computed exactly by
/// convolution, without sampling. With one episode per scenario this is McNemar's exact test.
///
/// ```
/// use genmanip_benchmark::statistics::{mcnemar_exact, permutation_test};
/// assert!((permutation_test(&[1, 1, 1, 0, 1, 1]) - mcnemar_exact(5, 0)).abs() < 1e-9);
/// ```
pub fn permutation_test(sums: &[i64]) -> f64 {
    let sizes: Vec<usize> = sums.iter().map(|sum| sum.unsigned_abs() as usize).filter(|&size| size > 0).collect();
    let total: usize = sizes.iter().sum();
    let observed = sums.iter().sum::<i64>().unsigned_abs() as usize;
    // Probability of every sum from -total to total, at index sum + total.
    let mut shares = vec![0.0; 2 * total + 1];
    shares[total] = 1.0;
    let mut reached = 0;
    for size in sizes {
        let before = shares.clone();
        shares[total - reached..=total + reached].fill(0.0);
        for index in total - reached..=total + reached {
            shares[index - size] += 0.5 * before[index];
            shares[index + size] += 0.5 * before[index];
        }
        reached += size;
    }
    let is_as_far = |index: usize| index.abs_diff(total) >= observed;
    (0..shares.len()).filter(|&index| is_as_far(index)).map(|index| shares[index]).sum::<f64>().min(1.0)
}

/// Two-sided exact p-value of McNemar's test from the two discordant counts:
/// twice the smaller tail of a fair binomial, at most 1.
///
/// ```
/// assert_eq!(genmanip_benchmark::statistics::mcnemar_exact(0, 5), 0.0625);
/// ```
pub fn mcnemar_exact(only_first: usize, only_second: usize) -> f64 {
    let (total, smaller) = (only_first + only_second, only_first.min(only_second));
    // Logarithms of binomial coefficients, so that thousands of pairs neither overflow nor underflow.
    let mut log_term = -(total as f64) * std::f64::consts::LN_2;
    let mut tail = 0.0;
    for successes in 0..=smaller {
        tail += log_term.exp();
        log_term += ((total - successes) as f64).ln() - ((successes + 1) as f64).ln();
    }
    (2.0 * tail).min(1.0)
}
