//! Decomposition of a goal into ordered moves.

use genmanip_core::{Atom, Goal, RelationKind, Support};
use genmanip_relations::PosedScene;

use crate::articulation::joint_changes;

/// One object to be placed, or to be brought into a joint state, so that all its atoms hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// Index of the object in the scenario.
    pub object: usize,
    /// Relations of the chosen alternative with this object as subject, or its state atom.
    pub atoms: Vec<Atom>,
}

impl Move {
    /// Target joint state; `None` for a pick and place.
    pub fn state(&self) -> Option<&str> {
        match self.atoms.as_slice() {
            [Atom::State { state, .. }, ..] => Some(state),
            _ => None,
        }
    }
}

/// Ordered moves of each goal alternative.
pub fn moves(goal: &Goal, scene: &PosedScene) -> Vec<Vec<Move>> {
    goal.alternatives.iter().filter_map(|atoms| moves_of(atoms, scene)).filter(|moves| !moves.is_empty()).collect()
}

/// Groups atoms by object and orders the moves so that references are placed first; `None` if an object is not in the
/// scene.
fn moves_of(atoms: &[Atom], scene: &PosedScene) -> Option<Vec<Move>> {
    let mut pending: Vec<Move> = Vec::new();
    for atom in atoms {
        let object = scene.index_of(atom.subject())?;
        let is_place = |atom: &Atom| matches!(atom, Atom::Relation { .. });
        match pending.iter_mut().find(|m| m.object == object && is_place(atom) && m.state().is_none()) {
            Some(known) => known.atoms.push(atom.clone()),
            None => pending.push(Move { object, atoms: vec![atom.clone()] }),
        }
    }
    // A goal with an object inside a closed container implies opening the container, also if it is closed in the end.
    let is_inside = |atom: &Atom, object: usize| match atom {
        Atom::Relation { relation, reference, .. } => relation.is_inside() && scene.index_of(reference) == Some(object),
        Atom::State { .. } => false,
    };
    let filled = |object: usize| atoms.iter().any(|atom| is_inside(atom, object)) && is_hollow(object, scene);
    let opens = |step: &Move| step.state().is_some_and(|state| !closes(state));
    let is_implicit = |object: &usize| !pending.iter().any(|step| step.object == *object && opens(step));
    let implicit: Vec<Move> = (0..scene.objects().len())
        .filter(|&object| filled(object))
        .filter(is_implicit)
        .filter_map(|object| Some(Move { object, atoms: vec![opening(object, scene)?] }))
        .collect();
    pending.splice(0..0, implicit);
    let mut ordered: Vec<Move> = Vec::new();
    while !pending.is_empty() {
        let must_wait = |candidate: &Move| pending.iter().any(|other| comes_first(other, candidate, scene));
        // In a cycle of references, no move can precede all others, so the first one is taken.
        let next = pending.iter().position(|candidate| !must_wait(candidate)).unwrap_or(0);
        ordered.push(pending.remove(next));
    }
    Some(ordered)
}

/// True if one move must precede another.
fn comes_first(one: &Move, other: &Move, scene: &PosedScene) -> bool {
    let refers_to = |step: &Move, object: usize| {
        step.object != object
            && step.atoms.iter().flat_map(Atom::references).any(|id| scene.index_of(id) == Some(object))
    };
    match (one.state(), other.state()) {
        // A container is opened before it is filled and closed afterwards; a laptop is closed before something is
        // placed on it.
        (Some(state), None) => refers_to(other, one.object) && !(closes(state) && is_filled(other, one.object, scene)),
        (None, Some(state)) => refers_to(one, other.object) && closes(state) && is_filled(one, other.object, scene),
        (None, None) => refers_to(other, one.object),
        (Some(_), Some(_)) => false,
    }
}

const CLOSED: &str = "closed";

fn closes(state: &str) -> bool {
    state == CLOSED
}

/// Opening required before filling a closed container; `None` if it is open or cannot be closed.
fn opening(object: usize, scene: &PosedScene) -> Option<Atom> {
    let posed = scene.objects().nth(object)?;
    let states = &posed.model.joint_states;
    let closed = states.iter().find(|state| closes(&state.name))?;
    let is_closed = joint_changes(scene, object, &closed.name).is_empty();
    let open = states.iter().find(|state| !closes(&state.name)).filter(|_| is_closed)?;
    Some(Atom::State { object: posed.id.clone(), state: open.name.clone() })
}

/// True if a move places an object into the container.
fn is_filled(step: &Move, container: usize, scene: &PosedScene) -> bool {
    is_hollow(container, scene)
        && step.atoms.iter().any(|atom| match atom {
            Atom::Relation { relation, reference, .. } => {
                let is_into = match relation.kind() {
                    RelationKind::Support(support) => support != Support::On,
                    RelationKind::Side(_) | RelationKind::Around | RelationKind::Between => false,
                };
                is_into && scene.index_of(reference) == Some(container)
            }
            Atom::State { .. } => false,
        })
}

fn is_hollow(object: usize, scene: &PosedScene) -> bool {
    scene.objects().nth(object).is_some_and(|object| object.model.is_hollow())
}
