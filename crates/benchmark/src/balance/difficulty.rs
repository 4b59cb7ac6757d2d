//! Measured difficulty of scenarios: success of reference policies.

use std::collections::BTreeMap;

use genmanip_core::EpisodeResult;

/// Results of reference policies by content, which is the SHA-256 of the scenario's file.
pub type MeasuredContents = BTreeMap<String, MeasuredContent>;

/// Results of reference policies on one content of a scenario.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeasuredContent {
    /// Id of the scenario.
    pub scenario_id: String,
    /// Numbers of successes and of episodes, by policy; at least one policy, each with at least one episode.
    pub policies: BTreeMap<String, (usize, usize)>,
}

impl MeasuredContent {
    /// Mean success rate of the policies, each with the same weight, 0 to 1.
    pub fn mean_success(&self) -> f64 {
        let rates = self.policies.values().map(|&(successes, episodes)| successes as f64 / episodes.max(1) as f64);
        rates.sum::<f64>() / self.policies.len().max(1) as f64
    }

    /// Difficulty from the mean success rate: `easy` from two thirds, `hard` up to one third, `medium` between.
    pub fn difficulty(&self) -> &'static str {
        match self.mean_success() {
            mean if mean >= 2.0 / 3.0 => "easy",
            mean if mean <= 1.0 / 3.0 => "hard",
            _ => "medium",
        }
    }

    /// Number of episodes of all policies.
    pub fn episodes(&self) -> usize {
        self.policies.values().map(|&(_, episodes)| episodes).sum()
    }
}

/// Successes in these results, each with the SHA-256 of the file of its scenario.
pub fn measured_contents<'a>(results: impl IntoIterator<Item = (&'a str, &'a EpisodeResult)>) -> MeasuredContents {
    let mut found = MeasuredContents::new();
    for (content, result) in results {
        let measured = found.entry(content.to_owned()).or_default();
        measured.scenario_id.clone_from(&result.scenario_id);
        let (successes, episodes) = measured.policies.entry(result.policy.clone()).or_default();
        *successes += usize::from(result.success);
        *episodes += 1;
    }
    found
}
