//! Words and phrases of the grammar. The designer has tables of its own, so that the reader checks it.

use genmanip_core::Relation;

use Relation::{Back, Between, Front, In, Left, Near, On, Right, Top};

/// Prepositions, longer ones first. The designer has a table of its own, so that the reader checks it.
pub(super) const PLACES: [(&str, &[Relation]); 76] = [
    ("on the top of", &[On, Top]),
    ("over by", &[Near]),
    ("over next to", &[Near]),
    ("close by", &[Near]),
    ("nearer to", &[Near]),
    ("nearer", &[Near]),
    ("along side", &[Near]),
    ("along side of", &[Near]),
    ("alongside of", &[Near]),
    ("side by side with", &[Near]),
    ("next door to", &[Near]),
    ("in the neighbourhood of", &[Near]),
    ("beside to", &[Near]),
    ("to the front of", &[Front]),
    ("ahead of", &[Front]),
    ("to the rear of", &[Back]),
    ("in the rear of", &[Back]),
    ("to the back of", &[Back]),
    ("in behind", &[Back]),
    ("on to the top of", &[On, Top]),
    ("up against", &[Near]),
    ("against", &[Near]),
    ("beside of", &[Near]),
    ("nearby", &[Near]),
    ("at the side of", &[Near]),
    ("by the side of", &[Near]),
    ("to the side of", &[Near]),
    ("in the vicinity of", &[Near]),
    ("in back of", &[Back]),
    ("on the near side of", &[Back]),
    ("within", &[In, Top]),
    ("down into", &[In, Top]),
    ("down onto", &[On, Top]),
    ("on the far side of", &[Front]),
    ("on the robot's side of", &[Back]),
    ("to the robot's left of", &[Left]),
    ("to the robot's right of", &[Right]),
    // The camera faces the robot.
    ("on the camera's side of", &[Front]),
    ("to the camera's left of", &[Right]),
    ("to the camera's right of", &[Left]),
    // Without a point of view, directions are the robot's, like the names of the relations.
    ("to the left of", &[Left]),
    ("to the right of", &[Right]),
    ("on the left side of", &[Left]),
    ("on the right side of", &[Right]),
    ("to the left side of", &[Left]),
    ("on the left hand side of", &[Left]),
    ("on the right hand side of", &[Right]),
    ("to the right side of", &[Right]),
    ("on the left of", &[Left]),
    ("on the right of", &[Right]),
    ("left of", &[Left]),
    ("right of", &[Right]),
    ("in front of", &[Front]),
    ("behind", &[Back]),
    ("on top of", &[On, Top]),
    ("atop", &[On, Top]),
    ("upon", &[On, Top]),
    ("right next to", &[Near]),
    ("just next to", &[Near]),
    ("next to", &[Near]),
    ("closer to", &[Near]),
    ("close to", &[Near]),
    ("adjacent to", &[Near]),
    ("alongside", &[Near]),
    ("beside", &[Near]),
    ("near", &[Near]),
    ("by", &[Near]),
    ("in between", &[Between]),
    ("between", &[Between]),
    ("inside of", &[In, Top]),
    ("inside", &[In, Top]),
    ("into", &[In, Top]),
    ("onto", &[On, Top]),
    ("in", &[In, Top]),
    ("on", &[On, Top]),
    ("to", &[In, On, Top]),
];

/// Prepositions that may also belong to a description or a verb: they introduce a location only before a determiner.
pub(super) const LOOSE: [&str; 4] = ["in", "on", "by", "to"];

/// Words that introduce the present location of an object that is to be moved.
pub(super) const SOURCES: [&str; 5] = ["from", "out of", "off of", "off", "away from"];

/// Initial relations to the reference that match a word of [`SOURCES`].
pub(super) const SOURCE: &[Relation] = &[In, On, Top];

/// Words that compare locations: `farthest from the robot` names no place.
pub(super) const EXTREMES: [&str; 3] = ["farthest", "nearest", "closest"];

/// Words after which `is` continues a noun phrase.
pub(super) const RELATIVES: [&str; 4] = ["that", "which", "what", "whatever"];

/// First words of noun phrases.
pub(super) const DETERMINERS: [&str; 18] = [
    "the",
    "a",
    "an",
    "some",
    "my",
    "your",
    "our",
    "this",
    "any",
    "what",
    "whatever",
    "something",
    "both",
    "another",
    "one",
    "her",
    "his",
    "their",
];
pub(super) const ARTICLES: [&str; 12] =
    ["the", "a", "an", "some", "my", "your", "our", "this", "any", "her", "his", "their"];
pub(super) const DEFINITE: [&str; 3] = ["the", "my", "this"];
pub(super) const TAKE: [&str; 11] =
    ["pick up", "pick", "take", "grab", "grasp", "find", "fetch", "get", "collect", "retrieve", "remove"];
pub(super) const PUT: [&str; 25] = [
    "throw", "toss", "pop", "stick", "pass", "push", "put", "get", "place", "set", "move", "stack", "bring", "lay",
    "drop", "position", "insert", "store", "transfer", "slide", "deposit", "leave", "carry", "arrange", "relocate",
];
/// Pronouns for the object named last.
pub(super) const PRONOUNS: [&str; 3] = ["it", "them", "that"];
/// Adverbs between a verb's object and its destination.
pub(super) const ADVERBS: [&str; 19] = [
    "so that it is",
    "so that it ends up",
    "so that it stands",
    "so that it lies",
    "so it is",
    "so it stands",
    "a bit",
    "together",
    "either",
    "both",
    "down",
    "up",
    ",",
    "back",
    "over",
    "away",
    "carefully",
    "gently",
    "directly",
];
/// Phrases that introduce a wish or an obligation, before or after the object.
pub(super) const WISHES: [&str; 13] = [
    "i want that",
    "i want",
    "i'd like",
    "i would like",
    "i need",
    "can i have",
    "could i have",
    "make sure that",
    "make sure",
    "ensure that",
    "ensure",
    "see that",
    "let",
];
pub(super) const SHOULD: [&str; 19] = [
    "to be",
    "to go",
    "should be",
    "should go",
    "should end up",
    "should stand",
    "should lie",
    "must be",
    "must go",
    "needs to be",
    "needs to go",
    "has to be",
    "has to go",
    "belongs",
    "goes",
    "be put",
    "be placed",
    "go",
    "lie",
];
pub(super) const STATE: [&str; 16] = [
    "open", "close", "shut", "pull", "push", "lift", "raise", "lower", "flip", "fold", "swing", "turn", "switch",
    "press", "set", "hit",
];
/// Spelling variants and the lexicon's word for each.
pub(super) const SPELLINGS: [(&str, &str); 7] = [
    ("gray", "grey"),
    ("donut", "doughnut"),
    ("donuts", "doughnuts"),
    ("jewelry", "jewellery"),
    ("yogurt", "yoghurt"),
    ("yoghourt", "yoghurt"),
    ("u", "you"),
];
pub(super) const PARTICLES: [&str; 17] = [
    "down to low",
    "up to high",
    "on low",
    "on high",
    "all the way up",
    "to low",
    "to high",
    "open",
    "shut",
    "on",
    "off",
    "out",
    "down",
    "up",
    "to off",
    "all the way down",
    "wide",
];
pub(super) const JOINERS: [&str; 37] = [
    "hey",
    "hi",
    "hello",
    "ok",
    "okay",
    "robot",
    "now",
    "i want you to",
    "i'd like you to",
    "i would like you to",
    "your task is to",
    "go ahead and",
    "would you",
    "you should",
    "kindly",
    "carefully",
    "gently",
    "afterwards",
    "next",
    "after that",
    "as well",
    "as you like",
    "either will do",
    "and then",
    "first",
    "finally",
    "please",
    "could you",
    "can you",
    "then",
    "also",
    "and",
    ",",
    ";",
    ":",
    "too",
    "help me",
];

/// Words that end a noun phrase.
pub(super) const ENDS: [&str; 18] = [
    ",",
    ";",
    "and",
    "or",
    "so",
    "together",
    "both",
    "either",
    "down",
    "carefully",
    "gently",
    "please",
    "pls",
    "thanks",
    "again",
    "too",
    "quickly",
    "then",
];

/// True if a word occurs in a table of the grammar.
pub(super) fn contains(word: &str) -> bool {
    let places = PLACES.iter().map(|(phrase, _)| *phrase);
    let lists: [&[&str]; 15] = [
        &SOURCES,
        &EXTREMES,
        &RELATIVES,
        &DETERMINERS,
        &ARTICLES,
        &DEFINITE,
        &TAKE,
        &PUT,
        &PRONOUNS,
        &ADVERBS,
        &WISHES,
        &SHOULD,
        &STATE,
        &PARTICLES,
        &JOINERS,
    ];
    let phrases = lists.into_iter().flatten().copied().chain(ENDS).chain(places);
    phrases.flat_map(|phrase| phrase.split(' ')).any(|known| known == word)
}
