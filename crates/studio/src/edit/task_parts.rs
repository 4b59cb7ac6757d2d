//! Operations on the parts of a scenario other than objects: instruction, goal, edges and cameras.

use genmanip_core::world::camera_faults;
use genmanip_core::{Atom, Camera, Goal, GraphEdge, Scenario, SupportSurface};

use super::error::EditError;
use super::operation::Operation;

/// Maximum length of an instruction or a description, bytes; the rules for tasks allow much less.
const MAX_TEXT: usize = 4096;
/// Maximum number of edges, and of conditions of a goal, the same as for task documents.
const MAX_CONDITIONS: usize = 256;

/// Sets the instruction; returns the inverse operation.
pub(super) fn set_instruction(scenario: &mut Scenario, text: &str) -> Result<Operation, EditError> {
    check_text("args.text", text)?;
    let before = std::mem::replace(&mut scenario.task.instruction, text.to_owned());
    Ok(Operation::Instruction { text: before })
}

/// Sets the goal; returns the inverse operation.
pub(super) fn set_goal(scenario: &mut Scenario, goal: &Goal) -> Result<Operation, EditError> {
    let count: usize = goal.alternatives.iter().map(Vec::len).sum();
    if count == 0 || goal.alternatives.iter().any(Vec::is_empty) || count > MAX_CONDITIONS {
        let message = format!("expected 1 to {MAX_CONDITIONS} conditions, none of the alternatives empty, got {count}");
        return Err(EditError::invalid(
            "args.goal",
            message,
            "a goal is a list of alternatives, each a list of conditions",
        ));
    }
    for (place, alternative) in goal.alternatives.iter().enumerate() {
        for (index, atom) in alternative.iter().enumerate() {
            check_condition(scenario, atom, &format!("args.goal[{place}][{index}]"))?;
        }
    }
    let before = std::mem::replace(&mut scenario.task.goal, goal.clone());
    Ok(Operation::Goal { goal: before })
}

/// Sets the edges of the scene graph, and its description if given; returns the inverse operation.
pub(super) fn set_edges(
    scenario: &mut Scenario,
    edges: &[GraphEdge],
    description: Option<&str>,
) -> Result<Operation, EditError> {
    if edges.len() > MAX_CONDITIONS {
        let message = format!("expected at most {MAX_CONDITIONS} edges, got {}", edges.len());
        return Err(EditError::invalid("args.edges", message, ""));
    }
    for (index, edge) in edges.iter().enumerate() {
        check_edge(scenario, edge, &format!("args.edges[{index}]"))?;
    }
    let graph = &mut scenario.task.scene_graph;
    let before = std::mem::replace(&mut graph.edges, edges.to_vec());
    let description = match description {
        Some(text) => {
            check_text("args.description", text)?;
            Some(std::mem::replace(&mut graph.description, text.to_owned()))
        }
        None => None,
    };
    Ok(Operation::Edges { edges: before, description })
}

/// Adds a camera, or replaces the one of the same name; returns the inverse operation.
pub(super) fn set_camera(
    scenario: &mut Scenario,
    camera: &Camera,
    index: Option<usize>,
) -> Result<Operation, EditError> {
    let cameras = &mut scenario.world.cameras;
    let inverse = match cameras.iter_mut().find(|known| known.name == camera.name) {
        Some(known) => {
            let before = std::mem::replace(known, camera.clone());
            Operation::Camera { camera: Box::new(before), index: None }
        }
        None => {
            cameras.insert(index.unwrap_or(cameras.len()).min(cameras.len()), camera.clone());
            Operation::RemoveCamera { name: camera.name.clone() }
        }
    };
    match camera_faults(cameras).into_iter().next() {
        Some(fault) => {
            Err(EditError::invalid(format!("args.camera: {}", fault.place), fault.expectation(), fault.hint))
        }
        None => Ok(inverse),
    }
}

/// Removes a camera; returns the inverse operation.
pub(super) fn remove_camera(scenario: &mut Scenario, name: &str) -> Result<Operation, EditError> {
    let cameras = &mut scenario.world.cameras;
    let Some(index) = cameras.iter().position(|camera| camera.name == name) else {
        let known: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
        let hint = format!("the cameras are {}", known.join(", "));
        return Err(EditError::invalid("args.name", format!("expected the name of a camera, got {name:?}"), hint));
    };
    if cameras.len() == 1 {
        let hint = "add another camera first";
        return Err(EditError::invalid("args.name", "expected a camera to remain, this is the last one", hint));
    }
    Ok(Operation::Camera { camera: Box::new(cameras.remove(index)), index: Some(index) })
}

/// Checks that an edge of the scene graph refers to nodes and to surfaces other than the table, on which every other
/// object stands anyway.
pub(super) fn check_edge(scenario: &Scenario, edge: &GraphEdge, place: &str) -> Result<(), EditError> {
    check_atom(scenario, &edge.atom(), &scenario.world.surfaces[1..], place)
}

/// Checks that a condition of a goal refers to nodes, surfaces and states that exist in the scenario; objects can be put
/// on the table, but nothing lies beside or in it.
pub(super) fn check_condition(scenario: &Scenario, atom: &Atom, place: &str) -> Result<(), EditError> {
    let is_on = matches!(atom, Atom::Relation { relation, .. } if relation.is_support() && !relation.is_inside());
    check_atom(scenario, atom, &scenario.world.surfaces[usize::from(!is_on)..], place)
}

fn check_atom(scenario: &Scenario, atom: &Atom, surfaces: &[SupportSurface], place: &str) -> Result<(), EditError> {
    let task = &scenario.task;
    for (position, id) in atom.ids().enumerate() {
        let is_surface = position > 0 && surfaces.iter().any(|surface| surface.id == *id);
        if task.scene_graph.index_of(id).is_some() || is_surface {
            continue;
        }
        let (message, hint) = match scenario.index_of(id) {
            Some(_) => (
                format!("expected an object of the scene graph, got the distractor {id:?}"),
                "remove it and add it again, not as a distractor".to_owned(),
            ),
            None => {
                let known: Vec<&str> = task.scene_graph.nodes.iter().map(|node| node.id.as_str()).collect();
                (
                    format!("expected an object of the scene, got {id:?}"),
                    format!("the objects are {}", known.join(", ")),
                )
            }
        };
        return Err(EditError::invalid(place, message, hint));
    }
    match atom {
        Atom::Relation { subject, relation, reference, second_reference } => {
            if relation.has_two_references() != second_reference.is_some() {
                let message = if second_reference.is_some() {
                    format!("expected one reference of {}, got two", relation.name())
                } else {
                    format!("expected second_reference of {}, got none", relation.name())
                };
                return Err(EditError::invalid(place, message, ""));
            }
            if subject == reference
                || second_reference.as_ref().is_some_and(|second| [subject, reference].contains(&second))
            {
                let message = format!("expected different objects, got {atom}");
                return Err(EditError::invalid(place, message, ""));
            }
        }
        Atom::State { object, state } => {
            let states = task.card(object).map_or(&[][..], |card| &card.states);
            if !states.contains(state) {
                let hint = if states.is_empty() {
                    "only articulated objects have states".to_owned()
                } else {
                    format!("its states are {}", states.join(", "))
                };
                let message = format!("expected a state of {}, got {state:?}", task.name_of(object));
                return Err(EditError::invalid(place, message, hint));
            }
        }
    }
    Ok(())
}

fn check_text(place: &str, text: &str) -> Result<(), EditError> {
    if text.len() > MAX_TEXT {
        let message = format!("expected at most {MAX_TEXT} bytes, got {}", text.len());
        return Err(EditError::invalid(place, message, ""));
    }
    if text.chars().any(|c| c.is_control() && c != '\n') {
        return Err(EditError::invalid(place, "expected a text without control characters", ""));
    }
    Ok(())
}
