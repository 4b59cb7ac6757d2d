//! Drawing of a layout's task from its distribution.

use std::collections::BTreeSet;
use std::sync::Arc;

use genmanip_core::{AssetUid, Atom, Goal, GraphNode, InstanceId, ObjectCard, ReferenceId, SceneGraph, Seed, Task};
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt};

use super::format::{Distractors, Distribution, DistributionsFile, RoleAtom, Split, card, placeholders};

/// Maximum number of draws for objects of different categories. Chosen by hand, far more than sets of several
/// categories need.
const MAX_DRAWS: usize = 100;

/// Position of a layout: split, number within the split from 0, and attempt from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub split: Split,
    pub number: u64,
    pub attempt: u64,
}

/// Draws the task of a layout; a pure function of the document and the position.
pub(super) fn draw(file: &DistributionsFile, distribution: &Distribution, place: Place) -> Task {
    let Place { split, number, attempt } = place;
    let stream = file.seed.fork(&distribution.name).fork(split.name()).fork_index(number);
    let rng = &mut stream.fork(&format!("attempt {attempt}")).rng();
    let cast = cast(distribution, split, rng);
    let goal = distribution.goals.of(split).choose(rng).cloned();
    let wording = goal.as_ref().and_then(|goal| goal.wordings.choose(rng)).cloned().unwrap_or_default();
    let others = others(&distribution.distractors, &cast, rng);
    let player = |role: &str| distribution.roles.iter().position(|it| it.role == role).map(|index| cast[index]);
    let instance = |role: &String| Some(InstanceId::new(&player(role)?.uid, 1));
    let reference = |role: &String| instance(role).map(ReferenceId::from);
    let mut instruction = wording.clone();
    for role in placeholders(&wording) {
        let category = player(role).map(|card| card.category.as_str()).unwrap_or_default();
        instruction = instruction.replace(&format!("{{{role}}}"), category);
    }
    let states = goal.iter().flat_map(|goal| &goal.initial_states);
    let states: Vec<(&AssetUid, &String)> =
        states.filter_map(|(role, state)| Some((&player(role)?.uid, state))).collect();
    // The checked file has all roles that its conditions name.
    let atom = |atom: &RoleAtom| {
        Some(match atom {
            Atom::Relation { subject, relation, reference: first, second_reference } => Atom::Relation {
                subject: instance(subject)?,
                relation: *relation,
                reference: reference(first)?,
                second_reference: second_reference.as_ref().and_then(reference),
            },
            Atom::State { object, state } => Atom::State { object: instance(object)?, state: state.clone() },
        })
    };
    let node = |card: &&ObjectCard| {
        let state = states.iter().find(|(uid, _)| **uid == card.uid).map(|(_, state)| (*state).clone());
        GraphNode { state, ..GraphNode::of(card) }
    };
    let cards: Vec<&ObjectCard> = cast.iter().copied().chain(others).collect();
    let again = if attempt > 1 { format!("_{attempt}") } else { String::new() };
    Task {
        id: format!("{}-{}-{number:04}{again}", distribution.name, split.name()),
        kind: distribution.kind,
        instruction,
        goal: Goal { alternatives: vec![goal.iter().flat_map(|goal| &goal.conditions).filter_map(atom).collect()] },
        scene_graph: SceneGraph {
            description: String::new(),
            nodes: cards.iter().map(node).collect(),
            edges: Vec::new(),
        },
        objects: cards.into_iter().map(|card| Arc::new(card.clone())).collect(),
        surfaces: Vec::new(),
        interchangeable: Vec::new(),
        source: file.name.clone(),
    }
}

/// Cards of the objects for the roles, in the order of the roles; of different categories where possible.
fn cast(distribution: &Distribution, split: Split, rng: &mut impl Rng) -> Vec<&'static ObjectCard> {
    let mut drawn = Vec::new();
    for _ in 0..MAX_DRAWS {
        let sets = distribution.roles.iter().map(|role| role.objects.of(split));
        drawn = sets.filter_map(|set| card(set.choose(rng)?)).collect();
        let categories: BTreeSet<&str> = drawn.iter().map(|card: &&ObjectCard| card.category.as_str()).collect();
        if categories.len() == drawn.len() {
            break;
        }
    }
    drawn
}

/// Cards of the distractors; all their categories differ from each other and from those of the cast.
fn others(distractors: &Distractors, cast: &[&'static ObjectCard], rng: &mut impl Rng) -> Vec<&'static ObjectCard> {
    let count = rng.random_range(0..=distractors.most);
    let mut drawn: Vec<&'static ObjectCard> = Vec::new();
    for _ in 0..count {
        let is_free = |card: &&ObjectCard| cast.iter().chain(&drawn).all(|other| other.category != card.category);
        let free: Vec<_> = distractors.objects.iter().filter_map(card).filter(is_free).collect();
        drawn.extend(free.choose(rng));
    }
    drawn
}

/// Seed of a run whose attempts make the layouts.
pub(super) fn layout_seed(file: &DistributionsFile) -> Seed {
    file.seed.fork("layouts")
}
