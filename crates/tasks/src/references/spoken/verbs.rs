//! Verbs of requests by class, in all their forms.

use super::words::vocabulary;

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
            Self::Carry => &vocabulary().carry,
            Self::Take => &vocabulary().take,
            Self::State => &vocabulary().state,
            Self::Build => &vocabulary().build,
        }
    }

    /// Base form of a verb of this class: `parked` and `parking` are `park`; `None` if the word is no such verb.
    pub fn base(self, word: &str) -> Option<&'static str> {
        self.verbs().iter().copied().find(|verb| is_form(word, verb))
    }

    /// Verbs of this class that consist of several words, longer ones first.
    pub fn phrases(self) -> impl Iterator<Item = &'static str> {
        self.verbs().iter().copied().filter(|verb| verb.contains(' '))
    }
}

/// True if the word is a form of a verb: `parked` and `parking` of `park`.
pub(super) fn is_form(word: &str, verb: &str) -> bool {
    if let Some((_, base)) = vocabulary().irregular.iter().find(|(form, _)| *form == word) {
        return *base == verb;
    }
    let of_stem = |stem: &str| {
        let single = stem.char_indices().last().map_or("", |(last, _)| &stem[..last]);
        let is_doubled = stem.len() > 2 && stem.chars().last() == single.chars().last();
        stem == verb
            || verb.strip_suffix('e') == Some(stem)
            || is_doubled && single == verb
            || stem.strip_suffix('i').is_some_and(|stem| verb.strip_suffix('y') == Some(stem))
    };
    word == verb || word.strip_suffix("ing").or_else(|| word.strip_suffix("ed")).is_some_and(of_stem)
}

/// True if the word is a verb of some class.
pub(super) fn is_verb(word: &str) -> bool {
    [Class::Carry, Class::Take, Class::State, Class::Build].iter().any(|class| class.base(word).is_some())
}

/// Base form of a verb in the third person, such as `carries`; `None` if the word is none.
pub(super) fn base_of_third_person(word: &str) -> Option<&'static str> {
    let words = vocabulary();
    let classes = [&words.carry, &words.take, &words.state, &words.build, &words.fill, &words.swap, &words.discard];
    let verbs = classes.into_iter().flatten().copied().filter(|verb| !verb.contains(' ')).chain(["give"]);
    let is_third = |verb: &str| {
        let stem = word.strip_suffix('s');
        stem == Some(verb)
            || stem.and_then(|stem| stem.strip_suffix('e')) == Some(verb)
            || word.strip_suffix("ies").is_some_and(|stem| verb.strip_suffix('y') == Some(stem))
    };
    verbs.into_iter().find(|verb| is_third(verb))
}

#[cfg(test)]
mod tests {
    use super::{Class, base_of_third_person};

    #[test]
    fn the_third_person_has_a_base() {
        for (word, base) in [("puts", "put"), ("carries", "carry"), ("presses", "press"), ("picks", "pick")] {
            assert_eq!(base_of_third_person(word), Some(base));
        }
        assert_eq!(base_of_third_person("put"), None);
        assert_eq!(base_of_third_person("goes"), None);
    }

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
