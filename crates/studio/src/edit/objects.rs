//! Operations on objects: placing, adding, removing and swapping, with scene-graph nodes, cards and edges.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_assets::AssetSource;
use genmanip_core::glam::DVec3;
use genmanip_core::{
    Goal, GraphEdge, GraphNode, InstanceId, ObjectModel, PhysicsFactors, PlacedObject, Pose, ReferenceId, Request,
    Scenario,
};

use super::catalogue::{find, new_id, nominal_joints};
use super::error::EditError;
use super::operation::{ChosenAsset, Instance, NodeWithCard, Operation, Placement};
use super::task_parts::{check_condition, check_edge};

/// Maximum distance from the world's origin along each axis, m; larger values suggest a wrong unit.
const MAX_DISTANCE_M: f64 = 10.0;
/// Gap between an object and its duplicate, m: enough for a finger.
const DUPLICATE_GAP_M: f64 = 0.03;

/// Sets poses and joint positions of objects; returns the inverse operation.
pub(super) fn place(
    scenario: &mut Scenario,
    objects: &[Placement],
    assets: &dyn AssetSource,
) -> Result<Operation, EditError> {
    if objects.is_empty() {
        return Err(EditError::invalid("args.objects", "expected at least one object, got none", ""));
    }
    let mut before = Vec::new();
    for (number, placement) in objects.iter().enumerate() {
        let here = format!("args.objects[{number}]");
        if objects[..number].iter().any(|other| other.id == placement.id) {
            let message = format!("expected each object once, got {:?} twice", placement.id);
            return Err(EditError::invalid(here, message, ""));
        }
        let index = index_of(scenario, &placement.id, &format!("{here}.id"))?;
        check_pose(&placement.pose, &format!("{here}.pose"))?;
        if let Some(joints) = &placement.joint_positions {
            check_joints(&*model(&scenario.objects[index], assets)?, joints, &format!("{here}.joint_positions"))?;
        }
        let object = &mut scenario.objects[index];
        before.push(Placement {
            id: placement.id.clone(),
            pose: std::mem::replace(&mut object.pose, placement.pose),
            joint_positions: placement
                .joint_positions
                .clone()
                .map(|joints| std::mem::replace(&mut object.joint_positions, joints)),
        });
    }
    Ok(Operation::Place { objects: before })
}

/// Sets state and joint positions of an articulated object; returns the inverse operation.
pub(super) fn set_state(
    scenario: &mut Scenario,
    object: &InstanceId,
    state: Option<&str>,
    joint_positions: Option<&[f64]>,
    assets: &dyn AssetSource,
) -> Result<Operation, EditError> {
    let index = index_of(scenario, object, "args.object")?;
    let model = model(&scenario.objects[index], assets)?;
    let nominal = nominal_joints(&model, state);
    if let (Some(state), None) = (state, &nominal) {
        let known: Vec<&str> = model.joint_states.iter().map(|state| state.name.as_str()).collect();
        let hint = match known.as_slice() {
            [] => "only articulated objects have states".to_owned(),
            known => format!("its states are {}", known.join(", ")),
        };
        let message = format!("expected a state of {}, got {state:?}", model.card.name);
        return Err(EditError::invalid("args.state", message, hint));
    }
    let joints = joint_positions.map(<[f64]>::to_vec).or(nominal);
    if let Some(joints) = &joints {
        check_joints(&model, joints, "args.joint_positions")?;
    }
    let placed = &mut scenario.objects[index];
    let old_joints = placed.joint_positions.clone();
    if let Some(joints) = joints {
        placed.joint_positions = joints;
    }
    let graph = &mut scenario.task.scene_graph;
    let old_state = match graph.index_of(object) {
        Some(node) => std::mem::replace(&mut graph.nodes[node].state, state.map(str::to_owned)),
        None => None,
    };
    Ok(Operation::State { object: object.clone(), state: old_state, joint_positions: Some(old_joints) })
}

/// Adds an object; returns the operation with its id filled in, and the inverse.
pub(super) fn add(
    scenario: &mut Scenario,
    asset: &ChosenAsset,
    id: Option<&InstanceId>,
    pose: Pose,
    distractor: bool,
    assets: &dyn AssetSource,
) -> Result<(Operation, Operation), EditError> {
    check_pose(&pose, "args.pose")?;
    let found = find(asset, assets, "args.asset")?;
    let id = new_id(scenario, &found.card.uid, id)?;
    let object = found.placed(&id, pose, None, PhysicsFactors::default());
    let node = (!distractor).then(|| GraphNode { id: id.clone(), ..GraphNode::of(&found.card) });
    append(scenario, object, node.map(|node| (node, Arc::clone(&found.card))));
    let operation = Operation::Add { asset: asset.clone(), id: Some(id.clone()), pose, distractor };
    Ok((operation, Operation::Remove { object: id }))
}

/// Adds another instance of an object's asset; returns the operation with pose and id filled in, and the inverse.
pub(super) fn duplicate(
    scenario: &mut Scenario,
    object: &InstanceId,
    pose: Option<Pose>,
    id: Option<&InstanceId>,
    assets: &dyn AssetSource,
) -> Result<(Operation, Operation), EditError> {
    let index = index_of(scenario, object, "args.object")?;
    let source = scenario.objects[index].clone();
    let pose = match pose {
        Some(pose) => pose,
        None => {
            let model = model(&source, assets)?;
            let width = model.world_bounds(&source.pose, &source.joint_positions).size().y;
            // The duplicate is placed on the side towards the middle of the table.
            let side = if source.pose.position.y > 0.0 { -1.0 } else { 1.0 };
            Pose { position: source.pose.position + DVec3::Y * side * (width + DUPLICATE_GAP_M), ..source.pose }
        }
    };
    check_pose(&pose, "args.pose")?;
    let node = scenario.task.scene_graph.index_of(object);
    let uid = node.map_or_else(|| object.asset(), |node| scenario.task.objects[node].uid.clone());
    let id = new_id(scenario, &uid, id)?;
    let node = node.map(|node| {
        let graph_node = GraphNode { id: id.clone(), ..scenario.task.scene_graph.nodes[node].clone() };
        (graph_node, Arc::clone(&scenario.task.objects[node]))
    });
    append(scenario, PlacedObject { id: id.clone(), pose, ..source }, node);
    let operation = Operation::Duplicate { object: object.clone(), pose: Some(pose), id: Some(id.clone()) };
    Ok((operation, Operation::Remove { object: id }))
}

/// Appends an object: after the last object with a node if it has one, else at the end.
fn append(scenario: &mut Scenario, object: PlacedObject, node: Option<(GraphNode, Arc<genmanip_core::ObjectCard>)>) {
    match node {
        Some((node, card)) => {
            let at = scenario.task.scene_graph.nodes.len().min(scenario.objects.len());
            scenario.objects.insert(at, object);
            scenario.task.scene_graph.nodes.push(node);
            scenario.task.objects.push(card);
        }
        None => scenario.objects.push(object),
    }
}

/// Removes an object with its node, card and edges; returns the inverse operation.
pub(super) fn remove(
    scenario: &mut Scenario,
    object: &InstanceId,
    groups_follow: bool,
) -> Result<Operation, EditError> {
    let index = index_of(scenario, object, "args.object")?;
    if names(&scenario.task.goal, object) {
        let message = format!("expected an object that the goal does not name, got {}", scenario.task.name_of(object));
        let hint = "set a goal without it first, with the operation `goal`";
        return Err(EditError::invalid("args.object", message, hint));
    }
    let placed = scenario.objects.remove(index);
    let task = &mut scenario.task;
    let node = task.scene_graph.index_of(object).map(|index| NodeWithCard {
        index,
        node: task.scene_graph.nodes.remove(index),
        card: task.objects.remove(index),
    });
    let mut edges = Vec::new();
    let all = std::mem::take(&mut task.scene_graph.edges);
    for (place, edge) in all.into_iter().enumerate() {
        if edge.atom().ids().any(|id| id == object) {
            edges.push((place, edge));
        } else {
            task.scene_graph.edges.push(edge);
        }
    }
    let interchangeable = without_member(scenario, object, groups_follow);
    let names_it = |request: &Request| names(&request.goal, object);
    let other_request =
        if scenario.other_request.as_ref().is_some_and(names_it) { scenario.other_request.take() } else { None };
    let instance = Instance { object: placed, index, node, edges, interchangeable, other_request };
    Ok(Operation::Insert { instance: Box::new(instance) })
}

/// Removes an object from the groups of interchangeable instances, unless the groups are derived from the instruction.
/// Returns the previous groups, or `None` if they did not change.
fn without_member(scenario: &mut Scenario, object: &InstanceId, groups_follow: bool) -> Option<Vec<Vec<InstanceId>>> {
    let groups = &mut scenario.task.interchangeable;
    if groups_follow || !groups.iter().flatten().any(|id| id == object) {
        return None;
    }
    let before = groups.clone();
    groups.iter_mut().for_each(|group| group.retain(|id| id != object));
    groups.retain(|group| group.len() >= 2);
    Some(before)
}

/// Restores a removed object; returns the inverse operation.
pub(super) fn insert(scenario: &mut Scenario, instance: &Instance) -> Result<Operation, EditError> {
    let id = &instance.object.id;
    if scenario.index_of(id).is_some() {
        let hint = "remove that object first";
        return Err(EditError::invalid("args.instance.object.id", format!("expected an unused id, got {id:?}"), hint));
    }
    check_instance(instance)?;
    let mut at = instance.index;
    if let Some(NodeWithCard { index, node, card }) = &instance.node {
        let graph = &mut scenario.task.scene_graph;
        let node_at = (*index).min(graph.nodes.len());
        // Objects with nodes come first in the list, in the order of the nodes.
        if at == *index {
            at = node_at;
        }
        graph.nodes.insert(node_at, node.clone());
        scenario.task.objects.insert(node_at, Arc::clone(card));
    }
    scenario.objects.insert(at.min(scenario.objects.len()), instance.object.clone());
    for (place, edge) in &instance.edges {
        check_edge(scenario, edge, "args.instance.edges")?;
        let edges = &mut scenario.task.scene_graph.edges;
        edges.insert((*place).min(edges.len()), edge.clone());
    }
    if let Some(groups) = &instance.interchangeable {
        scenario.task.interchangeable.clone_from(groups);
    }
    if let Some(request) = &instance.other_request {
        scenario.other_request = Some(request.clone());
    }
    Ok(Operation::Remove { object: id.clone() })
}

/// Replaces an object's asset; returns the operation with the new id filled in, and the inverse.
pub(super) fn swap(
    scenario: &mut Scenario,
    object: &InstanceId,
    asset: &ChosenAsset,
    id: Option<&InstanceId>,
    groups_follow: bool,
    assets: &dyn AssetSource,
) -> Result<(Operation, Operation), EditError> {
    let index = index_of(scenario, object, "args.object")?;
    let found = find(asset, assets, "args.uid")?;
    let old = &scenario.objects[index];
    if old.asset == found.model.asset {
        let message = format!("expected another asset, got that of {object:?}");
        return Err(EditError::invalid("args.uid", message, "choose an object with another uid"));
    }
    let id = new_id(scenario, &found.card.uid, id)?;
    let node_index = scenario.task.scene_graph.index_of(object);
    let state = node_index.and_then(|node| scenario.task.scene_graph.nodes[node].state.clone());
    let state = state.filter(|state| found.card.states.contains(state));
    let placed = found.placed(&id, old.pose, state.as_deref(), old.physics);
    let node = node_index.map(|index| NodeWithCard {
        index,
        node: GraphNode { id: id.clone(), state, ..GraphNode::of(&found.card) },
        card: Arc::clone(&found.card),
    });
    let instance =
        Instance { object: placed, index, node, edges: Vec::new(), interchangeable: None, other_request: None };
    let inverse = exchange(scenario, object, &instance, groups_follow)?;
    let operation = Operation::Swap { object: object.clone(), uid: asset.clone(), id: Some(id) };
    Ok((operation, inverse))
}

/// Replaces an object by another one, which goal and scene graph then refer to; returns the inverse operation.
pub(super) fn exchange(
    scenario: &mut Scenario,
    object: &InstanceId,
    instance: &Instance,
    groups_follow: bool,
) -> Result<Operation, EditError> {
    let index = index_of(scenario, object, "args.object")?;
    let id = &instance.object.id;
    if id != object && scenario.index_of(id).is_some() {
        return Err(EditError::invalid("args.instance.object.id", format!("expected an unused id, got {id:?}"), ""));
    }
    check_instance(instance)?;
    let node_index = scenario.task.scene_graph.index_of(object);
    if node_index.is_some() != instance.node.is_some() {
        let message = "expected a node exactly if the object has one";
        return Err(EditError::invalid("args.instance.node", message, ""));
    }
    let interchangeable = without_member(scenario, object, groups_follow);
    let task = &mut scenario.task;
    let old_node = node_index.zip(instance.node.as_ref()).map(|(index, new)| NodeWithCard {
        index,
        node: std::mem::replace(&mut task.scene_graph.nodes[index], new.node.clone()),
        card: std::mem::replace(&mut task.objects[index], Arc::clone(&new.card)),
    });
    let old = std::mem::replace(&mut scenario.objects[index], instance.object.clone());
    rename(scenario, object, id);
    if let Some(groups) = &instance.interchangeable {
        scenario.task.interchangeable.clone_from(groups);
    }
    let goal = &scenario.task.goal;
    for atom in goal.alternatives.iter().flatten().filter(|atom| atom.subject() == id) {
        check_condition(scenario, atom, "task.goal").map_err(|error| match error {
            EditError::Invalid { place, message, .. } => {
                EditError::invalid(place, message, "choose an object with that state, or set another goal first")
            }
            error => error,
        })?;
    }
    let before =
        Instance { object: old, index, node: old_node, edges: Vec::new(), interchangeable, other_request: None };
    Ok(Operation::Exchange { object: id.clone(), instance: Box::new(before) })
}

/// Renames an object in goal, edges and alternative request.
fn rename(scenario: &mut Scenario, from: &InstanceId, to: &InstanceId) {
    let table: BTreeMap<&ReferenceId, &InstanceId> = BTreeMap::from([(&**from, to)]);
    let in_goal = |goal: &mut Goal| {
        goal.alternatives.iter_mut().flatten().for_each(|atom| *atom = atom.renamed(&table));
    };
    in_goal(&mut scenario.task.goal);
    if let Some(request) = &mut scenario.other_request {
        in_goal(&mut request.goal);
    }
    for GraphEdge { subject, relation: _, reference, second_reference } in &mut scenario.task.scene_graph.edges {
        if subject == from {
            subject.clone_from(to);
        }
        for id in std::iter::once(reference).chain(second_reference).filter(|id| **id == *from) {
            *id = to.clone().into();
        }
    }
}

/// True if a condition of the goal names the object.
pub(super) fn names(goal: &Goal, object: &InstanceId) -> bool {
    goal.alternatives.iter().flatten().any(|atom| atom.ids().any(|id| id == object))
}

/// Index of an object in the scenario; `place` is the name of the argument in error messages.
fn index_of(scenario: &Scenario, id: &InstanceId, place: &str) -> Result<usize, EditError> {
    scenario.index_of(id).ok_or_else(|| {
        let known: Vec<&str> = scenario.objects.iter().map(|object| object.id.as_str()).collect();
        let hint = format!("the objects are {}", known.join(", "));
        EditError::invalid(place, format!("expected an object of the scenario, got {id:?}"), hint)
    })
}

fn model(object: &PlacedObject, assets: &dyn AssetSource) -> Result<Arc<ObjectModel>, EditError> {
    assets.instance(object).map_err(|error| {
        EditError::invalid(format!("objects/{}", object.id), error.to_string(), "swap it for another object")
    })
}

fn check_instance(instance: &Instance) -> Result<(), EditError> {
    let id = &instance.object.id;
    if instance.node.as_ref().is_some_and(|node| node.node.id != *id) {
        return Err(EditError::invalid("args.instance.node", format!("expected the node of {id:?}"), ""));
    }
    check_pose(&instance.object.pose, "args.instance.object.pose")
}

fn check_pose(pose: &Pose, place: &str) -> Result<(), EditError> {
    let is_near = pose.position.is_finite() && pose.position.abs().max_element() <= MAX_DISTANCE_M;
    if !is_near {
        let message = format!("expected a position within {MAX_DISTANCE_M} m, got {}", pose.position);
        return Err(EditError::invalid(place, message, "positions are in metres, in the robot's base frame"));
    }
    if !pose.rotation.is_normalized() {
        let message = format!("expected a quaternion of length 1, got {:.6}", pose.rotation.length());
        return Err(EditError::invalid(place, message, "the order is w, x, y, z"));
    }
    Ok(())
}

fn check_joints(model: &ObjectModel, joints: &[f64], place: &str) -> Result<(), EditError> {
    if joints.len() != model.joint_count() {
        let message =
            format!("expected {} joint positions of {}, got {}", model.joint_count(), model.card.name, joints.len());
        return Err(EditError::invalid(place, message, "joints are in the order of the links"));
    }
    let ranges = model.links.iter().filter_map(|link| link.joint.as_ref());
    for (joint, position) in ranges.zip(joints) {
        let [low, high] = joint.range;
        // Objects at rest may exceed the soft limits of their joints slightly.
        let slack = JOINT_SLACK * (high - low);
        if !(low - slack..=high + slack).contains(position) {
            let message = format!("expected {low} to {high} for joint {}, got {position}", joint.name);
            return Err(EditError::invalid(place, message, "rad, or m for sliding joints"));
        }
    }
    Ok(())
}

/// Tolerated excess of a joint position over its limit, as a share of the joint's range.
const JOINT_SLACK: f64 = 0.05;
