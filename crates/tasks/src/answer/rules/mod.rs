//! Rules of the format, checked on a resolved answer.

mod consistency;
mod goal;
mod graph;

use genmanip_core::{Task, TaskKind};

use super::TaskRequest;
use super::flaw::{Findings, FlawKind};
use super::resolve::{Draft, Test};
use crate::references;

/// Description in the example of the format; an answer that copies it describes nothing.
pub const DESCRIPTION_PLACEHOLDER: &str = "two to five sentences: where every object stands";

/// Maximum length of an instruction, in words separated by white space.
const MAX_WORDS: usize = 30;

/// Reports all violations and returns the repaired draft.
pub(super) fn check(draft: Draft, request: &TaskRequest, findings: &mut Findings) -> Draft {
    check_instruction(&draft, findings);
    if returns_placeholder(&draft.description) {
        let message = "expected a description of the scene, got the placeholder of the format";
        findings.reject(FlawKind::Placeholder, "$.scene_graph.description", message, "say where every object stands");
    }
    let draft = graph::check(draft, request, findings);
    let graph_is_consistent = graph::check_consistency(&draft, request, findings);
    goal::check(&draft, request, findings);
    if graph_is_consistent {
        // The implications of a contradictory graph are meaningless.
        goal::check_not_satisfied(&draft, findings);
    }
    check_kind(&draft, request, findings);
    draft
}

/// Reports a goal that holds initially for some instances when interchangeable instances are exchanged.
pub(super) fn check_copies(task: &Task, findings: &mut Findings) {
    if let Err(error) = task.check_interchangeable() {
        let hint = "say which copies are meant, or use fewer of them";
        findings.reject(FlawKind::TooLarge, "$.goal_conditions", error.to_string(), hint);
        return;
    }
    let goal = task.judged_goal();
    let others = goal.alternatives.iter().skip(task.goal.alternatives.len());
    for atoms in others {
        if !atoms.is_empty() && atoms.iter().all(|atom| goal::is_implied(&task.scene_graph, atom)) {
            let words: Vec<String> = atoms.iter().map(ToString::to_string).collect();
            let message = format!("another copy is where the goal wants one: {}", words.join(", "));
            let hint = "the goal must be false for every copy before the robot moves";
            findings.reject(FlawKind::GoalAlreadySatisfied, "$.goal_conditions", message, hint);
            return;
        }
    }
}

/// Checks that the instruction states the goal. Only for answers without other flaws, whose scene can be relied on.
pub(super) fn check_sentence(task: &Task, findings: &mut Findings) {
    if findings.rejects() {
        return;
    }
    if let Some(why) = references::disagreement(task) {
        let hint = "the goal is what the instruction asks for, and the instruction names its objects";
        findings.reject(FlawKind::SentenceMismatch, "$.instruction", why, hint);
    }
}

/// True if a description is the example's placeholder, whatever number of sentences it names.
fn returns_placeholder(description: &str) -> bool {
    let asked = DESCRIPTION_PLACEHOLDER.split_once(": ").map(|(_, asked)| asked);
    asked.is_some_and(|asked| description.to_lowercase().contains(asked))
}

fn check_instruction(draft: &Draft, findings: &mut Findings) {
    let words = draft.instruction.split_whitespace().count();
    if words == 0 {
        findings.reject(FlawKind::EmptyInstruction, "$.instruction", "expected a sentence, got none", "");
    } else if words > MAX_WORDS {
        let message = format!("expected at most {MAX_WORDS} words, got {words}");
        findings.reject(FlawKind::InstructionTooLong, "$.instruction", message, "words are counted by white space");
    }
}

/// Reports a goal that does not fit the kind: articulated tasks change a state, and all others except long-horizon
/// tasks have relations only.
fn check_kind(draft: &Draft, request: &TaskRequest, findings: &mut Findings) {
    let kind = request.kind;
    for (index, conjunction) in draft.alternatives.iter().enumerate() {
        if conjunction.len() < draft.written_conditions[index] || conjunction.is_empty() {
            continue;
        }
        let states = conjunction.iter().filter(|condition| matches!(condition.test, Test::State(_))).count();
        let (expected, got, hint) = match kind {
            TaskKind::Articulated if states == 0 => {
                ("a condition on a state", "relations only", state_condition(draft, request))
            }
            TaskKind::LongHorizon if conjunction.len() < 2 => {
                ("two or more conditions", "one", "write one condition for each action into the same list".to_owned())
            }
            TaskKind::Articulated | TaskKind::LongHorizon => continue,
            _ if states > 0 => {
                let hint = "say where an object is in the end: position and obj2_uid, with obj1_state \"none\"";
                ("relations only", "a condition on a state", hint.to_owned())
            }
            _ => continue,
        };
        let message = format!("expected {expected} in the goal of a task of kind {}, got {got}", kind.name());
        findings.reject(FlawKind::WrongKind, format!("$.goal_conditions[{index}]"), message, hint);
    }
}

/// Example of a condition on a state that differs from the initial state of an offered object, as JSON text.
fn state_condition(draft: &Draft, request: &TaskRequest) -> String {
    let initial = |object: usize| draft.nodes.iter().find(|node| node.object == object).map(|node| &node.state);
    // Objects of the scene are preferred.
    let mut objects = draft.nodes.iter().map(|node| node.object).chain(0..request.offered.len());
    let example = objects.find_map(|object| {
        let states = &request.offered.get(object)?.states;
        let state = states.iter().find(|state| initial(object).is_none_or(|initial| initial.as_ref() != Some(*state)));
        Some((object, state?))
    });
    example.map_or_else(String::new, |(object, state)| {
        format!(
            "for example {{\"obj1\": {:?}, \"obj1_uid\": {:?}, \"obj1_state\": {state:?}, \"obj2\": \"none\", \
             \"obj2_uid\": \"none\", \"position\": \"none\"}}",
            request.names()[object],
            request.ids()[object],
        )
    })
}
