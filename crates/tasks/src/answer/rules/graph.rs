//! Rules for the initial graph.

use std::collections::BTreeMap;

use super::consistency::{Link, contradictions};
use crate::answer::TaskRequest;
use crate::answer::flaw::{Findings, FlawKind};
use crate::answer::resolve::{Draft, Node};

/// Checks nodes and edges, and drops repeated nodes.
pub(super) fn check(mut draft: Draft, request: &TaskRequest, findings: &mut Findings) -> Draft {
    drop_repeated_nodes(&mut draft, request, findings);
    let name = |index: usize| object_name(request, index);
    for edge in &draft.edges {
        if edge.subject == edge.reference || [edge.subject, edge.reference].map(Some).contains(&edge.second) {
            let message = format!("expected two different objects, got {} twice", name(edge.subject));
            findings.reject(FlawKind::SelfRelation, edge.path.as_str(), message, "");
        }
        if edge.relation.is_inside() && !request.offered[edge.reference].is_container {
            let message = format!("expected a container, got {}", name(edge.reference));
            findings.reject(FlawKind::NotAContainer, edge.path.as_str(), message, "use `on` or another object");
        }
    }
    add_nodes_of_edges(&mut draft, request, findings);
    check_supports(&draft, request, findings);
    check_edges_of_nodes(&draft, request, findings);
    if draft.written_nodes < request.min_objects {
        let message = format!("expected at least {} nodes, got {}", request.min_objects, draft.written_nodes);
        findings.reject(FlawKind::TooFewObjects, "$.scene_graph.nodes", message, "choose more of the offered objects");
    }
    draft
}

/// Reports contradictory edges; true if there are none.
pub(super) fn check_consistency(draft: &Draft, request: &TaskRequest, findings: &mut Findings) -> bool {
    let links: Vec<Link> = draft
        .edges
        .iter()
        .filter(|edge| edge.subject != edge.reference)
        .map(|edge| Link { subject: edge.subject, relation: edge.relation, reference: edge.reference })
        .collect();
    let found = contradictions(&links, |index| object_name(request, index));
    for message in &found {
        let hint = "remove or change one of these edges";
        findings.reject(FlawKind::ContradictoryEdges, "$.scene_graph.edges", message.as_str(), hint);
    }
    found.is_empty()
}

/// Id and name of an object, `007 (Porcelain Plate)`.
pub(super) fn object_name(request: &TaskRequest, index: usize) -> String {
    let name = request.names().get(index).copied();
    name.map_or_else(String::new, |name| format!("{} ({name})", request.ids()[index]))
}

fn drop_repeated_nodes(draft: &mut Draft, request: &TaskRequest, findings: &mut Findings) {
    let mut states: BTreeMap<usize, Option<String>> = BTreeMap::new();
    draft.nodes.retain(|node| {
        let Some(state) = states.get(&node.object) else {
            states.insert(node.object, node.state.clone());
            return true;
        };
        let message = format!("expected one node per object, got another for {}", object_name(request, node.object));
        if *state == node.state {
            findings.repair(FlawKind::DuplicateNode, node.path.as_str(), message, "dropped the repetition");
        } else {
            let message = format!("{message} in another state");
            findings.reject(FlawKind::DuplicateNode, node.path.as_str(), message, "");
        }
        draft.written_nodes -= 1;
        false
    });
}

/// Reports objects that are on or in two others; a second relation to the same support is a repetition.
fn check_supports(draft: &Draft, request: &TaskRequest, findings: &mut Findings) {
    let mut supports: BTreeMap<usize, usize> = BTreeMap::new();
    for edge in draft.edges.iter().filter(|edge| edge.relation.is_support()) {
        let first = *supports.entry(edge.subject).or_insert(edge.reference);
        if first != edge.reference {
            let name = |index: usize| object_name(request, index);
            let message =
                format!("{} is on or in both {} and {}", name(edge.subject), name(first), name(edge.reference));
            findings.reject(FlawKind::TwoSupports, edge.path.as_str(), message, "keep one of these edges");
        }
    }
}

/// Adds missing nodes of objects in edges; for an object with states, whose initial state is then unknown, it reports a
/// flaw.
fn add_nodes_of_edges(draft: &mut Draft, request: &TaskRequest, findings: &mut Findings) {
    let mut missing: BTreeMap<usize, String> = BTreeMap::new();
    for edge in &draft.edges {
        for object in [edge.subject, edge.reference].into_iter().chain(edge.second) {
            if !request.is_surface(object) && !draft.nodes.iter().any(|node| node.object == object) {
                missing.entry(object).or_insert_with(|| edge.path.clone());
            }
        }
    }
    for (object, path) in missing {
        let message = format!("expected a node for {}, got none", object_name(request, object));
        if request.offered[object].states.is_empty() {
            findings.repair(FlawKind::MissingNode, path.as_str(), message, "added the node");
            draft.nodes.push(Node { object, state: None, path });
            draft.written_nodes += 1;
        } else {
            let hint = "every object of an edge is a node; that of an object with states says which it begins in";
            findings.reject(FlawKind::MissingNode, path, message, hint);
        }
    }
}

/// Reports nodes without any edge; an object whose only edge puts it on the table has a place.
fn check_edges_of_nodes(draft: &Draft, request: &TaskRequest, findings: &mut Findings) {
    if draft.lost_edges {
        return;
    }
    let has_edge = |object| {
        draft.on_table.contains(&object)
            || draft
                .edges
                .iter()
                .any(|edge| edge.subject == object || edge.reference == object || edge.second == Some(object))
    };
    for node in draft.nodes.iter().filter(|node| !has_edge(node.object)) {
        let message = format!("expected an edge for {}, got none", object_name(request, node.object));
        findings.reject(FlawKind::IsolatedObject, node.path.as_str(), message, "every chosen object is in an edge");
    }
}
