//! Words and phrases of requests besides their verbs.

use super::super::change::Part;

/// Phrases before the object of a wish.
pub(super) const WISHES: [&str; 46] = [
    "could i get",
    "can i get",
    "may i get",
    "i want",
    "i want for",
    "i would like for",
    "i would like",
    "i would love",
    "i would prefer",
    "i need",
    "we need",
    "we want",
    "i would rather have",
    "make sure that",
    "make sure",
    "ensure that",
    "ensure",
    "see to it that",
    "see that",
    "check that",
    "let",
    "have",
    "get",
    "i wish",
    "can i have",
    "could i have",
    "may i have",
    "can we have",
    "could we have",
    "could",
    "can",
    "would",
    "may",
    "might",
    "there should be",
    "there must be",
    "there needs to be",
    "there has to be",
    "there ought to be",
    "i want there to be",
    "i would like there to be",
    "make sure that there is",
    "make sure there is",
    "make sure there are",
    "ensure there is",
    "there should end up being",
];
/// Words between an object and where or how it should be.
pub(super) const COPULAS: [&str; 51] = [
    "should", "must", "shall", "ought", "to", "needs", "need", "has", "have", "will", "can", "could", "would", "may",
    "be", "being", "is", "are", "supposed", "meant", "going", "go", "goes", "end", "ends", "up", "stand", "stands",
    "standing", "lie", "lies", "lying", "sit", "sits", "sitting", "stay", "rest", "rests", "live", "lives", "belong",
    "belongs", "hang", "hangs", "come", "comes", "all", "both", "now", "also", "wants",
];
/// Words without which a phrase with a place states a fact.
pub(super) const DUTIES: [&str; 22] = [
    "should", "must", "shall", "ought", "needs", "need", "to", "go", "goes", "belongs", "belong", "can", "could",
    "would", "wants", "has", "have", "will", "comes", "lives", "supposed", "may",
];
/// Particles of a change of state.
pub(super) const PARTICLES: [&str; 11] =
    ["wide open", "open", "shut", "closed", "on", "off", "out", "up", "down", "in", "to off"];
/// Levels of a knob or a switch.
pub(super) const LEVELS: [(&str, &str); 14] = [
    ("on", "on"),
    ("off", "off"),
    ("high", "high"),
    ("full", "high"),
    ("full power", "high"),
    ("full blast", "high"),
    ("max", "high"),
    ("maximum", "high"),
    ("the maximum", "high"),
    ("the highest setting", "high"),
    ("low", "low"),
    ("minimum", "low"),
    ("the minimum", "low"),
    ("the lowest setting", "low"),
];
pub(super) const PARTS: [(&str, Part); 16] = [
    ("top drawer", Part::Upper),
    ("topmost drawer", Part::Upper),
    ("upper drawer", Part::Upper),
    ("bottom drawer", Part::Lower),
    ("bottommost drawer", Part::Lower),
    ("lower drawer", Part::Lower),
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
pub(super) const ARTICLES: [&str; 15] =
    ["the", "a", "an", "some", "my", "your", "our", "this", "any", "her", "his", "their", "that", "these", "those"];
/// Words that end a clause.
const BOUNDARIES: [&str; 16] = [
    "and",
    "then",
    "so",
    "but",
    "because",
    "since",
    "for",
    "afterwards",
    "first",
    "would",
    "could",
    "will",
    "now",
    "as",
    "too",
    "plus",
];

/// True for punctuation that separates clauses.
pub(super) fn is_mark(word: &str) -> bool {
    matches!(word, "," | "." | ";")
}

/// True for a word that ends a clause.
pub(super) fn is_boundary(word: &str) -> bool {
    BOUNDARIES.contains(&word)
}
