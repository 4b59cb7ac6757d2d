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
    /// Bring two objects to the left and the right of another one, in any order; a single one to either side.
    Sides { subjects: Vec<Group>, of: Group },
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
    /// Objects that the phrase would fit, but that are not meant: `all the fruit except the banana`.
    pub except: Vec<Group>,
}

impl Group {
    /// The phrase for one whole object without location.
    pub fn of(words: Vec<String>) -> Self {
        Self { words, at: None, number: Number::One, part: None, except: Vec::new() }
    }
}

/// A place: a preposition with one noun phrase or, for `between`, two; without one, the table itself.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Place {
    /// Relations that the preposition can mean.
    pub relations: &'static [Relation],
    pub objects: Vec<Group>,
}

/// Id and name of the table, the first surface of every world.
pub(crate) const TABLE: &str = "table";

impl Place {
    /// The table, on nothing else.
    pub fn table() -> Self {
        Self { relations: &[Relation::On], objects: Vec::new() }
    }
}

/// Result of parsing an instruction.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Parsed {
    /// Requests in the order of the sentence.
    pub commands: Vec<Command>,
    /// All clauses without a command, in lower case.
    pub context: String,
}
