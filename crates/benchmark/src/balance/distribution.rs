//! Distribution of a collection over the values of each axis and pair of axes, with the distance from targets.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::axes::Axes;
use crate::suite_format::Targets;

/// Largest number of combinations of two axes that are compared; a pair with more says little about a few hundred
/// scenarios.
const MAX_COMBINATIONS: usize = 40;

/// Distribution of a collection.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Balance {
    /// Number of scenarios.
    pub scenarios: usize,
    /// Distribution over each single axis, by name.
    pub axes: Vec<AxisBalance>,
    /// Distribution over pairs of axes, largest distance from the target first.
    pub pairs: Vec<PairBalance>,
}

/// Distribution over the values of an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisBalance {
    /// Name of the axis.
    pub axis: String,
    /// Total variation distance from the target, 0 to 1: half the sum of the absolute differences.
    pub total_variation: f64,
    /// All values of the axis, those that occur only among the candidates included.
    pub values: Vec<ValueShare>,
}

/// Share of one value of an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ValueShare {
    /// Value of the axis.
    pub value: String,
    /// Number of scenarios with this value; a scenario can have several values of an axis.
    pub count: usize,
    /// Share of this value among all values of the axis that occur in the collection, 0 to 1.
    pub share: f64,
    /// Target share, 0 to 1.
    pub wanted: f64,
}

/// Distribution over the combinations of two axes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairBalance {
    /// Names of the two axes.
    pub axes: [String; 2],
    /// Total variation distance from the target over the combinations that occur among the candidates, 0 to 1. The
    /// target of a combination is proportional to the product of the targets of its values.
    pub total_variation: f64,
    /// Combination farthest below its target; `None` if none is below.
    pub rarest: Option<[String; 2]>,
}

/// Distribution of the chosen scenarios over the values and combinations that occur in `candidates`. On an axis with
/// targets, a value without one has target 0; on an axis without targets, all values have the same target.
pub fn balance(chosen: &[&Axes], candidates: &[&Axes], targets: &Targets) -> Balance {
    let known = |axes: &[&Axes]| -> BTreeSet<String> { axes.iter().flat_map(|own| own.keys().cloned()).collect() };
    let names: Vec<String> = known(candidates).union(&known(chosen)).cloned().collect();
    let axes: Vec<AxisBalance> = names.iter().map(|name| of_axis(name, chosen, candidates, targets)).collect();
    let mut pairs = Vec::new();
    for (index, first) in axes.iter().enumerate() {
        pairs.extend(axes[index + 1..].iter().filter_map(|second| of_pair([first, second], chosen, candidates)));
    }
    pairs.sort_by(|a, b| b.total_variation.total_cmp(&a.total_variation).then_with(|| a.axes.cmp(&b.axes)));
    Balance { scenarios: chosen.len(), axes, pairs }
}

fn of_axis(axis: &str, chosen: &[&Axes], candidates: &[&Axes], targets: &Targets) -> AxisBalance {
    let mut counts = BTreeMap::<&str, usize>::new();
    let of = |own: &&'_ Axes| -> Vec<String> { own.get(axis).cloned().unwrap_or_default() };
    let (offered, taken): (Vec<String>, Vec<String>) =
        (candidates.iter().flat_map(of).collect(), chosen.iter().flat_map(of).collect());
    let wanted = targets.get(axis);
    offered.iter().chain(wanted.into_iter().flat_map(BTreeMap::keys)).for_each(|value| {
        counts.entry(value).or_default();
    });
    taken.iter().for_each(|value| *counts.entry(value).or_default() += 1);
    let even = 1.0 / counts.len().max(1) as f64;
    let values: Vec<ValueShare> = counts
        .iter()
        .map(|(value, count)| ValueShare {
            value: (*value).to_owned(),
            count: *count,
            share: *count as f64 / taken.len().max(1) as f64,
            wanted: wanted.map_or(even, |shares| shares.get(*value).copied().unwrap_or(0.0)),
        })
        .collect();
    let total_variation = values.iter().map(|value| (value.share - value.wanted).abs()).sum::<f64>() / 2.0;
    AxisBalance { axis: axis.into(), total_variation, values }
}

/// Distribution over two axes; `None` if they never occur together or have more than [`MAX_COMBINATIONS`].
fn of_pair(axes: [&AxisBalance; 2], chosen: &[&Axes], candidates: &[&Axes]) -> Option<PairBalance> {
    let cells = |own: &&Axes| -> Vec<[String; 2]> {
        let values = |axis: &AxisBalance| own.get(&axis.axis).cloned().unwrap_or_default();
        let (first, second) = (values(axes[0]), values(axes[1]));
        first.iter().flat_map(|a| second.iter().map(move |b| [a.clone(), b.clone()])).collect()
    };
    let taken: Vec<[String; 2]> = chosen.iter().flat_map(cells).collect();
    let mut counts: BTreeMap<[String; 2], usize> = candidates.iter().flat_map(cells).map(|cell| (cell, 0)).collect();
    taken.iter().for_each(|cell| *counts.entry(cell.clone()).or_default() += 1);
    if counts.len() < 2 || counts.len() > MAX_COMBINATIONS {
        return None;
    }
    let wanted_of = |axis: &AxisBalance, value: &str| {
        axis.values.iter().find(|known| known.value == value).map_or(0.0, |known| known.wanted)
    };
    let wanted = |cell: &[String; 2]| wanted_of(axes[0], &cell[0]) * wanted_of(axes[1], &cell[1]);
    let all_wanted: f64 = counts.keys().map(wanted).sum();
    let difference = |(cell, count): (&[String; 2], &usize)| {
        let wanted = if all_wanted > 0.0 { wanted(cell) / all_wanted } else { 0.0 };
        *count as f64 / taken.len().max(1) as f64 - wanted
    };
    let total_variation = counts.iter().map(|cell| difference(cell).abs()).sum::<f64>() / 2.0;
    let rarest = counts.iter().map(|cell| (difference(cell), cell.0)).min_by(|a, b| a.0.total_cmp(&b.0));
    let rarest = rarest.filter(|(below, _)| *below < 0.0).map(|(_, cell)| cell.clone());
    Some(PairBalance { axes: [axes[0].axis.clone(), axes[1].axis.clone()], total_variation, rarest })
}
