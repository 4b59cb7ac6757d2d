//! Success by scenario trait, such as relation or clutter.

use std::collections::BTreeMap;

use genmanip_core::EpisodeResult;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::StatisticsSettings;
use super::interval::Rate;

/// Values of the traits by trait name, for each scenario id.
pub type Traits = BTreeMap<String, BTreeMap<String, Vec<String>>>;

/// Minimum number of scenarios with a trait value for a row in tables. Chosen by hand: rates of fewer say little.
pub const MIN_SCENARIOS: usize = 4;

/// Success of one policy on the scenarios with one trait value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TraitSummary {
    /// Name of the trait, e.g. `relation`.
    pub name: String,
    /// Value of the trait, e.g. `left`; a scenario may have several.
    pub value: String,
    /// Number of scenarios with this value.
    pub scenarios: usize,
    /// Share of their episodes whose goal held at the end, with an interval clustered by scenario.
    pub success: Rate,
}

/// Numbers of successes and of episodes, by scenario id.
type Scenarios<'a> = BTreeMap<&'a str, (usize, usize)>;

/// Success by trait and value, ordered by name; intervals use the effective sample size, see [`Rate::clustered`].
pub fn by_trait(results: &[EpisodeResult], traits: &Traits, settings: &StatisticsSettings) -> Vec<TraitSummary> {
    let mut groups: BTreeMap<(&str, &str), Scenarios> = BTreeMap::new();
    for result in results {
        let own = traits.get(&result.scenario_id).into_iter().flatten();
        for (name, value) in own.flat_map(|(name, values)| values.iter().map(move |value| (name, value))) {
            let (successes, trials) = groups.entry((name, value)).or_default().entry(&result.scenario_id).or_default();
            *successes += usize::from(result.success);
            *trials += 1;
        }
    }
    let summary = |((name, value), scenarios): ((&str, &str), Scenarios)| TraitSummary {
        name: name.into(),
        value: value.into(),
        scenarios: scenarios.len(),
        success: Rate::clustered(&scenarios.into_values().collect::<Vec<_>>(), settings),
    };
    groups.into_iter().map(summary).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::tests::result;

    #[test]
    fn a_scenario_counts_for_each_of_its_values_and_only_there() {
        let results = [result("a", 1, true), result("a", 2, false), result("a", 3, true)];
        let of = |values: &[&str]| {
            BTreeMap::from([("relation".to_owned(), values.iter().map(|value| (*value).to_owned()).collect())])
        };
        let ids: Vec<String> = results.iter().map(|result| result.scenario_id.clone()).collect();
        let traits = BTreeMap::from([(ids[0].clone(), of(&["in", "left"])), (ids[1].clone(), of(&["left"]))]);
        let found = by_trait(&results, &traits, &StatisticsSettings::default());
        let rows: Vec<_> =
            found.iter().map(|it| (it.value.as_str(), it.success.successes, it.success.trials, it.scenarios)).collect();
        assert_eq!(rows, [("in", 1, 1, 1), ("left", 1, 2, 2)]);
    }
}
