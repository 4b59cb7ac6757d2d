//! Rules for the goal.

use std::collections::BTreeSet;

use genmanip_core::{Atom, Relation, SceneGraph};

use super::consistency::{Link, contradictions};
use super::graph::object_name;
use crate::answer::TaskRequest;
use crate::answer::flaw::{Findings, FlawKind};
use crate::answer::resolve::{Condition, Draft, Test};

/// Checks every condition on its own, and every conjunction for consistency.
pub(super) fn check(draft: &Draft, request: &TaskRequest, findings: &mut Findings) {
    check_not_empty(draft, findings);
    let mut missing = BTreeSet::new();
    let mut fixed = BTreeSet::new();
    for condition in draft.alternatives.iter().flatten() {
        check_condition(condition, draft, request, findings);
        for object in objects(condition) {
            let is_known = request.is_surface(object) || draft.nodes.iter().any(|node| node.object == object);
            if !is_known && missing.insert(object) {
                let message = format!("expected a node for {}, got none", object_name(request, object));
                findings.reject(
                    FlawKind::MissingNode,
                    condition.path.as_str(),
                    message,
                    "the goal uses objects of the scene",
                );
            }
        }
        let moves = matches!(condition.test, Test::Relation(..)) && holds_initially(condition, draft).is_none();
        if moves && !request.offered[condition.subject].can_grasp && fixed.insert(condition.subject) {
            let message =
                format!("expected an object that the hand can carry, got {}", object_name(request, condition.subject));
            let hint = "obj1 is the object that moves; choose one with can_grasp";
            findings.reject(FlawKind::NotGraspable, condition.path.as_str(), message, hint);
        }
    }
    for (index, conjunction) in draft.alternatives.iter().enumerate() {
        check_consistency(index, conjunction, request, findings);
    }
}

/// Requires that no alternative of the goal holds in the initial graph, inverse relations included.
pub(super) fn check_not_satisfied(draft: &Draft, findings: &mut Findings) {
    for (index, conjunction) in draft.alternatives.iter().enumerate() {
        if conjunction.is_empty() || conjunction.len() < draft.written_conditions[index] {
            continue;
        }
        let Some(views) =
            conjunction.iter().map(|condition| holds_initially(condition, draft)).collect::<Option<Vec<_>>>()
        else {
            continue;
        };
        let path = format!("$.goal_conditions[{index}]");
        let hint = "the goal must be false before the robot moves";
        if views.contains(&View::Inverted) {
            let message = "this alternative holds initially, seen from the other object";
            findings.reject(FlawKind::CircularGoal, path, message, hint);
        } else {
            let message = "this alternative holds initially";
            findings.reject(FlawKind::GoalAlreadySatisfied, path, message, hint);
        }
    }
}

/// Direction in which an edge is read when it implies a condition.
#[derive(Clone, Copy, PartialEq)]
enum View {
    Direct,
    Inverted,
}

/// Subject, relation, reference and second reference, with generic object ids.
type Fact<T> = (T, Relation, T, Option<T>);

/// Direction in which an initial edge implies a condition; `None` if no edge does.
fn holds_initially(condition: &Condition, draft: &Draft) -> Option<View> {
    match &condition.test {
        Test::State(state) => {
            let node = draft.nodes.iter().find(|node| node.object == condition.subject)?;
            (node.state.as_ref() == Some(state)).then_some(View::Direct)
        }
        Test::Relation(relation, reference, second) => {
            let edges = draft.edges.iter().map(|edge| (edge.subject, edge.relation, edge.reference, edge.second));
            implied_by(edges, (condition.subject, *relation, *reference, *second))
        }
    }
}

/// True if the initial graph of a task implies a condition.
pub(super) fn is_implied(graph: &SceneGraph, atom: &Atom) -> bool {
    match atom {
        Atom::State { object, state } => {
            graph.nodes.iter().any(|node| node.id == *object && node.state.as_ref() == Some(state))
        }
        Atom::Relation { subject, relation, reference, second_reference } => {
            let edges = graph.edges.iter();
            let edges =
                edges.map(|edge| (&*edge.subject, edge.relation, &edge.reference, edge.second_reference.as_ref()));
            implied_by(edges, (&**subject, *relation, reference, second_reference.as_ref())).is_some()
        }
    }
}

/// Direction in which an edge implies a relation; `None` if no edge does.
fn implied_by<T: Ord + Copy>(mut edges: impl Iterator<Item = Fact<T>> + Clone, condition: Fact<T>) -> Option<View> {
    let (subject, relation, reference, second) = condition;
    if relation.has_two_references() {
        let ends = |one: T, other: Option<T>| BTreeSet::from([Some(one), other]);
        let same =
            |edge: Fact<T>| edge.1 == relation && edge.0 == subject && ends(edge.2, edge.3) == ends(reference, second);
        return edges.any(same).then_some(View::Direct);
    }
    if edges.clone().any(|edge| (edge.0, edge.2) == (subject, reference) && edge.1.implies(relation)) {
        return Some(View::Direct);
    }
    let inverse_implies = |edge: Fact<T>| edge.1.inverse().is_some_and(|inverse| inverse.implies(relation));
    edges.any(|edge| (edge.2, edge.0) == (subject, reference) && inverse_implies(edge)).then_some(View::Inverted)
}

fn objects(condition: &Condition) -> impl Iterator<Item = usize> {
    let (reference, second) = match condition.test {
        Test::Relation(_, reference, second) => (Some(reference), second),
        Test::State(_) => (None, None),
    };
    std::iter::once(condition.subject).chain(reference).chain(second)
}

fn check_not_empty(draft: &Draft, findings: &mut Findings) {
    if draft.written_conditions.is_empty() {
        findings.reject(FlawKind::EmptyGoal, "$.goal_conditions", "expected at least one alternative, got none", "");
    }
    for (index, _) in draft.written_conditions.iter().enumerate().filter(|(_, count)| **count == 0) {
        let path = format!("$.goal_conditions[{index}]");
        findings.reject(
            FlawKind::EmptyGoal,
            path,
            "expected at least one condition, got none",
            "an empty list is always true",
        );
    }
}

fn check_condition(condition: &Condition, draft: &Draft, request: &TaskRequest, findings: &mut Findings) {
    let name = |index| object_name(request, index);
    let path = condition.path.as_str();
    let initial = draft.nodes.iter().find(|node| node.object == condition.subject).map(|node| &node.state);
    match &condition.test {
        Test::State(_) if initial.is_some_and(Option::is_none) => {
            let message = format!("expected an initial state in the node of {}, got none", name(condition.subject));
            findings.reject(FlawKind::MissingState, path, message, "a goal on a state needs another one to start from");
        }
        Test::Relation(_, reference, second)
            if *reference == condition.subject || *second == Some(condition.subject) || *second == Some(*reference) =>
        {
            let message = format!("expected different objects, got {} twice", name(*reference));
            findings.reject(FlawKind::SelfRelation, path, message, "");
        }
        Test::Relation(relation, reference, _) if relation.is_inside() && !request.offered[*reference].is_container => {
            let message = format!("expected a container, got {}", name(*reference));
            findings.reject(FlawKind::NotAContainer, path, message, "use `on` or another object");
        }
        _ => {}
    }
    if let Some(state) = &condition.beside
        && initial.and_then(Option::as_ref) != Some(state)
    {
        let message = format!("expected one relation or one state, got a relation and the state `{state}`");
        findings.reject(FlawKind::MixedCondition, path, message, "write two conditions in the same list");
    }
}

fn check_consistency(index: usize, conjunction: &[Condition], request: &TaskRequest, findings: &mut Findings) {
    let links: Vec<Link> = conjunction
        .iter()
        .filter_map(|condition| match condition.test {
            Test::Relation(relation, reference, _) if reference != condition.subject => {
                Some(Link { subject: condition.subject, relation, reference })
            }
            _ => None,
        })
        .collect();
    let path = format!("$.goal_conditions[{index}]");
    for message in contradictions(&links, |object| object_name(request, object)) {
        findings.reject(FlawKind::ContradictoryGoal, path.as_str(), message, "this alternative can never hold");
    }
    let mut states = BTreeSet::new();
    let mut objects = BTreeSet::new();
    for condition in conjunction {
        if let Test::State(state) = &condition.test
            && states.insert((condition.subject, state))
            && !objects.insert(condition.subject)
        {
            let message = format!("expected one state of {}, got several", object_name(request, condition.subject));
            findings.reject(FlawKind::ContradictoryGoal, path.as_str(), message, "states exclude each other");
        }
    }
}
