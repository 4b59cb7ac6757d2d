//! Reader of requests as people say them, for which the plain grammar is too narrow.
//!
//! A sentence is first brought into a plain form ([`normal`]): one spelling, no contractions, courtesies or adverbs of
//! manner. Then its clauses are read one after another ([`clauses`]); each is a request with a verb of a known class
//! ([`verbs`], [`states`], [`towers`]), a statement of where or how something should be, a noun phrase with a place, a fact about the initial
//! scene, or an aside. Noun phrases ([`nouns`]) and places ([`places`]) are the same everywhere. A clause of another
//! form is not guessed: the reader says which words it did not understand.

mod clauses;
mod normal;
mod nouns;
mod places;
mod requests;
mod states;
mod towers;
mod verbs;
mod words;

use super::command::{Command, Group, Parsed, Place};

/// Reads a sentence; otherwise the reason why it is no request, as a message to its author.
pub(super) fn hear(text: &str) -> Result<Parsed, String> {
    let mut listener = Listener::new(normal::tokens(text));
    let mut parsed = Parsed::default();
    loop {
        listener.skip_courtesies();
        if listener.is_done() {
            break;
        }
        listener.check_mood()?;
        if let Some(commands) = listener.request() {
            parsed.commands.extend(commands);
        } else if let Some(aside) = listener.aside() {
            parsed.context += &format!(" {aside}");
        } else {
            return Err(listener.complaint());
        }
    }
    if let Some(taken) = listener.mind.pending.first() {
        return Err(format!("no place is given for `{}`", taken.words.join(" ")));
    }
    let is_request = |command: &Command| !matches!(command, Command::Given(_));
    if parsed.commands.iter().any(is_request) { Ok(parsed) } else { Err("it asks for nothing".into()) }
}

/// State of the reader at a position of the sentence.
#[derive(Clone, Debug, Default)]
struct Mind {
    /// Index of the next token.
    next: usize,
    /// Noun of the last noun phrase, to which `one` refers; `None` before the first.
    noun: Option<String>,
    /// Objects of the last request, to which `it` and `them` refer.
    topic: Vec<Group>,
    /// Reference of the last place, and whether that place supports.
    place: Option<Place>,
    /// Place from which the object of this request is taken.
    source: Option<Place>,
    /// Objects that were taken up, but not put anywhere yet.
    pending: Vec<Group>,
    /// Number and noun of `of the two apples`, among which the next phrase chooses.
    among: Vec<String>,
}

struct Listener {
    tokens: Vec<String>,
    mind: Mind,
    /// True if the sentence omits its articles.
    is_terse: bool,
    /// Position up to which some reading came, and the reason why it went no further.
    fault: (usize, String),
}

impl Listener {
    fn new(tokens: Vec<String>) -> Self {
        let is_terse = !tokens.iter().any(|word| nouns::ARTICLES.contains(&word.as_str()));
        Self { tokens, mind: Mind::default(), is_terse, fault: (0, String::new()) }
    }

    fn is_done(&self) -> bool {
        self.mind.next >= self.tokens.len()
    }

    /// Token at an index, empty beyond the end.
    fn token(&self, index: usize) -> &str {
        self.tokens.get(index).map_or("", String::as_str)
    }

    /// Token at an offset from the next one.
    fn ahead(&self, offset: usize) -> &str {
        self.token(self.mind.next + offset)
    }

    /// Number of tokens of a phrase that stands at an index; `None` if another one does.
    fn at_index(&self, index: usize, phrase: &str) -> Option<usize> {
        let mut length = 0;
        for word in phrase.split(' ') {
            if self.token(index + length) != word {
                return None;
            }
            length += 1;
        }
        Some(length)
    }

    fn at(&self, phrase: &str) -> Option<usize> {
        self.at_index(self.mind.next, phrase)
    }

    fn take(&mut self, phrase: &str) -> bool {
        let length = self.at(phrase);
        self.mind.next += length.unwrap_or(0);
        length.is_some()
    }

    /// Takes the longest of several phrases that stands next.
    fn take_any<'p>(&mut self, phrases: &[&'p str]) -> Option<&'p str> {
        let (length, phrase) =
            phrases.iter().filter_map(|phrase| Some((self.at(phrase)?, *phrase))).max_by_key(|(length, _)| *length)?;
        self.mind.next += length;
        Some(phrase)
    }

    /// Runs a parser, and forgets what it read if it fails.
    fn attempt<T>(&mut self, parse: impl FnOnce(&mut Self) -> Option<T>) -> Option<T> {
        let before = self.mind.clone();
        let found = parse(self);
        if found.is_none() {
            self.mind = before;
        }
        found
    }

    /// Notes why a reading goes no further than here; the reading that came farthest is reported.
    fn blame<T>(&mut self, why: impl Into<String>) -> Option<T> {
        if self.mind.next > self.fault.0 || self.fault.1.is_empty() {
            self.fault = (self.mind.next, why.into());
        }
        None
    }

    /// Words from an index to the end of the clause.
    fn clause(&self, start: usize) -> String {
        let end = (start..self.tokens.len()).find(|&index| clauses::is_mark(self.token(index)));
        self.tokens[start.min(self.tokens.len())..end.unwrap_or(self.tokens.len())].join(" ")
    }
}
