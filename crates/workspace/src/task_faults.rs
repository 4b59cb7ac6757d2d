//! Validation of task documents from untrusted sources: every fault of a document.

use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::names::is_file_name;
use genmanip_core::{ReferenceId, Task};

/// Maximum length of a task id, characters; an attempt's number is appended to it.
pub const MAX_ID_LENGTH: usize = 120;

/// Maximum number of nodes, and of edges or conditions: several times as many as fit on a table, and still rendered
/// quickly.
const MAX_NODES: usize = 64;
const MAX_CONDITIONS: usize = 256;

/// One fault of a task document.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Name of the fault; one of [`genmanip_tasks::answer::FlawKind`] where that has a suitable kind.
    pub flaw: &'static str,
    /// JSON path of the faulty value, starting with `$.`.
    pub place: String,
    /// Description of the fault, for the author of the document.
    pub message: String,
    /// Advice on how to fix the fault.
    pub hint: String,
}

impl Fault {
    fn new(flaw: &'static str, place: &str, message: String, hint: impl Into<String>) -> Self {
        Self { flaw, place: format!("$.{place}"), message, hint: hint.into() }
    }

    fn of_object(flaw: &'static str, place: &str, id: &ReferenceId, reason: &str) -> Self {
        let hint = "every object needs a node in scene_graph.nodes and, at the same place, its card in objects";
        Self::new(flaw, place, format!("object `{id}` {reason}"), hint)
    }
}

/// True if a text is a valid id: ids name folders and files, so they must not contain path separators.
fn is_id(id: &str) -> bool {
    id.len() <= MAX_ID_LENGTH && is_file_name(id)
}

/// All faults that make a document unusable; empty if it is usable. Every object in goal and scene graph needs a node
/// and a card, and ids must be valid file names.
pub fn faults(task: &Task) -> Vec<Fault> {
    let mut faults = Vec::new();
    if !is_id(&task.id) {
        let hint = format!("use 1 to {MAX_ID_LENGTH} ASCII letters, digits and any of -_.+=@, no dot in front");
        faults.push(Fault::new("unfit_id", "id", format!("`{}` cannot name a folder", task.id), hint));
    }
    let graph = &task.scene_graph;
    let conditions: usize = task.goal.alternatives.iter().map(Vec::len).sum();
    let sizes = [
        ("scene_graph.nodes", graph.nodes.len(), MAX_NODES),
        ("scene_graph.edges", graph.edges.len(), MAX_CONDITIONS),
        ("goal", conditions.max(task.goal.alternatives.len()), MAX_CONDITIONS),
    ];
    for (place, got, most) in sizes.into_iter().filter(|(_, got, most)| got > most) {
        let (message, hint) = (format!("expected at most {most} entries, got {got}"), "make several tasks of it");
        faults.push(Fault::new("too_large", place, message, hint));
    }
    if faults.iter().any(|fault| fault.flaw == "too_large") {
        return faults;
    }
    for (index, node) in graph.nodes.iter().enumerate() {
        let fault = |flaw, reason: &str| Fault::of_object(flaw, "scene_graph.nodes", &node.id, reason);
        if graph.nodes[..index].iter().any(|other| other.id == node.id) {
            faults.push(fault("duplicate_node", "has two nodes"));
        } else if task.card(&node.id).is_none_or(|card| card.asset != *node.asset) {
            faults.push(fault("missing_card", "has no card"));
        } else if let Err(error) = Catalogue::builtin().model(&node.asset) {
            faults.push(fault("unknown_uid", &format!("cannot be made: {error}")));
        }
    }
    let atoms = || task.goal.alternatives.iter().flatten().cloned().map(|atom| ("goal", atom));
    for (place, atom) in atoms().chain(graph.edges.iter().map(|edge| ("scene_graph.edges", edge.atom()))) {
        if graph.index_of(atom.subject()).is_none() {
            faults.push(Fault::of_object("missing_node", place, atom.subject(), "is no node of the scene"));
        }
        for id in atom.references() {
            if graph.index_of(id).is_none() && task.surface(id).is_none() {
                let reason = "is no node of the scene, and no support surface of the task";
                faults.push(Fault::of_object("missing_node", place, id, reason));
            }
        }
    }
    if let Err(error) = task.check_interchangeable() {
        let hint = "a group lists ids of nodes that are made from one asset";
        faults.push(Fault::new("unlike_copies", "interchangeable", error.to_string(), hint));
    }
    if task.goal.alternatives.iter().all(Vec::is_empty) {
        let hint = "a goal needs at least one alternative with one condition";
        faults.push(Fault::new("empty_goal", "goal", "no condition".into(), hint));
    }
    faults
}
