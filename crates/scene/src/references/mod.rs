//! Reads an instruction back: what each of its phrases can mean in a scene, and what it asks for.
//!
//! This is the listener to the designer's speaker. It knows the sentence, the cards and the graph, has a lexicon
//! and a grammar of its own and concludes for itself what is where; with the designer it shares no table and no code.
//! A phrase that fits several objects, or might fit another one in some layout of the graph, is ambiguous.
//!
//! ```
//! use genmanip_core::Task;
//! # fn example(task: &Task) {
//! if let Err(mismatch) = genmanip_scene::references::check(task) {
//!     println!("{}: {mismatch}", task.instruction);
//! }
//! # }
//! ```

mod grammar;
mod lexicon;
mod meaning;
mod space;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;

use genmanip_core::{Atom, ObjectCard, Relation, SceneGraph, Task};

use meaning::Listener;

/// What an instruction asks for.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Noun phrases and the uids they mean, in the order of the sentence.
    pub phrases: Vec<(String, Vec<String>)>,
    /// Alternatives of conditions.
    pub goal: Vec<Vec<ReadAtom>>,
}

/// A condition as a sentence states it.
#[derive(Clone, Debug, PartialEq)]
pub enum ReadAtom {
    /// An object is somewhere.
    Place {
        /// Uid of the object.
        subject: String,
        /// Relations that the words allow; any of them is what was said.
        relations: Vec<Relation>,
        /// Uids of one reference, or of two for `between`.
        references: Vec<String>,
    },
    /// An object is in a state.
    State {
        /// Uid of the object.
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
    #[error("`{phrase}` may be any of {uids:?}")]
    Ambiguous {
        /// The phrase.
        phrase: String,
        /// Uids that fit.
        uids: Vec<String>,
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

/// Reads an instruction in a scene.
///
/// # Errors
/// [`Mismatch`] when it is not understood, or a phrase has no referent or several.
pub fn read(instruction: &str, cards: &[ObjectCard], graph: &SceneGraph) -> Result<Reading, Mismatch> {
    let unreadable = || Mismatch::Unreadable { phrase: instruction.to_owned() };
    let commands = grammar::read(instruction).ok_or_else(unreadable)?;
    let mut listener = Listener::new(cards, graph);
    let goal = listener.goal(&commands)?;
    Ok(Reading { phrases: listener.into_phrases(), goal })
}

/// Uids of the objects that an instruction for this task has to refer to.
pub fn intended(task: &Task) -> Vec<String> {
    let mut uids = BTreeSet::new();
    for atom in task.goal.alternatives.iter().flatten() {
        match atom {
            Atom::Relation { subject, reference, second_reference, .. } => {
                uids.extend([subject, reference].into_iter().chain(second_reference).cloned());
            }
            Atom::State { object, .. } => {
                uids.insert(object.clone());
            }
        }
    }
    uids.into_iter().collect()
}

/// How many of the intended objects the instruction refers to, each by a phrase that means this object alone.
pub fn resolved(task: &Task) -> usize {
    let intended = intended(task);
    match read(&task.instruction, &task.objects, &task.scene_graph) {
        Err(_) => 0,
        Ok(_) if check(task).is_ok() => intended.len(),
        Ok(reading) => {
            let meant: BTreeSet<&String> = reading.phrases.iter().flat_map(|(_, uids)| uids).collect();
            // Found, but in another role: somebody is mistaken for somebody else.
            let found = intended.iter().filter(|uid| meant.contains(uid)).count();
            found.min(intended.len().saturating_sub(1))
        }
    }
}

/// Checks that the instruction, read in the task's scene, asks for exactly the task's goal.
///
/// # Errors
/// The first [`Mismatch`].
pub fn check(task: &Task) -> Result<(), Mismatch> {
    let reading = read(&task.instruction, &task.objects, &task.scene_graph)?;
    let meant = &task.goal.alternatives;
    let same = |read: &Vec<ReadAtom>, meant: &Vec<Atom>| {
        read.len() == meant.len() && meant.iter().all(|atom| read.iter().any(|read| says(read, atom)))
    };
    let covered = |read: &[Vec<ReadAtom>]| meant.iter().all(|meant| read.iter().any(|read| same(read, meant)));
    if reading.goal.len() == meant.len() && covered(&reading.goal) {
        return Ok(());
    }
    Err(Mismatch::OtherGoal { read: format!("{:?}", reading.goal), meant: format!("{meant:?}") })
}

fn says(read: &ReadAtom, meant: &Atom) -> bool {
    match (read, meant) {
        (
            ReadAtom::Place { subject, relations, references },
            Atom::Relation { subject: meant, relation, reference, second_reference },
        ) => {
            let ends: BTreeSet<&String> = std::iter::once(reference).chain(second_reference).collect();
            subject == meant && relations.contains(relation) && references.iter().collect::<BTreeSet<_>>() == ends
        }
        (ReadAtom::State { object, state }, Atom::State { object: meant, state: wanted }) => {
            object == meant && state == wanted
        }
        _ => false,
    }
}
