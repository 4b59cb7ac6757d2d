//! Commands of a parsed instruction, with their noun phrases and places as words.

use genmanip_core::Relation;

use super::change::{Action, Part};

/// One request, or alternatives.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Command {
    /// Bring objects to a place, or to one of several.
    Put { subjects: Vec<Group>, places: Vec<Place> },
    /// Change the state of an object.
    Change { object: Group, part: Option<Part>, action: Action },
    /// Exactly one of these commands.
    Either(Vec<Command>),
    /// Stack objects, the lowest first; a single phrase for several objects leaves their order open.
    Tower(Vec<Group>),
    /// Not a request: an object is where its phrase says in the initial scene.
    Given(Group),
}

/// Number of objects that a noun phrase means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Number {
    /// One object.
    #[default]
    One,
    /// This many objects, all that fit the phrase.
    Many(usize),
    /// All objects that fit the phrase, at least two.
    All,
    /// Every one of this many objects, for each of which something else is stated; `None` for all that fit.
    Each(Option<usize>),
}

/// A noun phrase.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Group {
    /// Words of the phrase without the article.
    pub words: Vec<String>,
    /// Location of the object from a relative clause; `None` without one.
    pub at: Option<Box<Place>>,
    /// Number of objects meant.
    pub number: Number,
    /// Part of the object that is meant, such as the top drawer; `None` for the whole.
    pub part: Option<Part>,
}

impl Group {
    /// The phrase for one whole object without location.
    pub fn of(words: Vec<String>) -> Self {
        Self { words, at: None, number: Number::One, part: None }
    }
}

/// A place: a preposition with one noun phrase or, for `between`, two.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Place {
    /// Relations that the preposition can mean.
    pub relations: &'static [Relation],
    pub objects: Vec<Group>,
}

/// Result of parsing an instruction.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Parsed {
    /// Requests in the order of the sentence.
    pub commands: Vec<Command>,
    /// All clauses without a command, in lower case.
    pub context: String,
}
