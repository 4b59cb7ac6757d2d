//! From a goal to moves: which object goes where, in which order.

use genmanip_core::{Atom, Goal};
use genmanip_scene::relations::PosedScene;

/// One object to be moved so that all its atoms hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// Index of the object in the scenario.
    pub object: usize,
    /// Every atom of the chosen alternative that is about this object's place.
    pub atoms: Vec<Atom>,
}

/// The moves of each alternative, in order; alternatives with a state to change have none until skills exist and
/// are left out.
pub fn moves(goal: &Goal, scene: &PosedScene) -> Vec<Vec<Move>> {
    goal.alternatives.iter().filter_map(|atoms| moves_of(atoms, scene)).filter(|moves| !moves.is_empty()).collect()
}

/// Groups atoms by the object they move and sorts so that whatever is placed against something comes after it.
fn moves_of(atoms: &[Atom], scene: &PosedScene) -> Option<Vec<Move>> {
    let mut pending: Vec<Move> = Vec::new();
    for atom in atoms {
        let Atom::Relation { subject, .. } = atom else { return None };
        let object = scene.index_of(subject)?;
        match pending.iter_mut().find(|m| m.object == object) {
            Some(known) => known.atoms.push(atom.clone()),
            None => pending.push(Move { object, atoms: vec![atom.clone()] }),
        }
    }
    let mut ordered: Vec<Move> = Vec::new();
    while !pending.is_empty() {
        let waits = |candidate: &Move| {
            candidate.atoms.iter().flat_map(references).any(|uid| {
                pending
                    .iter()
                    .any(|other| other.object != candidate.object && scene.index_of(uid) == Some(other.object))
            })
        };
        // A circle of references has no right order; the first then goes first.
        let next = pending.iter().position(|candidate| !waits(candidate)).unwrap_or(0);
        ordered.push(pending.remove(next));
    }
    Some(ordered)
}

/// What an atom places its subject against.
pub fn references(atom: &Atom) -> impl Iterator<Item = &str> {
    let (first, second) = match atom {
        Atom::Relation { reference, second_reference, .. } => (Some(reference.as_str()), second_reference.as_deref()),
        Atom::State { .. } => (None, None),
    };
    first.into_iter().chain(second)
}
