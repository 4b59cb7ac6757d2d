//! Measured difficulty of scenarios: success of reference policies.

use std::collections::BTreeMap;

use genmanip_core::EpisodeResult;

/// Numbers of successes and of episodes, by id of the scenario and by policy.
pub type Successes = BTreeMap<String, BTreeMap<String, (usize, usize)>>;

/// Numbers of successes and of episodes in these results.
pub fn successes<'a>(results: impl IntoIterator<Item = &'a EpisodeResult>) -> Successes {
    let mut found = Successes::new();
    for result in results {
        let of_scenario = found.entry(result.scenario_id.clone()).or_default();
        let (successes, episodes) = of_scenario.entry(result.policy.clone()).or_default();
        *successes += usize::from(result.success);
        *episodes += 1;
    }
    found
}

/// Difficulty of a scenario from the mean success rate of the policies that tried it, each with the same weight: `easy`
/// from two thirds, `hard` up to one third, `medium` between. `None` if no policy tried it.
pub fn difficulty(scenario: &str, successes: &Successes) -> Option<&'static str> {
    Some(match mean_success(scenario, successes)? {
        mean if mean >= 2.0 / 3.0 => "easy",
        mean if mean <= 1.0 / 3.0 => "hard",
        _ => "medium",
    })
}

/// Mean success rate of the policies that tried a scenario, each with the same weight, 0 to 1. `None` if no policy
/// tried it.
pub fn mean_success(scenario: &str, successes: &Successes) -> Option<f64> {
    let policies = successes.get(scenario).filter(|policies| !policies.is_empty())?;
    let rates = policies.values().map(|&(successes, episodes)| successes as f64 / episodes.max(1) as f64);
    Some(rates.sum::<f64>() / policies.len() as f64)
}
