//! Final check of a design: it is validated like an answer of a language model, and its sentence is read back.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::{Atom, InstanceId, NamedSurface, ObjectCard, ReferenceId, Task, TaskKind};
use serde_json::{Value, json};

use super::kinds::Draft;
use super::sketch::{Condition, Sketch};
use crate::answer::{TaskRequest, Verdict, check_answer};
use crate::references::sentence::TABLE;
use crate::references::{self, Mismatch};

/// The finished task from `source`, or the reason why the design was rejected.
pub(super) fn pass(scene: &Sketch, draft: &Draft, kind: TaskKind, id: &str, source: &str) -> Result<Task, String> {
    let offered: Vec<ObjectCard> = scene.cards.iter().map(|card| (*card).clone()).collect();
    let atoms = |conjunction: &Vec<Condition>| conjunction.iter().map(|condition| scene.atom(condition)).collect();
    let is_on_table = |condition: &Condition| matches!(condition, Condition::OnTable(_));
    let surfaces: Vec<NamedSurface> = draft.goal.iter().flatten().any(is_on_table).then(table).into_iter().collect();
    let task = Task {
        id: id.to_owned(),
        kind,
        instruction: draft.instruction.clone(),
        goal: genmanip_core::Goal { alternatives: draft.goal.iter().map(atoms).collect() },
        scene_graph: scene.graph(draft.description.clone()),
        objects: offered.iter().cloned().map(Arc::new).collect(),
        surfaces: surfaces.clone(),
        interchangeable: Vec::new(),
        source: source.into(),
    };
    let request = TaskRequest {
        id: task.id.clone(),
        kind,
        surfaces,
        min_objects: scene.len().min(3),
        offered,
        between: true,
        source: task.source.clone(),
    };
    let report = check_answer(&as_answer(&task).to_string(), &request);
    if report.verdict != Verdict::Valid {
        let flaw = report.flaws.first().map_or_else(String::new, |flaw| flaw.kind.name());
        return Err(format!("refused by the rules for tasks: {flaw}"));
    }
    let task = report.task.ok_or("refused by the rules for tasks")?;
    if let Err(mismatch) = references::check(&task) {
        return Err(format!("the sentence reads differently: {}", mismatch.reason()));
    }
    if let Some([bare, other]) = &draft.without_need {
        let heard =
            |instruction: &String| references::check(&Task { instruction: instruction.clone(), ..task.clone() });
        if !matches!(heard(bare), Err(Mismatch::Ambiguous { .. })) {
            return Err("the request alone says what is meant".into());
        }
        if !matches!(heard(other), Err(Mismatch::OtherGoal { .. })) {
            return Err("another need does not ask for something else".into());
        }
    }
    Ok(task)
}

/// The task in the exchange format, as a language model would return it: copies of an object are numbered in order.
pub fn as_answer(task: &Task) -> Value {
    let numbered = InstanceId::numbered(task.objects.iter().map(|card| &card.uid));
    let nodes = &task.scene_graph.nodes;
    if nodes.len() == numbered.len() && nodes.iter().any(|node| !numbered.contains(&node.id)) {
        let ids = nodes.iter().map(|node| &*node.id).zip(&numbered).collect();
        return as_answer(&renumbered(task, &ids));
    }
    let name = |id: &ReferenceId| task.card(id).map_or("none", |card| card.name.as_str()).to_owned();
    let relation = |subject: &InstanceId, relation: &str, reference: &ReferenceId, second: Option<&ReferenceId>| {
        let mut entry = json!({
            "obj1": name(subject), "obj1_uid": subject, "position": relation,
            "obj2": name(reference), "obj2_uid": reference,
        });
        if let Some(second) = second {
            entry["obj3"] = name(second).into();
            entry["obj3_uid"] = second.as_str().into();
        }
        entry
    };
    let condition = |atom: &Atom| match atom {
        Atom::Relation { subject, relation: word, reference, second_reference } => {
            let mut entry = relation(subject, word.name(), reference, second_reference.as_ref());
            entry["obj1_state"] = "none".into();
            entry
        }
        Atom::State { object, state } => json!({
            "obj1": name(object), "obj1_uid": object, "obj1_state": state,
            "obj2": "none", "obj2_uid": "none", "position": "none",
        }),
    };
    let goal: Vec<Vec<Value>> =
        task.goal.alternatives.iter().map(|conjunction| conjunction.iter().map(condition).collect()).collect();
    let graph = &task.scene_graph;
    let edges: Vec<Value> = graph
        .edges
        .iter()
        .map(|edge| relation(&edge.subject, edge.relation.name(), &edge.reference, edge.second_reference.as_ref()))
        .collect();
    let nodes: Vec<Value> = graph
        .nodes
        .iter()
        .map(|node| json!({"obj_uid": node.id, "state": node.state.as_deref().unwrap_or("none")}))
        .collect();
    json!({
        "instruction": task.instruction,
        "goal_conditions": goal,
        "scene_graph": {"description": graph.description, "edges": edges, "nodes": nodes},
    })
}

/// The task with the ids of its objects replaced.
fn renumbered(task: &Task, ids: &BTreeMap<&ReferenceId, &InstanceId>) -> Task {
    let mut renumbered = task.clone();
    let goal = &mut renumbered.goal.alternatives;
    goal.iter_mut().flatten().for_each(|atom| *atom = atom.renamed(ids));
    let instance = |id: &InstanceId| ids.get(&**id).map_or(id, |other| *other).clone();
    let reference = |id: &ReferenceId| ids.get(id).map_or(id, |other| *other).clone();
    let graph = &mut renumbered.scene_graph;
    graph.nodes.iter_mut().for_each(|node| node.id = instance(&node.id));
    for edge in &mut graph.edges {
        edge.subject = instance(&edge.subject);
        edge.reference = reference(&edge.reference);
        edge.second_reference = edge.second_reference.as_ref().map(reference);
    }
    renumbered
}

/// The table as a surface that a goal names.
fn table() -> NamedSurface {
    NamedSurface { id: TABLE.into(), name: TABLE.into() }
}
