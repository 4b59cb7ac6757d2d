//! Verbs of requests by class, in all their forms.

/// Verbs that bring an object to a place.
const CARRY: [&str; 78] = [
    "put",
    "place",
    "set",
    "move",
    "stack",
    "bring",
    "lay",
    "drop",
    "position",
    "insert",
    "store",
    "transfer",
    "slide",
    "deposit",
    "leave",
    "carry",
    "arrange",
    "relocate",
    "throw",
    "toss",
    "pop",
    "stick",
    "pass",
    "push",
    "get",
    "park",
    "chuck",
    "tuck",
    "dump",
    "rest",
    "shove",
    "nudge",
    "hang",
    "stand",
    "sit",
    "seat",
    "stash",
    "stow",
    "plonk",
    "plop",
    "bung",
    "whack",
    "sling",
    "lob",
    "balance",
    "lean",
    "nestle",
    "slip",
    "squeeze",
    "load",
    "add",
    "return",
    "shift",
    "drag",
    "pull",
    "deliver",
    "send",
    "perch",
    "situate",
    "locate",
    "pile",
    "scoot",
    "pack",
    "plunk",
    "settle",
    "reposition",
    "plant",
    "ease",
    "lower",
    "take",
    "lift",
    "guide",
    "steer",
    "roll",
    "fit",
    "file",
    "drive",
    "tidy",
];

/// Verbs that take up an object; where it goes follows in the same or another clause.
const TAKE: [&str; 27] = [
    "pick up",
    "pick out",
    "pick",
    "take out",
    "take",
    "grab hold of",
    "get hold of",
    "take hold of",
    "grab",
    "grasp",
    "find",
    "fetch",
    "get",
    "collect",
    "retrieve",
    "remove",
    "lift up",
    "lift out",
    "lift",
    "snatch",
    "pluck",
    "fish out",
    "pull out",
    "pull",
    "extract",
    "hold",
    "raise",
];

/// Verbs that change the state of an object.
const STATE: [&str; 40] = [
    "open", "close", "shut", "pull", "push", "lift", "raise", "lower", "flip", "fold", "swing", "turn", "switch",
    "press", "set", "hit", "flick", "twist", "slide", "slam", "pop", "prop", "crack", "crank", "rotate", "dial",
    "adjust", "click", "tap", "depress", "toggle", "snap", "put", "get", "leave", "keep", "have", "make", "shift",
    "move",
];

/// Verbs that stack several objects.
const BUILD: [&str; 10] =
    ["build", "make", "create", "construct", "stack", "stack up", "pile", "pile up", "form", "assemble"];

/// Forms that follow no rule.
const IRREGULAR: [(&str, &str); 22] = [
    ("stood", "stand"),
    ("laid", "lay"),
    ("brought", "bring"),
    ("taken", "take"),
    ("took", "take"),
    ("hung", "hang"),
    ("stuck", "stick"),
    ("kept", "keep"),
    ("thrown", "throw"),
    ("threw", "throw"),
    ("slid", "slide"),
    ("sent", "send"),
    ("gotten", "get"),
    ("got", "get"),
    ("sat", "sit"),
    ("held", "hold"),
    ("swung", "swing"),
    ("made", "make"),
    ("slung", "sling"),
    ("built", "build"),
    ("found", "find"),
    ("leaving", "leave"),
];

/// Class of a verb.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Class {
    Carry,
    Take,
    State,
    Build,
}

impl Class {
    fn verbs(self) -> &'static [&'static str] {
        match self {
            Self::Carry => &CARRY,
            Self::Take => &TAKE,
            Self::State => &STATE,
            Self::Build => &BUILD,
        }
    }

    /// Base form of a verb of this class: `parked` and `parking` are `park`; `None` if the word is no such verb.
    pub fn base(self, word: &str) -> Option<&'static str> {
        let known = |base: &str| self.verbs().iter().copied().find(|verb| *verb == base);
        if let Some((_, base)) = IRREGULAR.iter().find(|(form, _)| *form == word) {
            return known(base);
        }
        known(word).or_else(|| {
            let stem = word.strip_suffix("ing").or_else(|| word.strip_suffix("ed"))?;
            let single = stem.char_indices().last().map_or("", |(last, _)| &stem[..last]);
            let is_doubled = stem.len() > 2 && stem.chars().last() == single.chars().last();
            known(stem)
                .or_else(|| known(&format!("{stem}e")))
                .or_else(|| is_doubled.then(|| known(single)).flatten())
                .or_else(|| known(&format!("{}y", stem.strip_suffix('i')?)))
        })
    }

    /// Verbs of this class that consist of several words, longer ones first.
    pub fn phrases(self) -> impl Iterator<Item = &'static str> {
        self.verbs().iter().copied().filter(|verb| verb.contains(' '))
    }
}

/// True if the word is a verb of some class.
pub(super) fn is_verb(word: &str) -> bool {
    [Class::Carry, Class::Take, Class::State, Class::Build].iter().any(|class| class.base(word).is_some())
}

#[cfg(test)]
mod tests {
    use super::Class;

    #[test]
    fn every_form_of_a_verb_has_one_base() {
        for (word, base) in [
            ("putting", "put"),
            ("placed", "place"),
            ("popped", "pop"),
            ("stood", "stand"),
            ("tidied", "tidy"),
            ("laying", "lay"),
        ] {
            assert_eq!(Class::Carry.base(word), Some(base));
        }
        assert_eq!(Class::State.base("closed"), Some("close"));
        assert_eq!(Class::Carry.base("pour"), None);
        assert_eq!(Class::Take.base("red"), None);
    }
}
