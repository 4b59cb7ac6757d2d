//! Power analysis: number of scenarios needed to detect a difference of success rates.

use statrs::distribution::{Binomial, Discrete, DiscreteCDF};

/// Required power of a comparison: the conventional 80 %.
const POWER: f64 = 0.8;

/// Power of McNemar's exact test at level `alpha` for a difference of success rates, with one episode per scenario.
///
/// `discordant_share` is the share of scenarios on which exactly one of the two policies succeeds, 0 to 1; it is at
/// least
/// the difference.
///
/// ```
/// use genmanip_benchmark::statistics::power;
/// let chance = power(200, 0.3, 0.1, 0.05);
/// assert!((0.70..0.75).contains(&chance), "{chance}");
/// assert!(power(200, 0.3, 0.0, 0.05) <= 0.05);
/// ```
pub fn power(scenarios: usize, discordant_share: f64, difference: f64, alpha: f64) -> f64 {
    let difference = difference.abs();
    let share = discordant_share.clamp(difference, 1.0);
    let Ok(discordant) = Binomial::new(share, scenarios as u64) else { return 0.0 };
    let better = if share > 0.0 { ((share + difference) / (2.0 * share)).clamp(0.5, 1.0) } else { 0.5 };
    (0..=scenarios as u64)
        .map(|count| (count, discordant.pmf(count)))
        // Counts this improbable do not change the fourth digit of the power.
        .filter(|&(_, chance)| chance > 1e-9)
        .map(|(count, chance)| chance * found(count, better, alpha))
        .sum()
}

/// Probability that the test is significant for `count` discordant pairs, each won by the better policy with
/// probability
/// `better`.
fn found(count: u64, better: f64, alpha: f64) -> f64 {
    let (Ok(fair), Ok(actual)) = (Binomial::new(0.5, count), Binomial::new(better, count)) else { return 0.0 };
    // Maximum number of losses that is still significant: twice the lower tail of a fair coin is at most alpha.
    let lowest = fair.inverse_cdf(alpha / 2.0);
    let Some(most) = (0..=lowest).rev().find(|&losses| 2.0 * fair.cdf(losses) <= alpha) else { return 0.0 };
    let losses_only = actual.cdf(most);
    let wins_only = 1.0 - actual.cdf(count - most - 1);
    losses_only + wins_only
}

/// Smallest difference of success rates detectable with 80 % power, in steps of 0.001; `None` if even 1 is not.
pub fn detectable_difference(scenarios: usize, discordant_share: f64, alpha: f64) -> Option<f64> {
    let chance = |permille: u32| power(scenarios, discordant_share, f64::from(permille) / 1000.0, alpha);
    let (mut low, mut high) = (0, 1000);
    if chance(high) < POWER {
        return None;
    }
    while high - low > 1 {
        let middle = u32::midpoint(low, high);
        match chance(middle) < POWER {
            true => low = middle,
            false => high = middle,
        }
    }
    Some(f64::from(high) / 1000.0)
}
