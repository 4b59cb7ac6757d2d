//! Conditions as stated by an instruction, and reasons why an instruction does not state the goal of its task.

use std::fmt;

use genmanip_core::{InstanceId, ReferenceId, Relation};

/// A condition as stated by a sentence.
#[derive(Clone, Debug, PartialEq)]
pub enum ReadAtom {
    /// An object stands in a relation to others.
    Place {
        /// Id of the object.
        subject: InstanceId,
        /// Relations that the preposition can mean.
        relations: Vec<Relation>,
        /// Ids of one reference, or of two for `between`.
        references: Vec<ReferenceId>,
    },
    /// An object is in a state.
    State {
        /// Id of the object.
        object: InstanceId,
        /// Name of the state.
        state: String,
    },
}

impl fmt::Display for ReadAtom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Place { subject, relations, references } => {
                let relations: Vec<&str> = relations.iter().map(|relation| relation.name()).collect();
                let references: Vec<&str> = references.iter().map(ReferenceId::as_str).collect();
                write!(f, "{subject} {} {}", relations.join("|"), references.join(" and "))
            }
            Self::State { object, state } => write!(f, "{object} is {state}"),
        }
    }
}

/// A goal in words: conditions of an alternative joined by "and", alternatives by "or".
pub(super) fn in_words<C: fmt::Display>(alternatives: &[Vec<C>]) -> String {
    let joined = |conditions: &Vec<C>| conditions.iter().map(C::to_string).collect::<Vec<_>>().join(" and ");
    alternatives.iter().map(joined).collect::<Vec<_>>().join(", or ")
}

/// Reason why an instruction does not state the goal of its task.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Mismatch {
    /// The sentence is outside the grammar or the lexicon.
    #[error("not understood: `{phrase}`")]
    Unreadable {
        /// Part of the sentence that was not parsed.
        phrase: String,
    },
    /// A phrase fits no object of the scene.
    #[error("nothing is `{phrase}`")]
    Nothing {
        /// The phrase without a referent.
        phrase: String,
    },
    /// A phrase fits several objects.
    #[error("`{phrase}` may be any of {ids:?}")]
    Ambiguous {
        /// The ambiguous phrase.
        phrase: String,
        /// Ids of the objects that fit.
        ids: Vec<InstanceId>,
    },
    /// The sentence states another goal than the task's.
    #[error("asks for {read}, meant is {meant}")]
    OtherGoal {
        /// The goal that the sentence states, in words.
        read: String,
        /// The task's goal, in words.
        meant: String,
    },
}

impl Mismatch {
    /// The kind of mismatch without particulars, for counting.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::Unreadable { .. } => "not understood",
            Self::Nothing { .. } => "a phrase that fits nothing",
            Self::Ambiguous { .. } => "an ambiguous phrase",
            Self::OtherGoal { .. } => "another goal",
        }
    }
}
