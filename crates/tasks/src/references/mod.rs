//! Reads an instruction back: what each of its phrases can mean in a scene, and what it asks for.
//!
//! This is the listener to the designer's speaker. It knows the sentence, the cards and the graph, has a lexicon
//! and a grammar of its own and concludes for itself what is where; with the designer it shares no table and no code.
//! A phrase that fits several objects, or might fit another one in some layout of the graph, is ambiguous.
//!
//! ```
//! use genmanip_core::Task;
//! # fn example(task: &Task) {
//! if let Err(mismatch) = genmanip_tasks::references::check(task) {
//!     println!("{}: {mismatch}", task.instruction);
//! }
//! # }
//! ```

mod grammar;
mod lexicon;
mod meaning;
mod necessity;
mod space;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::sync::Arc;

use genmanip_core::{Atom, MAX_INTERCHANGEABLE, ObjectCard, Relation, SceneGraph, Task};

use grammar::Heard;
use meaning::Listener;
pub use necessity::{Clue, clues_at_places, is_needless};

/// What an instruction asks for.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Noun phrases and the ids they mean, in the order of the sentence.
    pub phrases: Vec<(String, Vec<String>)>,
    /// Ids of identical copies of which a phrase means any; in the goal the first stands for them.
    pub choices: Vec<Vec<String>>,
    /// Alternatives of conditions.
    pub goal: Vec<Vec<ReadAtom>>,
}

/// A condition as a sentence states it.
#[derive(Clone, Debug, PartialEq)]
pub enum ReadAtom {
    /// An object is somewhere.
    Place {
        /// Id of the object.
        subject: String,
        /// Relations that the words allow; any of them is what was said.
        relations: Vec<Relation>,
        /// Ids of one reference, or of two for `between`.
        references: Vec<String>,
    },
    /// An object is in a state.
    State {
        /// Id of the object.
        object: String,
        /// Name of the state.
        state: String,
    },
}

/// Why an instruction does not say what a task means.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Mismatch {
    /// The sentence is outside of the grammar or of the lexicon.
    #[error("not understood: `{phrase}`")]
    Unreadable {
        /// The part that was not understood.
        phrase: String,
    },
    /// Nothing in the scene fits a phrase.
    #[error("nothing is `{phrase}`")]
    Nothing {
        /// The phrase.
        phrase: String,
    },
    /// Several things fit a phrase.
    #[error("`{phrase}` may be any of {ids:?}")]
    Ambiguous {
        /// The phrase.
        phrase: String,
        /// Ids that fit.
        ids: Vec<String>,
    },
    /// Everything is understood, but it is not the task's goal.
    #[error("asks for {read}, meant is {meant}")]
    OtherGoal {
        /// What was read.
        read: String,
        /// The task's goal.
        meant: String,
    },
}

impl Mismatch {
    /// The reason without its particulars, for counting.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::Unreadable { .. } => "not understood",
            Self::Nothing { .. } => "a phrase that fits nothing",
            Self::Ambiguous { .. } => "an ambiguous phrase",
            Self::OtherGoal { .. } => "another goal",
        }
    }
}

/// Reads an instruction in a scene; the cards are those of the graph's nodes, in their order.
///
/// Identical copies that a phrase does not tell apart are no ambiguity: it means any of them.
///
/// # Errors
/// [`Mismatch`] when it is not understood, or a phrase has no referent or several.
pub fn read(instruction: &str, cards: &[Arc<ObjectCard>], graph: &SceneGraph) -> Result<Reading, Mismatch> {
    let unreadable = || Mismatch::Unreadable { phrase: instruction.to_owned() };
    understand(&grammar::read(instruction).ok_or_else(unreadable)?, cards, graph)
}

/// What commands that were heard mean in a scene.
fn understand(heard: &Heard, cards: &[Arc<ObjectCard>], graph: &SceneGraph) -> Result<Reading, Mismatch> {
    let mut listener = Listener::new(cards, graph, &heard.context);
    let goal = listener.goal(&heard.commands)?;
    let (phrases, choices) = listener.into_phrases();
    Ok(Reading { phrases, choices, goal })
}

/// Groups of copies that stand for each other in a task's goal: those that the instruction leaves open.
///
/// What the sentence singles out by a relation, or any other way, is in no group, and so is everything when the
/// sentence is not understood: then the ids of the goal count.
pub fn interchangeable(task: &Task) -> Vec<Vec<String>> {
    let nodes = &task.scene_graph.nodes;
    let is_copied = |index: usize| nodes[..index].iter().any(|other| other.asset == nodes[index].asset);
    if !(0..nodes.len()).any(is_copied) {
        return Vec::new();
    }
    read(&task.instruction, &task.objects, &task.scene_graph).map_or_else(|_| Vec::new(), |reading| open(&reading))
}

/// The choices of a reading that nothing else in the sentence contradicts.
fn open(reading: &Reading) -> Vec<Vec<String>> {
    let mut groups: Vec<Vec<String>> = Vec::new();
    for choice in &reading.choices {
        if !groups.contains(choice) {
            groups.push(choice.clone());
        }
    }
    let singled_out = |id: &String| reading.phrases.iter().any(|(_, meant)| *meant == [id.clone()]);
    let shared = |group: &Vec<String>, id: &String| groups.iter().any(|other| other != group && other.contains(id));
    let stays = |group: &&Vec<String>| {
        group.len() <= MAX_INTERCHANGEABLE && !group.iter().any(|id| singled_out(id) || shared(group, id))
    };
    groups.iter().filter(stays).cloned().collect()
}

/// Ids of the objects that an instruction for this task has to refer to.
pub fn intended(task: &Task) -> Vec<String> {
    let mut ids = BTreeSet::new();
    for atom in task.goal.alternatives.iter().flatten() {
        ids.extend(atom.ids().map(String::from));
    }
    ids.into_iter().collect()
}

/// How many of the intended objects the instruction refers to, each by a phrase that means this object alone.
pub fn resolved(task: &Task) -> usize {
    let intended = intended(task);
    match read(&task.instruction, &task.objects, &task.scene_graph) {
        Err(_) => 0,
        Ok(_) if check(task).is_ok() => intended.len(),
        Ok(reading) => {
            let meant: BTreeSet<&String> = reading.phrases.iter().flat_map(|(_, ids)| ids).collect();
            // Found, but in another role: somebody is mistaken for somebody else.
            let found = intended.iter().filter(|id| meant.contains(id)).count();
            found.min(intended.len().saturating_sub(1))
        }
    }
}

/// Checks that the instruction, read in the task's scene, asks for exactly the task's goal.
///
/// # Errors
/// The first [`Mismatch`].
pub fn check(task: &Task) -> Result<(), Mismatch> {
    check_said(task, &task.instruction)
}

/// Checks that a sentence, read in the task's scene, asks for exactly the task's goal, as its instruction has to.
///
/// # Errors
/// The first [`Mismatch`].
pub fn check_said(task: &Task, instruction: &str) -> Result<(), Mismatch> {
    is_goal_of(task, &read(instruction, &task.objects, &task.scene_graph)?)
}

/// Whether what was read is exactly the task's goal.
fn is_goal_of(task: &Task, reading: &Reading) -> Result<(), Mismatch> {
    let groups = open(reading);
    let meant = &task.goal.alternatives;
    let same = |read: &Vec<ReadAtom>, meant: &Vec<Atom>| {
        read.len() == meant.len() && meant.iter().all(|atom| read.iter().any(|read| says(read, atom, &groups)))
    };
    let covered = |read: &[Vec<ReadAtom>]| meant.iter().all(|meant| read.iter().any(|read| same(read, meant)));
    if reading.goal.len() == meant.len() && covered(&reading.goal) {
        return Ok(());
    }
    Err(Mismatch::OtherGoal { read: format!("{:?}", reading.goal), meant: format!("{meant:?}") })
}

/// Whether a condition that was read is the one that is meant, whichever copies of a group they name.
fn says(read: &ReadAtom, meant: &Atom, groups: &[Vec<String>]) -> bool {
    let any = |id: &'_ String| -> String {
        let group = groups.iter().find(|group| group.contains(id));
        group.and_then(|group| group.first()).unwrap_or(id).clone()
    };
    match (read, meant) {
        (
            ReadAtom::Place { subject, relations, references },
            Atom::Relation { subject: meant, relation, reference, second_reference },
        ) => {
            let ends: BTreeSet<String> = std::iter::once(reference).chain(second_reference).map(any).collect();
            any(subject) == any(meant)
                && relations.contains(relation)
                && references.iter().map(any).collect::<BTreeSet<_>>() == ends
        }
        (ReadAtom::State { object, state }, Atom::State { object: meant, state: wanted }) => {
            any(object) == any(meant) && state == wanted
        }
        _ => false,
    }
}
