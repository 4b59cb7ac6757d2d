//! Tasks with a single object whose state is to change, or that is to be placed on or in another one.

use std::sync::Arc;

use genmanip_core::{Atom, Goal, GraphNode, ObjectCard, ObjectModel, Relation, SceneGraph, Task, TaskKind};
use genmanip_layout::articulation::JointChange;

use crate::Skill;
use crate::handle::verb;

/// Id of [`state_task`].
pub fn id(card: &ObjectCard, from: &str, to: &str) -> String {
    format!("{}-{from}-{to}", card.uid)
}

/// Task that brings an object, alone on the table, from one of its named states into another.
pub fn state_task(card: &ObjectCard, from: &str, to: &str) -> Task {
    let node = GraphNode { state: Some(from.into()), ..GraphNode::of(card) };
    let name = card.name.to_lowercase();
    Task {
        id: id(card, from, to),
        kind: TaskKind::Articulated,
        instruction: format!("Bring the {name} into the state {}.", to.replace('_', " ")),
        goal: Goal { alternatives: vec![vec![Atom::State { object: node.id.clone(), state: to.into() }]] },
        scene_graph: SceneGraph {
            description: format!("A {name} stands alone on the table."),
            nodes: vec![node],
            edges: Vec::new(),
        },
        objects: vec![Arc::new(card.clone())],
        surfaces: Vec::new(),
        interchangeable: Vec::new(),
        source: "skills".into(),
    }
}

/// Task that places an object, alone on the table with another one, in a relation to that one.
pub fn place_task(card: &ObjectCard, relation: Relation, reference: &ObjectCard) -> Task {
    let (node, other) = (GraphNode::of(card), GraphNode::of(reference));
    let atom = Atom::Relation {
        subject: node.id.clone(),
        relation,
        reference: other.id.clone().into(),
        second_reference: None,
    };
    let [name, under] = [&card.name, &reference.name].map(|name| name.to_lowercase());
    Task {
        id: format!("{}-{}-{}", card.uid, relation.name(), reference.uid),
        kind: TaskKind::PickAndPlace,
        instruction: format!("Place the {name} {} the {under}.", relation.name().replace('_', " ")),
        goal: Goal { alternatives: vec![vec![atom]] },
        scene_graph: SceneGraph {
            description: format!("A {name} and a {under} stand on the table."),
            nodes: vec![node, other],
            edges: Vec::new(),
        },
        objects: vec![Arc::new(card.clone()), Arc::new(reference.clone())],
        surfaces: Vec::new(),
        interchangeable: Vec::new(),
        source: "skills".into(),
    }
}

/// True if a skill serves the change of an object from one of its named states into another: the kind of manipulation
/// and the kind of joint are those of the source.
pub fn serves(skill: &Skill, model: &ObjectModel, from: &str, to: &str) -> bool {
    let nominal = |name: &str, link: &str| {
        let state = model.joint_states.iter().find(|state| state.name == name)?;
        let at = state.intervals.iter().position(|(known, _)| known == link)?;
        state.nominal.get(at).copied()
    };
    let moving = model.links.iter().enumerate().filter_map(|(link, known)| Some((link, known, known.joint.as_ref()?)));
    let Some(motion) = &skill.motion else { return false };
    moving.enumerate().any(|(joint, (link, known, own))| {
        let Some((from, to)) = nominal(from, &known.name).zip(nominal(to, &known.name)) else { return false };
        let change = JointChange { object: 0, link, joint, from, targets: vec![to] };
        from != to && own.kind == motion.joint && verb(model, &change) == skill.verb
    })
}
