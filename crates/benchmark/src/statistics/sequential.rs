//! Sequential test, valid at any stopping time.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A test that may be evaluated after every scenario and stopped at any time.
///
/// Under the null hypothesis, scenarios with different outcomes favour each policy with probability 1/2. The likelihood
/// ratio of a uniform mixture over all probabilities is then a martingale that starts at 1, and the probability that it
/// ever reaches 1/α is at most α (Ville 1939; Ramdas et al. 2023). Stopping when it does keeps the type I error at α,
/// whatever the stopping rule.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Sequential {
    /// Likelihood ratio after the last scenario.
    pub e_value: f64,
    /// Anytime-valid p-value: 1 over the maximum likelihood ratio so far.
    pub p_value: f64,
    /// Number of scenarios, in the order of their ids, after which the test was significant; `None` if it never was.
    pub decided_after: Option<usize>,
}

/// Runs the test over scenarios in a fixed order; `sums` are differences of success, summed per scenario.
///
/// ```
/// use genmanip_benchmark::statistics::sequential;
/// // Seven wins in a row are worth 2^7 / 8 = 16, eight 2^8 / 9 = 28.4.
/// assert_eq!(sequential(&[1; 8], 0.05).decided_after, Some(8));
/// assert_eq!(sequential(&[1, -1, 1, -1], 0.05).decided_after, None);
/// ```
pub fn sequential(sums: &[i64], alpha: f64) -> Sequential {
    let (mut wins, mut losses) = (0_u32, 0_u32);
    // Logarithm of 2^n wins! losses! / (n + 1)!, the likelihood under the uniform mixture over that under 1/2.
    let mut log_e = 0.0_f64;
    let mut largest = 0.0_f64;
    let mut decided_after = None;
    for (index, &sum) in sums.iter().enumerate() {
        let side = match sum.signum() {
            0 => continue,
            1 => &mut wins,
            _ => &mut losses,
        };
        *side += 1;
        let side = f64::from(*side);
        log_e += (2.0 * side / (f64::from(wins) + f64::from(losses) + 1.0)).ln();
        largest = largest.max(log_e);
        if decided_after.is_none() && log_e >= -alpha.ln() {
            decided_after = Some(index + 1);
        }
    }
    Sequential { e_value: log_e.exp(), p_value: (-largest).exp().min(1.0), decided_after }
}
