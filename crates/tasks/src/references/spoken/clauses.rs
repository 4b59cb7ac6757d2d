//! Clauses: where one ends, and which of them are no requests.

use super::super::command::{Command, Group, Number};
use super::super::lexicon::lexicon;
use super::listener::Listener;
use super::nouns::is_number;
use super::places::begins_at;
use super::verbs::{Class, is_verb};
use super::words::{is_boundary, is_mark, vocabulary};

/// Words before `not` in a statement of fact.
const AUXILIARIES: [&str; 16] = [
    "is", "are", "was", "were", "does", "did", "do", "has", "have", "had", "can", "could", "will", "would", "am",
    "might",
];

impl Listener {
    pub(super) fn skip_courtesies(&mut self) {
        loop {
            // `next to the plate` is a place, `could the mug go there` a request.
            let is_place = super::places::begins(self);
            let is_modal =
                ["could you", "can you", "would you", "will you"].iter().any(|phrase| self.at(phrase).is_some());
            let is_skipped =
                self.label() || (!is_place || is_modal) && self.take_any(&vocabulary().courtesies).is_some();
            if !is_skipped {
                return;
            }
        }
    }

    /// Takes a title before a colon, such as `subtask 1:`.
    fn label(&mut self) -> bool {
        let found = self.attempt(|listener| {
            listener.take_any(&["ensure", "achieve", "reach", "produce"]);
            listener.take_any(&["my", "your", "our", "the"]);
            listener.take_any(&vocabulary().labels)?;
            listener.take("number");
            if listener.is_determined(listener.mind.next) && listener.ahead(1) == "," {
                listener.mind.next += 1;
            }
            listener.take(",").then_some(())
        });
        found.is_some()
    }

    /// Rejects distances and angles, which no goal can say; `the 30 cm ruler` is an object.
    pub(super) fn check_measures(&self) -> Result<(), String> {
        let units = [
            "cm",
            "mm",
            "m",
            "centimetres",
            "centimeters",
            "centimetre",
            "centimeter",
            "inches",
            "inch",
            "millimetres",
            "millimeters",
            "metres",
            "meters",
            "degrees",
            "feet",
            "foot",
        ];
        let is_count =
            |word: &str| word.parse::<f64>().is_ok() || is_number(word) || ["a", "ten", "twenty"].contains(&word);
        let amount = |word: &str| {
            let glued =
                units.iter().find_map(|unit| word.strip_suffix(unit)).is_some_and(|count| count.parse::<f64>().is_ok());
            glued.then_some(0)
        };
        for index in 0..self.tokens.len() {
            let word = self.token(index);
            let length =
                amount(word).or_else(|| (is_count(word) && units.contains(&self.token(index + 1))).then_some(1));
            let Some(length) = length else { continue };
            let is_named = index > 0 && vocabulary().articles.contains(&self.token(index - 1));
            if !is_named {
                let said = self.tokens[index..=index + length].join(" ");
                return Err(format!("`{said}` is a measure, which no goal can say: only on which side or how near"));
            }
        }
        Ok(())
    }

    /// Rejects prohibitions.
    pub(super) fn check_mood(&mut self) -> Result<(), String> {
        // `do not leave the mug on the book; …` says where it is.
        if ["do not leave", "do not keep"].iter().any(|phrase| self.at(phrase).is_some()) {
            return Ok(());
        }
        if let Some(word) = vocabulary().prohibitions.iter().find(|word| self.at(word).is_some()) {
            return Err(format!("`{word} …` forbids something, which no goal can say"));
        }
        if self.token(self.mind.next.wrapping_sub(1)) == "only" && self.is_determined(self.mind.next) {
            return Err("`only` forbids something, which no goal can say".into());
        }
        let start = self.mind.next;
        let end = self.clause_end();
        let is_condition = |index: &usize| match self.token(*index) {
            "unless" => true,
            "otherwise" => begins_at(self, index + 1),
            _ => false,
        };
        if (start..end).any(|index| is_condition(&index)) {
            return Err("the sentence depends on a condition, which no goal can say".into());
        }
        let forbids = (start..end).any(|index| match self.token(index) {
            "not" | "never" => !self.is_fact(start, index),
            "without" => self.token(index + 1).ends_with("ing"),
            _ => false,
        });
        if forbids { Err("the sentence forbids something, which no goal can say".into()) } else { Ok(()) }
    }

    /// True if the negation at an index of the clause from `start` belongs to a fact or a reason, not to a wish.
    fn is_fact(&self, start: usize, not: usize) -> bool {
        let is_reason = |&index: &usize| {
            vocabulary().reasons.iter().any(|reason| self.at_index(index, reason).is_some())
                && self.token(index) != "to"
        };
        let from = (start..not).rev().find(is_reason);
        let said = &self.tokens[from.unwrap_or(start)..not];
        let wishes = ["want", "like", "wish", "should", "must", "may", "shall", "need", "let", "sure"];
        let is_wish = said.iter().any(|word| wishes.contains(&word.as_str()))
            || ["want", "like", "need"].contains(&self.token(not + 1)) && self.token(not + 2) != "to";
        let has_subject = !["do", "or", "and", "but", "maybe", "please"].contains(&self.token(not.saturating_sub(2)));
        let is_stated =
            not > start + 1 && AUXILIARIES.contains(&self.token(not - 1)) && has_subject && !is_verb(self.token(start));
        !is_wish && (from.is_some() || is_stated)
    }

    /// Index of the mark that ends the clause here.
    pub(super) fn clause_end(&self) -> usize {
        (self.mind.next..self.tokens.len()).find(|&at| is_mark(self.token(at))).unwrap_or(self.tokens.len())
    }

    /// True if a question begins here.
    pub(super) fn asks(&self) -> bool {
        // `has to go there`, `do the same`, `have the mug moved`
        let is_verb = ["has", "have", "do"].contains(&self.ahead(0))
            && !["you", "we", "i", "they", "he", "she", "it", "anyone", "there"].contains(&self.ahead(1));
        vocabulary().questions.contains(&self.ahead(0)) && !is_verb
    }

    /// True where a request ends.
    pub(super) fn at_boundary(&self) -> bool {
        let index = self.mind.next;
        let word = self.token(index);
        let is_purpose = [
            "to", "in", "before", "while", "when", "until", "where", "if", "after", "like", "with", "which", "once",
            "by", "during", "whenever", "till", "please", "using",
        ]
        .contains(&word)
            && !begins_at(self, index)
            && !(word == "with" && self.is_determined(index + 1));
        let ends = word.is_empty()
            || Some(index) == self.mind.stop
            || is_mark(word)
            || is_boundary(word)
            || ["also", "again", "instead"].contains(&word)
            || word == "next" && !begins_at(self, index);
        ends || is_purpose
            || vocabulary().courtesies.iter().any(|phrase| phrase.contains(' ') && self.at(phrase).is_some())
    }

    /// Takes a clause that states a reason, a purpose or a fact, and returns its words; `None` if it may be a request.
    pub(super) fn aside(&mut self) -> Option<String> {
        // `… and in the bowl` is another place, not a circumstance.
        if super::places::begins(self) || self.asks() {
            return None;
        }
        let start = self.mind.next;
        let first = self.ahead(0);
        let end = self.clause_end();
        let words = &self.tokens[start..end];
        let is_subordinate = vocabulary().subordinate.contains(&first);
        let states = [
            "is", "are", "was", "were", "has", "have", "had", "looks", "smells", "tastes", "feels", "hurts", "am",
            "will", "seems", "does", "gets", "makes", "keeps", "takes", "comes", "can", "did", "do",
        ];
        let is_statement = words.iter().skip(1).any(|word| states.contains(&word.as_str()));
        let purpose =
            ["want to", "need to", "have to", "has to", "needs to", "like to", "wants to", "go to", "going to"];
        let is_purpose = words.windows(2).any(|pair| purpose.contains(&format!("{} {}", pair[0], pair[1]).as_str()));
        let is_reason = self.follows_reason(start) || vocabulary().reasons.iter().any(|word| self.at(word).is_some());
        let obliges = words.iter().any(|word| vocabulary().obligations.contains(&word.as_str()))
            && !(is_purpose && is_subordinate && first != "it")
            && !is_reason;
        // `the banana does not go in the bin`
        let negates = words.windows(2).any(|pair| ["does", "do"].contains(&pair[0].as_str()) && pair[1] == "not");
        let obliges = obliges && !negates;
        let is_command = Class::Carry.base(first).is_some();
        // `time to tidy up,`
        let is_idle = |word: &str| vocabulary().polite.contains(&word) || is_verb(word) || word == "up";
        let is_polite = !is_verb(first) && words.iter().all(|word| is_idle(word));
        // `switch it on and then off`
        let is_state = ["on", "off", "open", "closed", "shut"].contains(&first);
        let is_interjection = words.len() == 1 && !is_verb(first) && !is_state || is_polite;
        let addresses =
            ["if you", "you to", "you could", "you would", "you should", "you must", "could you", "you can"];
        let asks_robot = words.windows(2).any(|pair| addresses.contains(&format!("{} {}", pair[0], pair[1]).as_str()));
        let (follows, opens) = (self.token(start + 1), |words: &[&str]| words.contains(&first));
        // `when the mug is on the tray, …`, `after drying it`
        let is_at_place = |index: usize| ["is", "are"].contains(&self.token(index)) && begins_at(self, index + 1);
        let is_condition = opens(&["when", "once", "if", "until", "whenever"]) && (start..end).any(is_at_place)
            || opens(&["after", "before", "while"]) && follows.ends_with("ing") && !is_verb(follows);
        if is_command || obliges || asks_robot || is_condition || self.requests_first(start, end) {
            return None;
        }
        if !(is_subordinate || is_statement || is_interjection) {
            return None;
        }
        // `We are having breakfast so put the cup on the saucer`
        let breaks = (start + 2..end).find(|&index| {
            let is_purpose = self.token(index) == "and" && self.tokens[start..index].iter().any(|word| word == "to");
            ["so", "and", "then"].contains(&self.token(index))
                && (is_verb(self.token(index + 1))
                    || self.token(index + 1) == "please"
                    || ["i would like", "i want", "i need"].iter().any(|wish| self.at_index(index + 1, wish).is_some()))
                && !is_purpose
        });
        let end = breaks.unwrap_or(end);
        self.mention(start, end);
        self.mind.next = end;
        Some(self.tokens[start..end].join(" "))
    }

    /// True if the words before an index introduce a reason.
    fn follows_reason(&self, index: usize) -> bool {
        ["so", "because", "since", "that"].contains(&self.token(index.wrapping_sub(1)))
    }

    /// True for `after opening the drawer`, `once the mug is on the tray`: what has to be done before is a request too.
    fn requests_first(&self, start: usize, end: usize) -> bool {
        let is_first = ["after", "once", "before", "when", "while"].contains(&self.token(start));
        let acts = |index: usize| {
            let (word, before) = (self.token(index), self.token(index - 1));
            let is_form = word.ends_with("ing") || word.ends_with("ed") || ["put", "set", "shut"].contains(&word);
            let is_done = (before == "you" || before == "we") && !["have", "get", "keep", "make"].contains(&word);
            is_verb(word) && (is_form || is_done)
        };
        is_first && (start + 1..end).any(acts)
    }

    /// Parses a request after a circumstance without a comma, or after `by`: `for lunch the bread goes on the board`, `make
    /// room by moving the cup behind the jug`.
    pub(super) fn late(&mut self) -> Option<Vec<Command>> {
        let (start, end) = (self.mind.next, self.clause_end());
        let openers = [
            "for", "by", "when", "as", "since", "because", "after", "before", "while", "once", "in", "tonight",
            "today", "now", "until",
        ];
        let opens = openers.contains(&self.ahead(0)) && !self.requests_first(start, end);
        (start + 1..end).find_map(|index| {
            let (before, word) = (self.token(index - 1), self.token(index));
            let is_way = before == "by" && word.ends_with("ing") && is_verb(word);
            let is_start = index > start + 1
                && !self.is_determined(index - 1)
                && (is_verb(word) && before != "to"
                    || self.is_determined(index)
                    || ["i", "we", "please"].contains(&word));
            (is_way || opens && is_start).then_some(())?;
            self.attempt(|listener| {
                listener.mind.next = index;
                listener.skip_courtesies();
                let commands = listener.request()?;
                (listener.mind.next >= end && !commands.is_empty()).then_some(commands)
            })
        })
    }

    /// Remembers the object that an aside is about, for the pronouns that follow.
    fn mention(&mut self, start: usize, end: usize) {
        if !self.mind.pending.is_empty() {
            return;
        }
        let before = self.mind.clone();
        let mut named: Vec<(usize, Group)> = Vec::new();
        let mut index = start;
        while index < end {
            self.mind.next = index;
            self.mind.stop = Some(end);
            let is_named = self.is_determined(index) && !["it", "them", "that"].contains(&self.token(index));
            let mut group = if is_named { self.attempt(Self::noun_phrase) } else { None };
            // `the fan running`
            if let Some(group) = group.as_mut().filter(|group| !is_thing(group) && group.words.len() > 1) {
                group.words.pop();
            }
            let Some(mut group) = group.filter(is_thing) else {
                index += 1;
                continue;
            };
            let next = self.mind.next;
            while self.take_any(&vocabulary().being).is_some() {}
            if group.at.is_none() && super::places::begins(self) {
                group.at = self.attempt(Self::place).map(Box::new);
            }
            if group.at.is_none() {
                self.mind.next = next;
            }
            named.push((index, group));
            index = self.mind.next.max(index + 1);
        }
        // `you will see two mugs; take the red one`
        let noun = self.mind.noun.take().filter(|noun| lexicon().is_noun(noun)).map(|noun| lexicon().singular(&noun));
        self.mind = before;
        self.mind.noun = self.mind.noun.take().or(noun);
        let is_subject = named.first().is_some_and(|(index, _)| *index == start);
        if named.len() == 1 || is_subject {
            self.mind.topic = vec![named.swap_remove(0).1];
        }
    }

    /// Reason why the clause here is not understood.
    pub(super) fn complaint(&self) -> String {
        let first = self.ahead(0);
        if self.asks() {
            return "a question is no request".into();
        }
        let polite = vocabulary().polite.iter().flat_map(|phrase| phrase.split(' '));
        let is_polite = |index: &usize| polite.clone().any(|word| word == self.token(*index));
        let at = (self.mind.next..self.clause_end()).find(|index| !is_polite(index)).unwrap_or(self.mind.next);
        let verb = self.token(at);
        let is_other_verb = !is_verb(verb)
            && !self.is_determined(at)
            && (at > self.mind.next || !vocabulary().subordinate.contains(&first));
        if is_other_verb && self.is_determined(at + 1) {
            return format!("`{verb}` is nothing that the robot can do with objects on a table");
        }
        if !self.fault.1.is_empty() && self.fault.0 >= self.mind.next {
            return self.fault.1.clone();
        }
        format!("`{}` is not understood", self.clause(self.mind.next))
    }
}

/// True if the noun of a phrase is a word for objects.
fn is_thing(group: &Group) -> bool {
    let after = ["with", "without", "of", "marked"];
    let head = group.words.iter().take_while(|word| !after.contains(&word.as_str())).last();
    group.number == Number::One && head.is_some_and(|head| lexicon().is_noun(head))
}
