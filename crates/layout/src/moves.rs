//! From a goal to moves: which object goes where, in which order.

use genmanip_core::{Atom, Goal, Relation};
use genmanip_relations::PosedScene;

use crate::articulation::joint_changes;

/// One object to be moved, or brought into a state, so that all its atoms hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// Index of the object in the scenario.
    pub object: usize,
    /// Every atom of the chosen alternative that is about this object's place, or the one about its state.
    pub atoms: Vec<Atom>,
}

impl Move {
    /// The state to bring the object into; `None` when it is to be carried.
    pub fn state(&self) -> Option<&str> {
        match self.atoms.as_slice() {
            [Atom::State { state, .. }, ..] => Some(state),
            _ => None,
        }
    }
}

/// The moves of each alternative, in order.
pub fn moves(goal: &Goal, scene: &PosedScene) -> Vec<Vec<Move>> {
    goal.alternatives.iter().filter_map(|atoms| moves_of(atoms, scene)).filter(|moves| !moves.is_empty()).collect()
}

/// Groups atoms by what they move and sorts so that whatever is placed against something comes after it.
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
    // A goal that fills a shut container means it to be opened, although it does not say so.
    let goes_in = |atom: &Atom, object: usize| match atom {
        Atom::Relation { relation: Relation::In, reference, .. } => scene.index_of(reference) == Some(object),
        _ => false,
    };
    let filled = |object: usize| atoms.iter().any(|atom| goes_in(atom, object)) && is_hollow(object, scene);
    let unsaid = |object: &usize| !pending.iter().any(|step| step.object == *object && step.state().is_some());
    let opened: Vec<Move> = (0..scene.objects().len())
        .filter(|&object| filled(object))
        .filter(unsaid)
        .filter_map(|object| Some(Move { object, atoms: vec![opening(object, scene)?] }))
        .collect();
    pending.splice(0..0, opened);
    let mut ordered: Vec<Move> = Vec::new();
    while !pending.is_empty() {
        let waits = |candidate: &Move| pending.iter().any(|other| comes_first(other, candidate, scene));
        // A circle of references has no right order; the first then goes first.
        let next = pending.iter().position(|candidate| !waits(candidate)).unwrap_or(0);
        ordered.push(pending.remove(next));
    }
    Some(ordered)
}

/// Whether one move has to be made before another.
fn comes_first(one: &Move, other: &Move, scene: &PosedScene) -> bool {
    let places_against = |step: &Move, object: usize| {
        step.object != object && step.atoms.iter().flat_map(references).any(|id| scene.index_of(id) == Some(object))
    };
    match (one.state(), other.state()) {
        // A container is shut after it was filled, opened before; a laptop is shut before something is put on it.
        (Some(state), None) => {
            places_against(other, one.object) && !(shuts(state) && is_filled(other, one.object, scene))
        }
        (None, Some(state)) => places_against(one, other.object) && shuts(state) && is_filled(one, other.object, scene),
        (None, None) => places_against(other, one.object),
        (Some(_), Some(_)) => false,
    }
}

const SHUT: &str = "closed";

fn shuts(state: &str) -> bool {
    state == SHUT
}

/// The state that a shut container has to be brought into before anything can be put into it; `None` when it is open
/// already, or never shut.
fn opening(object: usize, scene: &PosedScene) -> Option<Atom> {
    let posed = scene.objects().nth(object)?;
    let states = &posed.model.joint_states;
    let shut = states.iter().find(|state| shuts(&state.name))?;
    let is_shut = joint_changes(scene, object, &shut.name).is_empty();
    let open = states.iter().find(|state| !shuts(&state.name)).filter(|_| is_shut)?;
    Some(Atom::State { object: posed.id.clone(), state: open.name.clone() })
}

/// Whether a move puts something into a container.
fn is_filled(step: &Move, container: usize, scene: &PosedScene) -> bool {
    is_hollow(container, scene)
        && step.atoms.iter().any(|atom| match atom {
            Atom::Relation { relation: Relation::In | Relation::Top, reference, .. } => {
                scene.index_of(reference) == Some(container)
            }
            _ => false,
        })
}

fn is_hollow(object: usize, scene: &PosedScene) -> bool {
    scene.objects().nth(object).is_some_and(|object| object.model.is_hollow())
}

/// What an atom places its subject against.
pub fn references(atom: &Atom) -> impl Iterator<Item = &str> {
    let (first, second) = match atom {
        Atom::Relation { reference, second_reference, .. } => (Some(reference.as_str()), second_reference.as_deref()),
        Atom::State { .. } => (None, None),
    };
    first.into_iter().chain(second)
}
