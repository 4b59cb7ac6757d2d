//! Requests within words of politeness, or that somebody reports.

use super::super::command::Command;
use super::super::lexicon::lexicon;
use super::listener::Listener;
use super::requests::{OTHER, VERBAL};
use super::words::vocabulary;

impl Listener {
    /// Parses a request after words of politeness, the fewest that leave one: `would it be possible to move …`,
    /// `it would be nice if the mug was …`.
    pub(super) fn wrapped(&mut self) -> Option<Vec<Command>> {
        let (start, asks) = (self.mind.next, self.asks());
        loop {
            // `be a gem and …`
            let is_praise = self.ahead(0) == "be" && self.is_determined(self.mind.next + 1) && self.ahead(3) == "and";
            let said = if is_praise { "and" } else { self.take_any(&vocabulary().polite)? };
            self.mind.next += if is_praise { 4 } else { 0 };
            let prefix = format!(" {} ", self.tokens[start..self.mind.next].join(" "));
            let says = |words: &[&str]| words.iter().any(|word| prefix.contains(&format!(" {word} ")));
            let opens = |words: &[&str]| words.contains(&self.token(start));
            let is_condition = opens(&["if", "whether"]) && !says(&vocabulary().wanting);
            if asks && !says(&vocabulary().enabling) || is_condition {
                continue;
            }
            let is_sequence = said == "have" && says(&["once", "after", "when"]);
            let is_wish =
                vocabulary().desires.contains(&said) && (says(&vocabulary().wanting) || says(&vocabulary().weak));
            // `I will put the mug there` says what somebody else does.
            let others =
                ["let me", "i will", "we will", "i shall", "should i", "shall i", "will i", "i can", "i might"];
            if others.iter().any(|phrase| prefix.ends_with(&format!(" {phrase} "))) {
                continue;
            }
            let is_wish = is_wish && !(said == "make" && self.ahead(0) == "a");
            let mut found = None;
            let is_modal = opens(&["could", "can", "would", "may", "might", "shall", "should", "will"]);
            if is_modal || !vocabulary().stative.contains(&said) || is_sequence {
                found = self.first_of(&VERBAL);
            }
            if found.is_none() && is_wish {
                let is_duty = !says(&vocabulary().wanting);
                found = self.attempt(|listener| {
                    let commands = listener.wanted(is_duty)?;
                    listener.at_boundary().then_some(commands)
                });
            }
            if found.is_some() {
                return found;
            }
        }
    }

    /// Parses a request that somebody reports: `mum says the mug has to go on the tray`.
    pub(super) fn reported(&mut self) -> Option<Vec<Command>> {
        let reporting = &vocabulary().reporting;
        let says = |index: usize| reporting.iter().find_map(|phrase| self.at_index(index, phrase));
        let start = self.mind.next;
        let (index, length) = (start + 1..start + 5).find_map(|index| Some((index, says(index)?)))?;
        self.mind.next = index + length;
        self.take("that");
        self.take_any(&["you to", "us to", "the robot to", "you", "to"]);
        let found = self.first_of(&VERBAL).or_else(|| self.first_of(&OTHER));
        found.or_else(|| self.wanted(false)).filter(|_| self.at_boundary())
    }

    /// Remembers `of the two apples,` for the next phrase.
    pub(super) fn choice(&mut self) {
        let found = self.attempt(|listener| {
            listener.take_any(&["of the", "from the", "out of the"])?;
            let is_number = ["two", "three"].contains(&listener.ahead(0));
            let end = (1..5).find(|&offset| listener.ahead(offset) == ",").filter(|_| is_number)?;
            let start = listener.mind.next;
            listener.mind.next += end + 1;
            Some(listener.tokens[start..start + end].to_vec())
        });
        if let Some(among) = found {
            // `of the two mugs, put the red one there`
            self.mind.noun = among.last().map(|noun| lexicon().singular(noun));
            self.mind.among = among;
        }
    }
}
