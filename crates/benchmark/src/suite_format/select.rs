//! Selection of the scenarios of a balanced suite from candidates.

use std::collections::{BTreeMap, BTreeSet};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Target shares (0 to 1) by trait and value; a trait that is absent has equal targets for all values.
pub type Targets = BTreeMap<String, BTreeMap<String, f64>>;

/// A candidate scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Name of the task kind; equally many candidates of each kind are selected.
    pub kind: String,
    /// Values of the balanced traits by name.
    pub traits: BTreeMap<String, Vec<String>>,
    /// Properties to repeat as little as possible: objects in the goal, and the sentence template.
    pub once: Vec<String>,
    /// True to select this candidate first, regardless of the balance.
    pub is_preferred: bool,
}

/// Share of one trait value in a selection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Marginal {
    /// Name of the trait.
    pub name: String,
    /// Value of the trait.
    pub value: String,
    /// Share of this value among all values of the trait, 0 to 1.
    pub share: f64,
    /// Target share, equal for all values of the trait.
    pub wanted: f64,
}

impl Marginal {
    /// Relative deviation of the share from its target.
    pub fn deviation(&self) -> f64 {
        (self.share - self.wanted).abs() / self.wanted
    }
}

/// Weight of repeated properties relative to the squared relative deviations of the marginals. Chosen by hand, so small
/// that it only decides between candidates of equal balance.
const AGAIN: f64 = 0.0005;
/// Maximum number of exchange rounds; the search ends earlier if a round improves nothing.
const ROUNDS: usize = 8;

/// Counts of trait values and properties in a selection, updated incrementally.
struct Tally<'a> {
    targets: &'a Targets,
    values: BTreeMap<String, BTreeMap<String, f64>>,
    once: BTreeMap<String, f64>,
}

impl<'a> Tally<'a> {
    /// Tally of an empty selection that knows every value of the candidates, so that missing values count as
    /// deviations.
    fn of(candidates: &[Candidate], targets: &'a Targets) -> Self {
        let mut tally = Self { targets, values: BTreeMap::new(), once: BTreeMap::new() };
        candidates.iter().for_each(|candidate| tally.add(candidate, 0.0));
        tally
    }

    fn add(&mut self, candidate: &Candidate, weight: f64) {
        for (name, values) in &candidate.traits {
            for value in values {
                *self.values.entry(name.clone()).or_default().entry(value.clone()).or_default() += weight;
            }
        }
        for thing in &candidate.once {
            *self.once.entry(thing.clone()).or_default() += weight;
        }
    }

    fn cost(&self) -> f64 {
        let deviation = |(name, counts): (&String, &BTreeMap<String, f64>)| {
            let (all, even) = (counts.values().sum::<f64>(), 1.0 / counts.len() as f64);
            let targets = self.targets.get(name);
            let squared = |(value, count): (&String, &f64)| {
                let wanted = match targets {
                    None => all / counts.len() as f64,
                    Some(shares) => all * shares.get(value).copied().unwrap_or(0.0),
                };
                // Lower bound, so that neither rare values nor values with target 0 dominate the cost.
                let scale = if targets.is_none() { wanted } else { wanted.max(all * even / 2.0) };
                ((count - wanted) / scale.max(1.0)).powi(2)
            };
            counts.iter().map(squared).sum::<f64>()
        };
        let again = self.once.values().map(|count| (count - 1.0).max(0.0).powi(2)).sum::<f64>();
        self.values.iter().map(deviation).sum::<f64>() + AGAIN * again
    }
}

/// Indices of the selected candidates of a suite: as [`select`], but in at least half of the spatial tasks two objects
/// are identified by their place, as far as there are enough such candidates for `per_kind`.
pub fn choose(candidates: &[Candidate], per_kind: usize, targets: &Targets) -> BTreeSet<usize> {
    let has_one_clue = |index: &usize| {
        candidates[*index].traits.get("clues").is_some_and(|clues| clues.iter().any(|clue| clue == "one"))
    };
    let mut left: Vec<usize> = (0..candidates.len()).collect();
    loop {
        let offered: Vec<Candidate> = left.iter().map(|&index| candidates[index].clone()).collect();
        let chosen: BTreeSet<usize> = select(&offered, per_kind, targets).into_iter().map(|at| left[at]).collect();
        let with_one: Vec<usize> = chosen.iter().copied().filter(has_one_clue).collect();
        let superfluous = with_one.iter().rev().find(|&&index| !candidates[index].is_preferred);
        let spare = |index: usize| {
            let of_kind = left.iter().filter(|&&other| candidates[other].kind == candidates[index].kind);
            of_kind.count() > per_kind
        };
        match superfluous {
            Some(&superfluous) if with_one.len() > per_kind.div_ceil(2) && spare(superfluous) => {
                left.retain(|&index| index != superfluous);
            }
            _ => return chosen,
        }
    }
}

/// Indices of `per_kind` candidates of each kind, ascending, whose trait values have about their target shares; fewer
/// if a kind has fewer candidates.
///
/// Preferred candidates are selected first and never exchanged. The others are added greedily, then exchanged while
/// that reduces the cost. The result is deterministic.
pub fn select(candidates: &[Candidate], per_kind: usize, targets: &Targets) -> Vec<usize> {
    let mut tally = Tally::of(candidates, targets);
    let mut kinds: Vec<&str> = candidates.iter().map(|candidate| candidate.kind.as_str()).collect();
    kinds.sort_unstable();
    kinds.dedup();
    let mut chosen = vec![false; candidates.len()];
    for _ in 0..per_kind {
        for kind in &kinds {
            let is_free = |index: &usize| !chosen[*index] && candidates[*index].kind == *kind;
            let preferred = (0..candidates.len()).find(|index| is_free(index) && candidates[*index].is_preferred);
            let free = preferred.map_or(0..candidates.len(), |index| index..index + 1).filter(is_free);
            let cost_with = |tally: &mut Tally<'_>, index: usize| {
                tally.add(&candidates[index], 1.0);
                let cost = tally.cost();
                tally.add(&candidates[index], -1.0);
                cost
            };
            let best = free.map(|index| (cost_with(&mut tally, index), index)).min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, index)) = best {
                chosen[index] = true;
                tally.add(&candidates[index], 1.0);
            }
        }
    }
    for _ in 0..ROUNDS {
        if !exchange(candidates, &mut chosen, &mut tally) {
            break;
        }
    }
    (0..candidates.len()).filter(|&index| chosen[index]).collect()
}

/// Exchanges each selected candidate for the best free one of its kind; true if an exchange reduced the cost.
fn exchange(candidates: &[Candidate], chosen: &mut [bool], tally: &mut Tally<'_>) -> bool {
    let mut has_helped = false;
    for out in 0..candidates.len() {
        if !chosen[out] || candidates[out].is_preferred {
            continue;
        }
        let before = tally.cost();
        tally.add(&candidates[out], -1.0);
        let mut best = (before - 1e-12, out);
        for other in 0..candidates.len() {
            if !chosen[other] && candidates[other].kind == candidates[out].kind {
                tally.add(&candidates[other], 1.0);
                let cost = tally.cost();
                tally.add(&candidates[other], -1.0);
                if cost < best.0 {
                    best = (cost, other);
                }
            }
        }
        tally.add(&candidates[best.1], 1.0);
        if best.1 != out {
            (chosen[out], chosen[best.1]) = (false, true);
            has_helped = true;
        }
    }
    has_helped
}

/// Shares of all values of all traits among these scenarios.
pub fn marginals<'a>(traits: impl Iterator<Item = &'a BTreeMap<String, Vec<String>>>) -> Vec<Marginal> {
    let mut counts: BTreeMap<&str, BTreeMap<&str, usize>> = BTreeMap::new();
    for own in traits {
        for (name, values) in own {
            for value in values {
                *counts.entry(name).or_default().entry(value).or_default() += 1;
            }
        }
    }
    let marginals = counts.iter().flat_map(|(name, values)| {
        let all: usize = values.values().sum();
        values.iter().map(move |(value, count)| Marginal {
            name: (*name).into(),
            value: (*value).into(),
            share: *count as f64 / all as f64,
            wanted: 1.0 / values.len() as f64,
        })
    });
    marginals.collect()
}
