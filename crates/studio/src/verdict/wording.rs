//! Stage `wording`: the rules for task documents, and the rule-based reader on the instruction.

use std::path::Path;

use genmanip_core::{InstanceId, Scenario, Task};
use genmanip_layout::is_harmless;
use genmanip_tasks::references::{self, Mismatch};
use genmanip_workspace::task_checks::{FlawDetail, check_task};

use super::problem::{Problem, ProblemCode, Stage};

/// Problems of the task's text, scene graph and goal, which do not depend on poses.
pub(super) fn problems(scenario: &Scenario) -> Vec<Problem> {
    let task = &scenario.task;
    let mut found = Vec::new();
    let mismatch = references::check(task).err();
    let mismatch = mismatch.filter(|mismatch| !references::is_beyond_the_reader(task, mismatch));
    found.extend(mismatch.as_ref().map(|mismatch| of_sentence(task, mismatch)));
    let checked = check_task(Path::new("task"), task.clone());
    let is_said = |detail: &&FlawDetail| mismatch.is_none() || detail.flaw != SENTENCE;
    if checked.is_rejected() {
        found.extend(checked.details.iter().filter(is_said).map(|detail| of_rule(task, detail)));
    }
    let nodes = &task.scene_graph.nodes;
    let distractors = scenario.objects.iter().filter(|object| !nodes.iter().any(|node| node.id == object.id));
    for object in distractors {
        let card = genmanip_assets::Catalogue::all().card(&object.id.asset());
        if let Some(card) = card.filter(|card| !is_harmless(card, task)) {
            let message = format!(
                "the instruction may also mean the {}, which the scene graph does not know",
                in_sentence(&card.name)
            );
            let problem =
                Problem::new(Stage::Wording, ProblemCode::AmbiguousSentence, Some(object.id.clone().into()), message);
            found.push(Problem { blocking: false, ..problem });
        }
    }
    found
}

/// Name within a sentence: in lower case but for brands and units, `the turquoise KIMO battery 3V`.
pub(super) fn in_sentence(name: &str) -> String {
    let word = |word: &str| match word.chars().skip(1).any(char::is_uppercase) {
        true => word.to_owned(),
        false => word.to_lowercase(),
    };
    name.split(' ').map(word).collect::<Vec<_>>().join(" ")
}

/// Name in the report of `task check` of a sentence that states another goal.
const SENTENCE: &str = "sentence_mismatch";

fn of_sentence(task: &Task, mismatch: &Mismatch) -> Problem {
    let intended = references::intended(task);
    match mismatch {
        Mismatch::Ambiguous { phrase, ids } => {
            let meant = ids.iter().find(|id| intended.iter().any(|other| other == *id)).or(ids.first());
            let other = ids.iter().find(|id| Some(*id) != meant);
            let names: Vec<String> = ids.iter().map(|id| format!("the {}", in_sentence(&task.name_of(id)))).collect();
            let message = format!("`{phrase}` may mean {}", names.join(" or "));
            let meant = meant.cloned().map(Into::into);
            let problem = Problem::new(Stage::Wording, ProblemCode::AmbiguousSentence, meant, message);
            match other {
                Some(other) => problem.measured(ids.len() as f64, 1.0, "objects").with(other.clone()),
                None => problem,
            }
        }
        Mismatch::Unreadable { .. } | Mismatch::Nothing { .. } | Mismatch::OtherGoal { .. } => {
            let object = intended.first().cloned();
            Problem::new(Stage::Wording, ProblemCode::SentenceMismatch, object, format!("the instruction: {mismatch}"))
        }
    }
}

fn of_rule(task: &Task, detail: &FlawDetail) -> Problem {
    let code = match detail.flaw.as_str() {
        "missing_node" | "missing_card" | "unknown_uid" | "unknown_object" => ProblemCode::MissingObject,
        "goal_already_satisfied" | "circular_goal" => ProblemCode::GoalHolds,
        SENTENCE => ProblemCode::SentenceMismatch,
        _ => ProblemCode::Rule,
    };
    let hint = if detail.hint.is_empty() { String::new() } else { format!(" ({})", detail.hint) };
    let message = format!("{}: {}{hint}", detail.flaw.replace('_', " "), detail.message);
    Problem::new(Stage::Wording, code, object_at(task, &detail.path).map(Into::into), message)
}

/// Id of the object that the node, edge or condition at a JSON path is about; `None` for other paths.
fn object_at(task: &Task, path: &str) -> Option<InstanceId> {
    let index = |list: &str| {
        let rest = path.strip_prefix(list)?.strip_prefix('[')?;
        rest.split(']').next()?.parse::<usize>().ok()
    };
    let graph = &task.scene_graph;
    let node = index("$.scene_graph.nodes").and_then(|index| graph.nodes.get(index)).map(|node| node.id.clone());
    let edge =
        || index("$.scene_graph.edges").and_then(|index| graph.edges.get(index)).map(|edge| edge.subject.clone());
    let goal = || {
        let alternative = task.goal.alternatives.get(index("$.goal").unwrap_or(0))?;
        path.starts_with("$.goal").then(|| alternative.first().map(|atom| atom.subject().clone()))?
    };
    node.or_else(edge).or_else(goal)
}

#[cfg(test)]
mod tests {
    use super::in_sentence;

    #[test]
    fn brands_and_units_keep_their_capitals() {
        let cases = [("Turquoise KIMO Battery 3V", "turquoise KIMO battery 3V"), ("Red Mug", "red mug"), ("", "")];
        for (name, expected) in cases {
            assert_eq!(in_sentence(name), expected);
        }
    }
}
