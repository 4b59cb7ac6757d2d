//! Position in the tokens of a sentence, with what was spoken of so far.

use super::super::change::Action;
use super::super::command::{Group, Place};
use super::words::{is_mark, vocabulary};

/// State of the reader at a position of the sentence.
#[derive(Clone, Debug, Default)]
pub(super) struct Mind {
    /// Index of the next token.
    pub(super) next: usize,
    /// Noun of the last noun phrase, to which `one` refers; `None` before the first.
    pub(super) noun: Option<String>,
    /// Objects of the last request, to which `it` and `them` refer.
    pub(super) topic: Vec<Group>,
    /// Reference of the last place, and whether that place supports.
    pub(super) place: Option<Place>,
    /// Objects of the last two places, if they are the same: `the fork to the left and the knife to the right of the plate`.
    pub(super) centre: Vec<Group>,
    /// True if the object of the last place is any of its kind: `on a coaster`.
    pub(super) is_any: bool,
    /// Place from which the object of this request is taken.
    pub(super) source: Option<Place>,
    /// Place before the verb, from which the object of this request is taken.
    pub(super) fronted: Option<Place>,
    /// Change of the last request; `None` if it brought an object to a place.
    pub(super) action: Option<Action>,
    /// Index at which the last wish ended; after `and` it goes on.
    pub(super) wished: Option<usize>,
    /// Index at which noun phrases end.
    pub(super) stop: Option<usize>,
    /// Objects of the request that is being read, beside which its place cannot be.
    pub(super) subjects: Vec<Group>,
    /// Objects that were taken up, but not put anywhere yet.
    pub(super) pending: Vec<Group>,
    /// Those of them that were taken out of or off something.
    pub(super) freed: Vec<Group>,
    /// Number and noun of `of the two apples`, among which the next phrase chooses.
    pub(super) among: Vec<String>,
}

pub(super) struct Listener {
    pub(super) tokens: Vec<String>,
    pub(super) mind: Mind,
    /// True if the sentence omits its articles.
    pub(super) is_terse: bool,
    /// Position up to which some reading came, and the reason why it went no further.
    pub(super) fault: (usize, String),
}

impl Listener {
    pub(super) fn new(tokens: Vec<String>) -> Self {
        let is_terse = !tokens.iter().any(|word| vocabulary().articles.contains(&word.as_str()));
        Self { tokens, mind: Mind::default(), is_terse, fault: (0, String::new()) }
    }

    pub(super) fn is_done(&self) -> bool {
        self.mind.next >= self.tokens.len()
    }

    /// Token at an index, empty beyond the end.
    pub(super) fn token(&self, index: usize) -> &str {
        self.tokens.get(index).map_or("", String::as_str)
    }

    /// Token at an offset from the next one.
    pub(super) fn ahead(&self, offset: usize) -> &str {
        self.token(self.mind.next + offset)
    }

    /// Number of tokens of a phrase that stands at an index; `None` if another one does.
    pub(super) fn at_index(&self, index: usize, phrase: &str) -> Option<usize> {
        let mut length = 0;
        for word in phrase.split(' ') {
            if self.token(index + length) != word {
                return None;
            }
            length += 1;
        }
        Some(length)
    }

    pub(super) fn at(&self, phrase: &str) -> Option<usize> {
        self.at_index(self.mind.next, phrase)
    }

    pub(super) fn take(&mut self, phrase: &str) -> bool {
        let length = self.at(phrase);
        self.mind.next += length.unwrap_or(0);
        length.is_some()
    }

    /// Takes the longest of several phrases that stands next.
    pub(super) fn take_any<'p>(&mut self, phrases: &[&'p str]) -> Option<&'p str> {
        let (length, phrase) =
            phrases.iter().filter_map(|phrase| Some((self.at(phrase)?, *phrase))).max_by_key(|(length, _)| *length)?;
        self.mind.next += length;
        Some(phrase)
    }

    /// Runs a parser, and forgets what it read if it fails.
    pub(super) fn attempt<T>(&mut self, parse: impl FnOnce(&mut Self) -> Option<T>) -> Option<T> {
        let before = self.mind.clone();
        let found = parse(self);
        if found.is_none() {
            self.mind = before;
        }
        found
    }

    /// Notes why a reading goes no further than here; the reading that came farthest is reported.
    pub(super) fn blame<T>(&mut self, why: impl Into<String>) -> Option<T> {
        if self.mind.next > self.fault.0 || self.fault.1.is_empty() {
            self.fault = (self.mind.next, why.into());
        }
        None
    }

    /// Words from an index to the end of the clause.
    pub(super) fn clause(&self, start: usize) -> String {
        let end = (start..self.tokens.len()).find(|&index| is_mark(self.token(index)));
        self.tokens[start.min(self.tokens.len())..end.unwrap_or(self.tokens.len())].join(" ")
    }
}
