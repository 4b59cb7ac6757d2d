//! Fields of a scenario that an operation changes, for detecting conflicts.

use genmanip_core::{Document, InstanceId, ReferenceId, Scenario};
use serde_json::{Value, json};

use super::objects::names;
use super::operation::Operation;

/// Paths of the fields that an operation changes, such as `objects/001/pose`. `before` is the scenario that it is
/// applied to; all optional choices of the operation must be filled in.
pub(super) fn of(operation: &Operation, before: &Scenario) -> Vec<String> {
    let object = |id: &InstanceId| format!("objects/{id}");
    let in_graph =
        |id: &InstanceId| before.task.scene_graph.edges.iter().any(|edge| edge.atom().ids().any(|other| other == id));
    let in_request = |id: &InstanceId| before.other_request.as_ref().is_some_and(|request| names(&request.goal, id));
    let of_exchange = |old: &InstanceId, new: Option<&InstanceId>| {
        let mut fields = vec![object(old)];
        fields.extend(new.map(object));
        fields.extend(in_graph(old).then(|| "edges".to_owned()));
        fields.extend(names(&before.task.goal, old).then(|| "goal".to_owned()));
        fields.extend(in_request(old).then(|| "other_request".to_owned()));
        fields
    };
    let mut fields = Vec::new();
    match operation {
        Operation::Place { objects } => {
            for placement in objects {
                fields.push(format!("{}/pose", object(&placement.id)));
                if placement.joint_positions.is_some() {
                    fields.push(format!("{}/joints", object(&placement.id)));
                }
            }
        }
        Operation::State { object: id, .. } => {
            fields.extend(["joints", "state"].map(|part| format!("{}/{part}", object(id))));
        }
        Operation::Add { id, .. } | Operation::Duplicate { id, .. } => fields.extend(id.as_ref().map(object)),
        Operation::Remove { object: id } => {
            fields.push(object(id));
            fields.extend(in_graph(id).then(|| "edges".to_owned()));
            fields.extend(in_request(id).then(|| "other_request".to_owned()));
        }
        Operation::Insert { instance } => {
            fields.push(object(&instance.object.id));
            fields.extend((!instance.edges.is_empty()).then(|| "edges".to_owned()));
            fields.extend(instance.other_request.is_some().then(|| "other_request".to_owned()));
        }
        Operation::Swap { object: old, uid: _, id } => fields.extend(of_exchange(old, id.as_ref())),
        Operation::Exchange { object: old, instance } => fields.extend(of_exchange(old, Some(&instance.object.id))),
        Operation::Instruction { .. } => fields.push("instruction".into()),
        Operation::Goal { .. } => fields.push("goal".into()),
        Operation::Edges { description, .. } => {
            fields.push("edges".into());
            fields.extend(description.is_some().then(|| "description".to_owned()));
        }
        Operation::Kind { .. } => fields.push("kind".into()),
        Operation::Camera { camera, .. } => fields.push(format!("cameras/{}", camera.name)),
        Operation::RemoveCamera { name } => fields.push(format!("cameras/{name}")),
    }
    fields
}

/// First field of `mine` that equals, contains or lies within one of `theirs`; `None` if there is none.
pub(super) fn overlap<'a>(mine: &'a [String], theirs: &[String]) -> Option<&'a String> {
    let within =
        |part: &str, whole: &str| part.strip_prefix(whole).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
    mine.iter().find(|mine| theirs.iter().any(|theirs| within(mine, theirs) || within(theirs, mine)))
}

/// Value of the field with this path; null if the scenario has no such field.
pub(super) fn value(field: &str, scenario: &Scenario) -> Value {
    let mut parts = field.splitn(3, '/');
    let task = &scenario.task;
    match (parts.next().unwrap_or_default(), parts.next(), parts.next()) {
        ("objects", Some(id), part) => {
            let id = ReferenceId::from(id);
            let Some(index) = scenario.index_of(&id) else { return Value::Null };
            let object = &scenario.objects[index];
            match part {
                Some("pose") => json!(object.pose),
                Some("joints") => json!(object.joint_positions),
                Some("state") => json!(task.scene_graph.index_of(&id).map(|node| &task.scene_graph.nodes[node].state)),
                _ => json!({"asset": object.asset, "pose": object.pose, "joint_positions": object.joint_positions}),
            }
        }
        ("cameras", Some(name), None) => json!(scenario.world.camera(name)),
        ("instruction", ..) => json!(task.instruction),
        ("goal", ..) => json!(task.goal),
        ("edges", ..) => json!(task.scene_graph.edges),
        ("description", ..) => json!(task.scene_graph.description),
        ("kind", ..) => json!(task.kind),
        ("other_request", ..) => json!(scenario.other_request),
        _ => scenario.to_value().get(field).cloned().unwrap_or_default(),
    }
}
