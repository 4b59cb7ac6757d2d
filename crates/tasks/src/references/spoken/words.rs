//! Vocabulary of requests, from `data/references/spoken.json`.

use std::sync::LazyLock;

use serde::Deserialize;

use super::super::change::Part;

#[allow(clippy::expect_used)]
static VOCABULARY: LazyLock<Vocabulary> = LazyLock::new(|| {
    serde_json::from_str(include_str!("../../../data/references/spoken.json")).expect("valid; a test reads it")
});

type Words = Vec<&'static str>;
type Pairs = Vec<(&'static str, &'static str)>;

/// Words and phrases of requests, in lower case and plain form.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, bound(deserialize = "'de: 'static"))]
pub(super) struct Vocabulary {
    /// Contractions and their full forms.
    pub contractions: Pairs,
    /// Words and phrases with their plain form, of which the longest counts; `this|that` is either word, and an empty form
    /// a courtesy or a filler.
    pub phrases: Pairs,
    /// Spelling variants and other words for the same.
    pub spellings: Pairs,
    /// Words after which `'s` behind a noun is `is`.
    pub predicates: Words,
    /// Numbers of a phrase in figures.
    pub figures: Pairs,
    /// Words in `ly` that are no adverbs of manner.
    pub no_adverbs: Words,
    /// Words and phrases between clauses that carry no meaning of their own.
    pub courtesies: Words,
    /// Titles of what follows a colon: `task: …`.
    pub labels: Words,
    /// Words before the verb or the wish of a request: `would it be possible to …`.
    pub polite: Words,
    /// Words of `polite` after which a wish follows: an object and where or how it should be.
    pub desires: Words,
    /// Words of which one makes a wish after words of politeness a request.
    pub wanting: Words,
    /// Words of politeness after which only a duty is a request: `I think the mug should …`.
    pub weak: Words,
    /// Words of `polite` after which a verb states a fact: `I put …`.
    pub stative: Words,
    /// Words that make a question with another verb a request: `is it possible …`.
    pub enabling: Words,
    /// Verbs of reported requests: `mum says …`.
    pub reporting: Words,
    /// First words of a clause that gives a reason, a purpose or a circumstance.
    pub subordinate: Words,
    /// First words of a clause that gives a reason or a purpose, whatever it says.
    pub reasons: Words,
    /// Words that make a statement a request.
    pub obligations: Words,
    /// First words of questions.
    pub questions: Words,
    /// First words of a clause that forbids something.
    pub prohibitions: Words,
    /// Words besides articles and numbers that begin a noun phrase.
    pub quantifiers: Words,
    /// Phrases that mean objects named before.
    pub pronouns: Words,
    /// First words of a relative clause with a location.
    pub relatives: Words,
    /// Further words of a relative clause before its location.
    pub relative_words: Words,
    /// Words that end a noun phrase.
    pub noun_ends: Words,
    /// Words that end a noun phrase before a preposition only.
    pub hedges: Words,
    /// Particles that end a clause with a change of state.
    pub particles: Words,
    /// Words and phrases before a place that do not change it.
    pub modifiers: Words,
    /// Beginnings of a clause that says where something is in the end: `so that …`.
    pub results: Words,
    /// Places of two objects relative to each other.
    pub mutual: Words,
    /// Places to the left and the right of an object.
    pub either_side: Words,
    /// Phrases for objects that a list names later: `the following: …`.
    pub lists: Words,
    /// Verbs that bring an object to the bin.
    pub discard: Words,
    /// Verbs of which each makes two objects change places.
    pub swap: Words,
    /// Verbs that free an object from where it is, after which it stands on the table.
    pub free: Words,
    /// Prepositions without a relation in goals.
    pub unknown: Words,
    /// Words for the table itself.
    pub tables: Words,
    /// Words for a place on the table from which something is taken.
    pub spots: Words,
    /// Verbs that bring an object to a place.
    pub carry: Words,
    /// Verbs that take up an object; where it goes follows in the same or another clause.
    pub take: Words,
    /// Verbs that change the state of an object.
    pub state: Words,
    /// Verbs that stack several objects.
    pub build: Words,
    /// Verbs whose object is the place: `fill the basket with …`.
    pub fill: Words,
    /// Forms of verbs that follow no rule.
    pub irregular: Pairs,
    /// Phrases before the object of a wish.
    pub wishes: Words,
    /// Words between an object and where or how it should be.
    pub copulas: Words,
    /// Words without which a phrase with a place states a fact.
    pub duties: Words,
    /// Words between an object and where it is.
    pub being: Words,
    /// Beginnings of a request that repeats the one before for another object.
    pub repeats: Words,
    /// Words after an object for which the request before is repeated.
    pub likewise: Words,
    /// Particles of a change of state.
    pub state_particles: Words,
    /// Levels of a knob or a switch, in the words of the table of actions.
    pub levels: Pairs,
    /// Words after an object that is to be left alone: `keep the bowl where it is`.
    pub stays: Words,
    /// Names of the robot and its parts in sentences about it.
    pub robots: Words,
    /// Words between the robot and the verb of what it is to do.
    pub robot_modals: Words,
    /// Articles and possessive pronouns.
    pub articles: Words,
    /// Words that end a clause.
    pub boundaries: Words,
}

pub(super) fn vocabulary() -> &'static Vocabulary {
    &VOCABULARY
}

/// Parts of objects by name.
pub(super) const PARTS: [(&str, Part); 17] = [
    ("top drawer", Part::Upper),
    ("topmost drawer", Part::Upper),
    ("upper drawer", Part::Upper),
    ("bottom drawer", Part::Lower),
    ("bottommost drawer", Part::Lower),
    ("lower drawer", Part::Lower),
    ("drawer", Part::Any),
    ("drawers", Part::Both),
    ("two drawers", Part::Both),
    ("door", Part::Other),
    ("lid", Part::Other),
    ("cover", Part::Other),
    ("flap", Part::Other),
    ("screen", Part::Other),
    ("display", Part::Other),
    ("handle", Part::Other),
    ("front", Part::Other),
];

/// True for punctuation that separates clauses.
pub(super) fn is_mark(word: &str) -> bool {
    matches!(word, "," | "." | ";")
}

/// True for a word that ends a clause.
pub(super) fn is_boundary(word: &str) -> bool {
    vocabulary().boundaries.contains(&word)
}
