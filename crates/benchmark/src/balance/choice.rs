//! Choice of a balanced suite from candidates, with a reason for every candidate.

use std::collections::BTreeSet;

use genmanip_core::{Atom, Document, Task};
use serde::{Deserialize, Serialize};

use super::axes::Axes;
use super::distribution::{Balance, ValueShare, balance};
use crate::suite_format::{Candidate, Targets, choose, template};

/// A scenario offered for a suite.
#[derive(Clone, Debug)]
pub struct Offered {
    /// Id of the scenario.
    pub scenario: String,
    /// The candidate; its traits are its axes.
    pub candidate: Candidate,
    /// Reason why it cannot be chosen, e.g. `rejected: implausible`; `None` if it can.
    pub refused: Option<String>,
}

/// A scenario with the reason why it was chosen or not.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reasoned {
    /// Id of the scenario.
    pub scenario: String,
    /// Reason why it was chosen or not, for people.
    pub reason: String,
}

/// Result of a choice; both lists are in the order of the offers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Choice {
    /// Scenarios chosen for the suite.
    pub chosen: Vec<Reasoned>,
    /// Scenarios that were not chosen.
    pub rejected: Vec<Reasoned>,
}

impl Document for Choice {
    const SCHEMA: &'static str = "genmanip.choice/1";
}

/// Candidate of a task with its axes. The choice avoids repeating objects of the goal and templates of the instruction.
pub fn candidate(task: &Task, axes: Axes, is_preferred: bool) -> Candidate {
    let things = task.goal.alternatives.iter().flatten().flat_map(Atom::ids).map(ToString::to_string);
    Candidate {
        kind: task.kind.name().into(),
        traits: axes,
        once: things.chain([template(&task.instruction)]).collect(),
        is_preferred,
    }
}

/// Chooses `per_kind` scenarios of each kind such that their distribution is close to the targets.
pub fn choice(offered: &[Offered], per_kind: usize, targets: &Targets) -> Choice {
    let free: Vec<usize> = (0..offered.len()).filter(|&index| offered[index].refused.is_none()).collect();
    let candidates: Vec<Candidate> = free.iter().map(|&index| offered[index].candidate.clone()).collect();
    let chosen: BTreeSet<usize> = choose(&candidates, per_kind, targets).into_iter().map(|place| free[place]).collect();
    let axes = |index: usize| &offered[index].candidate.traits;
    let taken: Vec<&Axes> = chosen.iter().map(|&index| axes(index)).collect();
    let all: Vec<&Axes> = free.iter().map(|&index| axes(index)).collect();
    let reached = balance(&taken, &all, targets);
    let mut made = Choice::default();
    for (index, one) in offered.iter().enumerate() {
        let kind = &one.candidate.kind;
        let (list, reason) = match &one.refused {
            Some(refused) => (&mut made.rejected, refused.clone()),
            None if chosen.contains(&index) => {
                let rarest = extreme(&one.candidate.traits, &reached, |share, wanted| wanted - share);
                let why =
                    rarest.map_or_else(|| "no target is missed without it".into(), |(words, _)| format!("for {words}"));
                (&mut made.chosen, if one.candidate.is_preferred { format!("preferred; {why}") } else { why })
            }
            None => {
                let commonest = extreme(&one.candidate.traits, &reached, |share, wanted| share - wanted);
                let why = match commonest {
                    Some((words, above)) if above > 0.0 => format!("enough of {words}"),
                    _ => format!("{per_kind} of kind {kind} are as balanced without it"),
                };
                (&mut made.rejected, why)
            }
        };
        list.push(Reasoned { scenario: one.scenario.clone(), reason });
    }
    made
}

/// Candidates that would improve the balance if added to the scenarios in `decided` (indices), most helpful first:
/// index, gain and reason. Candidates that cannot be chosen are omitted.
///
/// The gain is the mean over the axes of the relative shortfall of the candidate's values, each within -1 and 1: 1 if all
/// of them are missing, 0 if all are at their targets.
pub fn helpful(offered: &[Offered], decided: &BTreeSet<usize>, targets: &Targets) -> Vec<(usize, f64, String)> {
    let taken: Vec<&Axes> = decided.iter().map(|&index| &offered[index].candidate.traits).collect();
    let all: Vec<&Axes> = offered.iter().map(|one| &one.candidate.traits).collect();
    let now = balance(&taken, &all, targets);
    let is_free = |index: &usize| !decided.contains(index) && offered[*index].refused.is_none();
    let mut ranked: Vec<(usize, f64, String)> = (0..offered.len())
        .filter(is_free)
        .map(|index| {
            let axes = &offered[index].candidate.traits;
            let rarest = extreme(axes, &now, |share, wanted| wanted - share);
            (index, shortfall(axes, &now), rarest.map_or_else(String::new, |(words, _)| words))
        })
        .collect();
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    ranked
}

/// The values of a scenario on each axis that tells scenarios apart.
fn own_values<'a>(
    axes: &'a Axes,
    now: &'a Balance,
) -> impl Iterator<Item = (&'a str, impl Iterator<Item = &'a ValueShare>)> {
    now.axes.iter().filter(|known| known.values.len() > 1).map(|known| {
        let own = axes.get(&known.axis).into_iter().flatten();
        (known.axis.as_str(), own.filter_map(|value| known.values.iter().find(|share| share.value == *value)))
    })
}

fn shortfall(axes: &Axes, now: &Balance) -> f64 {
    let relative =
        |known: &ValueShare| if known.wanted > 0.0 { (1.0 - known.share / known.wanted).max(-1.0) } else { -1.0 };
    let shortfalls: Vec<f64> = own_values(axes, now)
        .filter_map(|(_, values)| {
            let of_axis: Vec<f64> = values.map(relative).collect();
            (!of_axis.is_empty()).then(|| of_axis.iter().sum::<f64>() / of_axis.len() as f64)
        })
        .collect();
    shortfalls.iter().sum::<f64>() / shortfalls.len().max(1) as f64
}

/// The value of a scenario for which `measure(share, target)` is largest, as text, with that measure; `None` without
/// axes of several values.
fn extreme(axes: &Axes, reached: &Balance, measure: impl Fn(f64, f64) -> f64) -> Option<(String, f64)> {
    let mut best: Option<(String, f64)> = None;
    for (axis, values) in own_values(axes, reached) {
        for value in values {
            let measured = measure(value.share, value.wanted);
            if best.as_ref().is_none_or(|(_, most)| measured > *most) {
                let (share, wanted) = (100.0 * value.share, 100.0 * value.wanted);
                best = Some((format!("{axis} {}: {share:.0} %, wanted {wanted:.0} %", value.value), measured));
            }
        }
    }
    best
}
