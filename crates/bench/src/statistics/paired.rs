//! Two policies on the same episodes.

use std::collections::BTreeMap;

use genmanip_core::{EpisodeResult, Seed};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::interval::{Mean, mean_with_interval};
use super::{StatisticsError, StatisticsSettings};

/// Two policies compared on the episodes that both ran.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PairedComparison {
    /// The first policy.
    pub first: String,
    /// The second policy.
    pub second: String,
    /// Episodes that both ran.
    pub pairs: usize,
    /// Episodes of only one of them, not compared.
    pub unpaired: usize,
    /// Both succeeded.
    pub both: usize,
    /// Only the first succeeded.
    pub only_first: usize,
    /// Only the second succeeded.
    pub only_second: usize,
    /// Neither succeeded.
    pub neither: usize,
    /// Success rate of the first minus that of the second, with a bootstrap interval over pairs.
    pub difference: Mean,
    /// Two-sided exact p-value of McNemar's test.
    pub p_value: f64,
}

/// Compares two policies episode by episode; a pair has the same scenario and the same seed.
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
    let outcomes: Vec<(bool, bool)> = first_by_episode
        .iter()
        .filter_map(|(episode, success)| Some((*success, *second_by_episode.get(episode)?)))
        .collect();
    let count = |wanted: (bool, bool)| outcomes.iter().filter(|outcome| **outcome == wanted).count();
    let (only_first, only_second) = (count((true, false)), count((false, true)));
    let differences: Vec<f64> =
        outcomes.iter().map(|(first, second)| f64::from(i8::from(*first) - i8::from(*second))).collect();
    Ok(PairedComparison {
        first: name(first),
        second: name(second),
        pairs: outcomes.len(),
        unpaired: first_by_episode.len() + second_by_episode.len() - 2 * outcomes.len(),
        both: count((true, true)),
        only_first,
        only_second,
        neither: count((false, false)),
        difference: mean_with_interval(&differences, settings, settings.seed.fork("paired difference")),
        p_value: mcnemar_exact(only_first, only_second),
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

/// Two-sided exact p-value of McNemar's test from the two discordant counts:
/// twice the smaller tail of a fair binomial, at most 1.
///
/// ```
/// assert_eq!(genmanip_bench::statistics::mcnemar_exact(0, 5), 0.0625);
/// ```
pub fn mcnemar_exact(only_first: usize, only_second: usize) -> f64 {
    let (total, smaller) = (only_first + only_second, only_first.min(only_second));
    // Logarithms of binomial coefficients, so that thousands of pairs neither overflow nor vanish early.
    let mut log_term = -(total as f64) * std::f64::consts::LN_2;
    let mut tail = 0.0;
    for successes in 0..=smaller {
        tail += log_term.exp();
        log_term += ((total - successes) as f64).ln() - ((successes + 1) as f64).ln();
    }
    (2.0 * tail).min(1.0)
}
