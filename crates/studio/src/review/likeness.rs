//! Near-duplicates among scenarios.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_benchmark::suite_format::template;
use genmanip_core::{Atom, Scenario};

/// Jaccard index from which two scenarios are near-duplicates. Chosen by hand: scenarios with the same goal and one of
/// six objects exchanged are above it, those with another goal among the same objects below.
const ALIKE: f64 = 0.7;
/// Weight of the goal in the index; one object has weight 1.
const GOAL: usize = 3;

/// Features of a scenario: its objects without their poses, its goal, and the template of its sentence.
pub fn features(scenario: &Scenario) -> BTreeSet<String> {
    let task = &scenario.task;
    let objects = task.scene_graph.nodes.iter().map(|node| format!("object {}", node.id));
    let mut features: BTreeSet<String> = objects.collect();
    features.insert(format!("sentence {}", template(&task.instruction)));
    let goal = goal(&task.goal.alternatives);
    features.extend((0..GOAL).map(|number| format!("goal {number} {goal}")));
    features
}

fn goal(alternatives: &[Vec<Atom>]) -> String {
    let alternative = |atoms: &Vec<Atom>| {
        let mut atoms: Vec<String> = atoms.iter().map(|atom| format!("{atom:?}")).collect();
        atoms.sort();
        atoms.join(" and ")
    };
    let mut all: Vec<String> = alternatives.iter().map(alternative).collect();
    all.sort();
    all.join(" or ")
}

/// Group of near-duplicates of each scenario, numbered from 0; `None` for a scenario without one. Groups are the
/// connected components of the relation of near-duplicates.
pub fn groups(features: &[&BTreeSet<String>]) -> Vec<Option<usize>> {
    // Scenarios with different goals cannot reach the threshold, so only those with a common goal are compared.
    let mut by_goal = BTreeMap::<&str, Vec<usize>>::new();
    for (index, own) in features.iter().enumerate() {
        let goal = own.iter().find(|feature| feature.starts_with("goal "));
        by_goal.entry(goal.map_or("", String::as_str)).or_default().push(index);
    }
    let mut group: Vec<Option<usize>> = vec![None; features.len()];
    let mut number = 0;
    for members in by_goal.values() {
        for &first in members {
            if group[first].is_some() {
                continue;
            }
            let (mut found, mut open) = (vec![first], vec![first]);
            while let Some(one) = open.pop() {
                for &other in members {
                    if !found.contains(&other)
                        && group[other].is_none()
                        && likeness(features[one], features[other]) >= ALIKE
                    {
                        found.push(other);
                        open.push(other);
                    }
                }
            }
            if found.len() > 1 {
                found.into_iter().for_each(|index| group[index] = Some(number));
                number += 1;
            }
        }
    }
    group
}

fn likeness(a: &BTreeSet<String>, b: &BTreeSet<String>) -> f64 {
    let common = a.intersection(b).count();
    common as f64 / (a.len() + b.len() - common).max(1) as f64
}
