//! New instructions for a task, which the rule-based reader understands as exactly its goal.

use std::sync::Arc;

use genmanip_core::{InstanceId, ObjectCard, ReferenceId, Relation, RelationKind, Support, Task};
use genmanip_tasks::{references, wording};

/// Maximum number of combinations of noun phrases tried.
const MAX_COMBINATIONS: usize = 300;
/// Maximum number of noun phrases per object.
const MAX_PHRASES: usize = 8;
/// Conjunctions between the sentences of several moves.
const JOINTS: [&str; 3] = [", then ", " and ", ", and then "];

/// Up to `most` instructions that state exactly the goal, shortest noun phrases first; none for a goal with
/// alternatives.
pub(super) fn instructions(task: &Task, most: usize) -> Vec<String> {
    let [alternative] = task.goal.alternatives.as_slice() else { return Vec::new() };
    let ids = references::intended(task);
    let nodes: Vec<usize> = ids.iter().filter_map(|id| task.scene_graph.index_of(id)).collect();
    let phrases: Vec<Vec<String>> = nodes.iter().map(|&node| phrases_of(task, node)).collect();
    let mut moved: Vec<&InstanceId> = Vec::new();
    for atom in alternative {
        if !moved.contains(&atom.subject()) {
            moved.push(atom.subject());
        }
    }
    let count = phrases.iter().map(Vec::len).product::<usize>().min(MAX_COMBINATIONS);
    let mut found: Vec<String> = Vec::new();
    for combination in 0..count {
        let mut rest = combination;
        let mut said = task.clone();
        for (&node, phrases) in nodes.iter().zip(&phrases) {
            let name = phrases[rest % phrases.len()].clone();
            rest /= phrases.len();
            said.objects[node] = Arc::new(ObjectCard { name, ..(*said.objects[node]).clone() });
        }
        let steps: Vec<String> = moved.iter().map(|object| wording::step(&said, object, 0)).collect();
        for joint in JOINTS.iter().take(if steps.len() > 1 { JOINTS.len() } else { 1 }) {
            let sentence = joined(&steps, joint);
            if sentence != task.instruction
                && !found.contains(&sentence)
                && references::check_said(task, &sentence).is_ok()
            {
                found.push(sentence);
                if found.len() == most {
                    return found;
                }
            }
        }
    }
    found
}

/// One sentence from those of several moves, with this conjunction.
fn joined(steps: &[String], joint: &str) -> String {
    let mut sentence = String::new();
    for (number, step) in steps.iter().enumerate() {
        let step = step.trim_end_matches('.');
        let mut letters = step.chars();
        match (number, letters.next()) {
            (0, _) | (_, None) => sentence.push_str(step),
            (_, Some(first)) => {
                sentence.push_str(joint);
                sentence.extend(first.to_lowercase().chain(letters));
            }
        }
    }
    sentence.push('.');
    sentence
}

/// Noun phrases of an object, without article: by its name, its look, and its name with a place.
fn phrases_of(task: &Task, node: usize) -> Vec<String> {
    let (card, id) = (&task.objects[node], &task.scene_graph.nodes[node].id);
    let mut phrases = vec![card.name.to_lowercase()];
    phrases.extend(card.annotations.looks.iter().cloned());
    phrases.extend(card.colors.first().map(|color| format!("{color} {}", card.category)));
    for edge in &task.scene_graph.edges {
        let (relation, other): (_, &ReferenceId) = match (edge.subject == *id, edge.reference == *id) {
            (true, _) => (edge.relation, &edge.reference),
            (_, true) => match edge.relation.inverse() {
                Some(inverse) => (inverse, &edge.subject),
                None => continue,
            },
            _ => continue,
        };
        let Some(other) = task.card(other).filter(|_| !relation.has_two_references()) else { continue };
        let relation = match relation.kind() {
            RelationKind::Support(Support::OnOrIn) if other.is_container => Relation::In,
            _ => relation,
        };
        phrases.push(format!(
            "{} {} the {}",
            card.name.to_lowercase(),
            relation.facts().located[0],
            other.name.to_lowercase()
        ));
    }
    phrases.truncate(MAX_PHRASES);
    phrases
}
