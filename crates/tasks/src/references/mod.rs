//! Reads an instruction back: the referents of its phrases in a scene, and the goal that it states.
//!
//! The reader verifies what the designer writes and shares neither tables nor code with it. It uses the sentence, the
//! cards, the graph, and a grammar and lexicon of its own. A phrase is ambiguous if it fits several objects, or could
//! fit another one in some layout of the graph.
//!
//! ```
//! use genmanip_core::Task;
//! # fn example(task: &Task) {
//! if let Err(mismatch) = genmanip_tasks::references::check(task) {
//!     println!("{}: {mismatch}", task.instruction);
//! }
//! # }
//! ```

mod agreement;
mod change;
mod command;
mod grammar;
mod lexicon;
mod meaning;
mod mismatch;
mod necessity;
pub(crate) mod sentence;
mod space;
mod spoken;
#[cfg(test)]
mod tests;
mod words;

use std::collections::BTreeSet;
use std::sync::Arc;

use genmanip_core::{Atom, InstanceId, MAX_INTERCHANGEABLE, ObjectCard, ReferenceId, Relation, SceneGraph, Task};

pub use agreement::{disagreement, is_beyond_the_reader};
use command::Parsed;
use meaning::Interpreter;
use mismatch::in_words;
pub use mismatch::{Mismatch, ReadAtom};
pub use necessity::{Clue, clues_at_places, is_needless};

/// Meaning of an instruction in a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Noun phrases and the ids of their referents, in the order of the sentence.
    pub phrases: Vec<(String, Vec<InstanceId>)>,
    /// Ids of the identical copies that a phrase fits, one entry per such phrase; the goal names the first of each.
    pub choices: Vec<Vec<InstanceId>>,
    /// Goal in disjunctive normal form: alternatives of conditions that must all hold.
    pub goal: Vec<Vec<ReadAtom>>,
}

/// Reads an instruction in a scene. `cards` are those of the graph's nodes, in the same order.
///
/// A phrase that fits several identical copies is not ambiguous: it does not specify one of them.
///
/// # Errors
/// [`Mismatch`] if the instruction is outside the grammar, or a phrase has no referent or several.
pub fn read(instruction: &str, cards: &[Arc<ObjectCard>], graph: &SceneGraph) -> Result<Reading, Mismatch> {
    let mut mismatch = None;
    for parsed in grammar::readings(instruction) {
        match understand(&parsed, cards, graph) {
            Ok(reading) => return Ok(reading),
            Err(error) => mismatch = mismatch.or(Some(error)),
        }
    }
    Err(mismatch.unwrap_or_else(|| Mismatch::Unreadable { phrase: instruction.to_owned() }))
}

/// Resolves a parsed instruction in a scene.
fn understand(parsed: &Parsed, cards: &[Arc<ObjectCard>], graph: &SceneGraph) -> Result<Reading, Mismatch> {
    let mut interpreter = Interpreter::new(cards, graph, &parsed.context);
    let goal = interpreter.goal(&parsed.commands)?;
    let (phrases, choices) = interpreter.into_phrases();
    Ok(Reading { phrases, choices, goal })
}

/// Groups of identical copies that are interchangeable in a task's goal, because the instruction does not distinguish
/// them.
///
/// A copy that the sentence singles out by a relation or otherwise is in no group. If the sentence cannot be read,
/// there are no groups and the ids of the goal count.
pub fn interchangeable(task: &Task) -> Vec<Vec<InstanceId>> {
    let nodes = &task.scene_graph.nodes;
    let is_copied = |index: usize| nodes[..index].iter().any(|other| other.asset == nodes[index].asset);
    if !(0..nodes.len()).any(is_copied) {
        return Vec::new();
    }
    read(&task.instruction, &task.objects, &task.scene_graph).map_or_else(|_| Vec::new(), |reading| open(&reading))
}

/// The groups of copies of a reading among which no other phrase of the sentence distinguishes.
fn open(reading: &Reading) -> Vec<Vec<InstanceId>> {
    let mut groups: Vec<Vec<InstanceId>> = Vec::new();
    for choice in &reading.choices {
        if !groups.contains(choice) {
            groups.push(choice.clone());
        }
    }
    let singled_out = |id: &InstanceId| reading.phrases.iter().any(|(_, meant)| *meant == [id.clone()]);
    let shared =
        |group: &Vec<InstanceId>, id: &InstanceId| groups.iter().any(|other| other != group && other.contains(id));
    let stays = |group: &&Vec<InstanceId>| {
        group.len() <= MAX_INTERCHANGEABLE && !group.iter().any(|id| singled_out(id) || shared(group, id))
    };
    groups.iter().filter(stays).cloned().collect()
}

/// Ids of the objects and surfaces to which an instruction for this task has to refer.
pub fn intended(task: &Task) -> Vec<ReferenceId> {
    let ids: BTreeSet<&ReferenceId> = task.goal.alternatives.iter().flatten().flat_map(Atom::ids).collect();
    ids.into_iter().cloned().collect()
}

/// Number of [`intended`] objects to which the instruction refers uniquely; at least one less than all if it states
/// another goal.
pub fn resolved(task: &Task) -> usize {
    let intended = intended(task);
    match read(&task.instruction, &task.objects, &task.scene_graph) {
        Err(_) => 0,
        Ok(_) if check(task).is_ok() => intended.len(),
        Ok(reading) => {
            let meant: BTreeSet<&InstanceId> = reading.phrases.iter().flat_map(|(_, ids)| ids).collect();
            // All phrases resolve, but the goal differs: at least one object must not count.
            let found = intended.iter().filter(|id| meant.iter().any(|known| **known == **id)).count();
            found.min(intended.len().saturating_sub(1))
        }
    }
}

/// Checks that the instruction, read in the task's scene, states exactly the task's goal.
///
/// # Errors
/// The first [`Mismatch`].
pub fn check(task: &Task) -> Result<(), Mismatch> {
    check_said(task, &task.instruction)
}

/// Checks that any sentence, read in the task's scene, states exactly the task's goal.
///
/// # Errors
/// The first [`Mismatch`].
pub fn check_said(task: &Task, instruction: &str) -> Result<(), Mismatch> {
    check_goal(task, &read(instruction, &task.objects, &task.scene_graph)?)
}

/// Checks that a reading is exactly the task's goal.
fn check_goal(task: &Task, reading: &Reading) -> Result<(), Mismatch> {
    let groups = open(reading);
    let meant = &task.goal.alternatives;
    let same = |read: &Vec<ReadAtom>, meant: &Vec<Atom>| {
        read.len() == meant.len() && meant.iter().all(|atom| read.iter().any(|read| says(read, atom, &groups)))
    };
    let covered = |read: &[Vec<ReadAtom>]| meant.iter().all(|meant| read.iter().any(|read| same(read, meant)));
    if reading.goal.len() == meant.len() && covered(&reading.goal) {
        return Ok(());
    }
    Err(Mismatch::OtherGoal { read: in_words(&reading.goal), meant: in_words(meant) })
}

/// True if the condition that was read is the intended one, up to exchange of copies within a group.
fn says(read: &ReadAtom, meant: &Atom, groups: &[Vec<InstanceId>]) -> bool {
    resembles(read, meant, groups, |said, meant| said == meant)
}

/// Like [`says`], with relations compared by `fits(said, meant)`.
fn resembles(read: &ReadAtom, meant: &Atom, groups: &[Vec<InstanceId>], fits: fn(Relation, Relation) -> bool) -> bool {
    let any = |id: &ReferenceId| -> ReferenceId {
        let group = groups.iter().find(|group| group.iter().any(|copy| copy == id));
        group.and_then(|group| group.first()).map_or(id, |first| first).clone()
    };
    match (read, meant) {
        (
            ReadAtom::Place { subject, relations, references },
            Atom::Relation { subject: meant, relation, reference, second_reference },
        ) => {
            let ends: BTreeSet<ReferenceId> = std::iter::once(reference).chain(second_reference).map(any).collect();
            any(subject) == any(meant)
                && relations.iter().any(|said| fits(*said, *relation))
                && references.iter().map(any).collect::<BTreeSet<_>>() == ends
        }
        (ReadAtom::State { object, state }, Atom::State { object: meant, state: wanted }) => {
            any(object) == any(meant) && state == wanted
        }
        _ => false,
    }
}
