//! Clauses: where one ends, and which of them are no requests.

use super::listener::Listener;
use super::verbs::{Class, is_verb};
use super::words::{is_boundary, is_mark};

/// Words and phrases between clauses that carry no meaning of their own.
const COURTESIES: [&str; 52] = [
    ",",
    ".",
    ";",
    "and",
    "then",
    "and then",
    "so",
    "but",
    "also",
    "now",
    "first",
    "first of all",
    "firstly",
    "second",
    "secondly",
    "third",
    "finally",
    "lastly",
    "last",
    "afterwards",
    "afterward",
    "after that",
    "next",
    "again",
    "too",
    "as well",
    "robot",
    "dear robot",
    "hey",
    "hi",
    "hello",
    "ok",
    "okay",
    "alright",
    "all right",
    "right then",
    "well",
    "could you",
    "can you",
    "would you",
    "will you",
    "could the robot",
    "can the robot",
    "would the robot",
    "will the robot",
    "you could",
    "you can",
    "could i ask you to",
    "may i ask you to",
    "sir",
    "mate",
    "buddy",
];
/// First words of a clause that gives a reason, a purpose or a circumstance.
const SUBORDINATE: [&str; 24] = [
    "because",
    "since",
    "as",
    "when",
    "while",
    "if",
    "before",
    "after",
    "for",
    "to",
    "in",
    "once",
    "until",
    "that",
    "we",
    "i",
    "he",
    "she",
    "they",
    "my",
    "our",
    "it",
    "whatever",
    "whichever",
];
/// Words that make a statement a request.
const OBLIGATIONS: [&str; 14] = [
    "should", "must", "needs", "need", "wants", "goes", "go", "belongs", "belong", "shall", "ought", "has", "let",
    "want",
];
const QUESTIONS: [&str; 14] =
    ["where", "what", "who", "why", "how", "which", "whose", "is", "are", "does", "did", "do", "was", "has"];
const PROHIBITIONS: [&str; 8] = ["do not", "never", "avoid", "without", "not", "except", "stop", "nothing"];

impl Listener {
    pub(super) fn skip_courtesies(&mut self) {
        loop {
            // `next to the plate` is a place, `could the mug go there` a request.
            let is_place = super::places::begins(self);
            let is_modal =
                ["could you", "can you", "would you", "will you"].iter().any(|phrase| self.at(phrase).is_some());
            if is_place && !is_modal || self.take_any(&COURTESIES).is_none() {
                return;
            }
        }
    }

    /// Rejects questions and prohibitions.
    pub(super) fn check_mood(&mut self) -> Result<(), String> {
        if let Some(word) = PROHIBITIONS.iter().find(|word| self.at(word).is_some()) {
            return Err(format!("`{word} …` forbids something, which no goal can say"));
        }
        let index = self.mind.next;
        let end = (index..self.tokens.len()).find(|&at| is_mark(self.token(at)));
        let clause = &self.tokens[index..end.unwrap_or(self.tokens.len())];
        let denies = |pair: &[String]| {
            pair[0] == "not" || pair[0] == "never" || pair[0] == "without" && pair[1].ends_with("ing")
        };
        if clause.windows(2).any(denies) {
            return Err("the sentence forbids something, which no goal can say".into());
        }
        if QUESTIONS.contains(&self.ahead(0)) && !(self.ahead(0) == "has" && self.ahead(1) == "to") {
            return Err("a question is no request".into());
        }
        Ok(())
    }

    /// True where a request ends.
    pub(super) fn at_boundary(&self) -> bool {
        let index = self.mind.next;
        let word = self.token(index);
        let is_purpose = ["to", "in", "before", "while", "when", "until", "where", "if", "after", "like", "with"]
            .contains(&word)
            && !super::places::begins_at(self, index)
            && !(word == "with" && self.is_determined(index + 1));
        let ends = word.is_empty()
            || is_mark(word)
            || is_boundary(word)
            || ["also", "again", "instead", "next"].contains(&word);
        ends || is_purpose || COURTESIES.iter().any(|phrase| phrase.contains(' ') && self.at(phrase).is_some())
    }

    /// Takes a clause that states a reason, a purpose or a fact, and returns its words; `None` if it may be a request.
    pub(super) fn aside(&mut self) -> Option<String> {
        // `… and in the bowl` is another place, not a circumstance.
        if super::places::begins(self) {
            return None;
        }
        let start = self.mind.next;
        let first = self.ahead(0);
        let end = (start..self.tokens.len()).find(|&index| is_mark(self.token(index))).unwrap_or(self.tokens.len());
        let words = &self.tokens[start..end];
        let is_subordinate = SUBORDINATE.contains(&first);
        let states =
            ["is", "are", "was", "were", "has", "have", "looks", "smells", "tastes", "feels", "hurts", "am", "will"];
        let is_statement = words.iter().skip(1).any(|word| states.contains(&word.as_str()));
        let purpose = ["want to", "need to", "have to", "has to", "needs to", "like to"];
        let is_purpose = words.windows(2).any(|pair| purpose.contains(&format!("{} {}", pair[0], pair[1]).as_str()));
        let obliges = words.iter().any(|word| OBLIGATIONS.contains(&word.as_str()))
            && !(is_purpose && SUBORDINATE.contains(&first) && first != "it");
        let is_command = is_verb(first) && Class::Carry.base(first).is_some();
        let is_interjection = words.len() == 1 && !is_verb(first);
        if is_command || obliges || !(is_subordinate || is_statement || is_interjection) {
            return None;
        }
        // `We are having breakfast so put the cup on the saucer`
        let breaks = (start + 2..end).find(|&index| {
            ["so", "and", "then"].contains(&self.token(index))
                && is_verb(self.token(index + 1))
                && !self.tokens[start..index].iter().any(|word| word == "to")
        });
        let end = breaks.unwrap_or(end);
        self.mind.next = end;
        Some(self.tokens[start..end].join(" "))
    }

    /// Reason why the clause here is not understood.
    pub(super) fn complaint(&self) -> String {
        let first = self.ahead(0);
        let is_other_verb = !is_verb(first) && !self.is_determined(self.mind.next) && !SUBORDINATE.contains(&first);
        if is_other_verb && self.is_determined(self.mind.next + 1) {
            return format!("`{first}` is nothing that the robot can do with objects on a table");
        }
        if !self.fault.1.is_empty() && self.fault.0 >= self.mind.next {
            return self.fault.1.clone();
        }
        format!("`{}` is not understood", self.clause(self.mind.next))
    }
}
