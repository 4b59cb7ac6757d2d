//! Noun phrases: number, words, location, and the objects that pronouns stand for.

use super::super::change::own_part;
use super::super::command::{Group, Number, Place};
use super::super::lexicon::{COMPARATIVES, is_color, lexicon};
use super::listener::Listener;
use super::words::{is_boundary, is_mark, vocabulary};

const NUMBERS: [(&str, usize); 6] = [("one", 1), ("two", 2), ("three", 3), ("four", 4), ("five", 5), ("six", 6)];

/// True for a number in words.
pub(super) fn is_number(word: &str) -> bool {
    NUMBERS.iter().any(|(number, _)| *number == word)
}

impl Listener {
    /// True if a noun phrase can begin at an index without doubt.
    pub(super) fn is_determined(&self, index: usize) -> bool {
        let word = self.token(index);
        vocabulary().articles.contains(&word)
            || vocabulary().quantifiers.contains(&word)
            || NUMBERS.iter().any(|(number, _)| *number == word)
    }

    /// One or several noun phrases joined by `and` or commas; those that a pronoun stands for.
    pub(super) fn noun_phrases(&mut self) -> Option<Vec<Group>> {
        let mut groups = self.meant()?;
        while let Some(more) = self.attempt(|listener| {
            let joined =
                listener.take(",") | listener.take("and") | listener.take("plus") | listener.take("along with");
            let joined = joined | listener.take_any(&["together with", "as well as", "also"]).is_some();
            let goes_on = joined && !super::verbs::is_verb(listener.ahead(0)) && !super::places::begins(listener);
            goes_on.then(|| listener.meant()).flatten()
        }) {
            groups.extend(more);
        }
        Some(groups)
    }

    /// The objects of a pronoun, or one noun phrase.
    fn meant(&mut self) -> Option<Vec<Group>> {
        if let Some(known) = self.attempt(Self::pronoun) {
            if known.is_empty() {
                return self.blame(format!("`{}` names no object", self.token(self.mind.next.saturating_sub(1))));
            }
            return Some(known);
        }
        self.noun_phrase().map(|group| vec![group])
    }

    /// Objects that a pronoun stands for, empty if none was named before; `None` if no pronoun stands here.
    pub(super) fn pronoun(&mut self) -> Option<Vec<Group>> {
        let said = self.take_any(&vocabulary().pronouns)?;
        let follows = self.mind.next;
        let ends = self.is_end(follows)
            || self.preposition(follows).is_some()
            || vocabulary().noun_ends.contains(&self.token(follows));
        let ends = ends
            || vocabulary().particles.contains(&self.token(follows))
            || vocabulary().hedges.contains(&self.token(follows));
        let ends = ends || super::sources::is_source(self, follows) || said == "it" || said == "them";
        // Of several objects that were taken up one after another, `it` is the last one.
        let is_last = said == "it" && self.mind.pending.len() > 1 && self.mind.pending == self.mind.topic;
        let first = if is_last { self.mind.topic.len() - 1 } else { 0 };
        let ends = ends || said == "that" && self.is_determined(follows);
        ends.then(|| self.mind.topic[first..].to_vec())
    }

    /// One noun phrase with its location.
    pub(super) fn noun_phrase(&mut self) -> Option<Group> {
        if let Some(group) = self.attempt(Self::free_choice) {
            return Some(group);
        }
        let start = self.mind.next;
        let is_single = self.at("one of").is_some() || self.at("any one of").is_some();
        let number = self.number();
        let mut words: Vec<String> = Vec::new();
        let mut at = None;
        while !self.is_end(self.mind.next) || self.continues(&words) {
            let index = self.mind.next;
            if let Some(place) = self.attempt(Self::location) {
                at = place.map(Box::new);
                break;
            }
            // `the mug closest to the robot`
            if let Some(length) = self.extreme_at(index).filter(|_| !words.is_empty()) {
                words.extend_from_slice(&self.tokens[index..index + length]);
                self.mind.next += length;
                break;
            }
            let word = self.token(index);
            let leads = super::places::begins_at(self, index + 1) || super::sources::is_source(self, index + 1);
            let hedge = vocabulary().hedges.contains(&word) && leads;
            let next = self.token(index + 1);
            let ends = self.is_end(index + 1) || ["before", "after", "when", "while", "once", "until"].contains(&next);
            let particle = vocabulary().particles.contains(&word) && ends;
            let is_part = words.is_empty() && particle;
            let follows = self.token(index + 1);
            // `the can can go there`
            let is_modal = word == "can" && ["be", "go", "stand", "lie"].contains(&follows);
            let is_level = ["up", "down"].contains(&word) && follows == "to"
                || word == "on" && ["full", "high", "low", "max", "maximum"].contains(&follows)
                || self.at_index(index, "all the way").is_some();
            let has_trait = words.iter().any(|word| word == "with");
            let is_top = self.at_index(index, "on top").is_some() && self.token(index + 2) != "of";
            let is_unknown = vocabulary().unknown.contains(&word);
            let stops =
                vocabulary().noun_ends.contains(&word) || super::sources::is_source(self, index) || hedge || particle;
            // `the spoon placed next to the bowl`
            let is_participle = (word.ends_with("ed") || ["put", "set", "laid"].contains(&word))
                && super::verbs::Class::Carry.base(word).is_some();
            let moves = leads || follows == "to" && super::places::begins_at(self, index + 2);
            let is_told = !words.is_empty() && is_participle && moves;
            // `from the tray take the mug`, `the light switched on`
            let class = super::verbs::Class::State;
            let acts = super::verbs::is_verb(word) && self.is_determined(index + 1)
                || word.ends_with("ed") && class.base(word).is_some() && vocabulary().particles.contains(&follows);
            let postures = ["rest", "stand", "sit", "lie", "stay", "go", "hang", "live", "lean", "end"];
            let is_mutual =
                |phrase: &&'static str| self.at_index(index, phrase).is_some_and(|length| self.is_end(index + length));
            let acts = acts || vocabulary().mutual.iter().any(is_mutual);
            let acts = acts || postures.contains(&word) && super::places::begins_at(self, index + 1);
            let is_side = |phrase: &&'static str| self.at_index(index, phrase).is_some();
            let acts = acts || vocabulary().either_side.iter().any(is_side);
            let is_told = is_told || !words.is_empty() && acts;
            let is_object = word == "with" && ["it", "them"].contains(&follows);
            let stops = stops || is_object || is_told || is_modal || is_level || !has_trait && (is_top || is_unknown);
            if !is_part && stops || !words.is_empty() && super::places::begins_at(self, index) {
                break;
            }
            if ["it", "them"].contains(&word) {
                return self.blame(format!("`{}` is not understood", self.clause(start)));
            }
            // An article inside a phrase belongs to a preposition within it.
            let joins = ["of", "with", "without", "and", "in", "on", "for", "around"];
            let is_stray = vocabulary().articles.contains(&word) && word != "that";
            if is_stray && !words.last().is_some_and(|last| joins.contains(&last.as_str())) {
                return self.blame(format!("`{}` is not understood", self.clause(start)));
            }
            words.push(word.to_owned());
            self.mind.next += 1;
        }
        if words.is_empty() {
            return None;
        }
        // `the tomato, currently on the tray, should …`
        if at.is_none()
            && let Some(place) = self.attempt(|listener| {
                listener.take(",").then_some(())?;
                let is_plain = super::places::begins(listener);
                let place = if is_plain { listener.standing()? } else { listener.location()? };
                let is_duty = vocabulary().duties.contains(&listener.ahead(1));
                (listener.take(",") && (!is_plain || is_duty)).then_some(place)
            })
        {
            at = place.map(Box::new);
        }
        // `Daddy's mug`
        let is_person = |word: &str| {
            word.strip_suffix("'s")
                .is_some_and(|owner| !lexicon().contains(owner) && !["robot", "camera"].contains(&owner))
        };
        while words.len() > 1 && is_person(&words[0]) {
            words.remove(0);
        }
        // `cube red`
        if let [noun, color] = words.as_mut_slice()
            && is_color(color)
            && !lexicon().is_noun(color)
            && lexicon().is_noun(noun)
        {
            std::mem::swap(noun, color);
        }
        self.choose_among(&mut words);
        self.complete(&mut words);
        if words.len() > 1 && words.last().is_some_and(|last| last == "one" || last == "ones") {
            return self.blame(format!("`{}` names no object", words.join(" ")));
        }
        outermost(&mut words);
        // `the open top drawer` is a place in a scene in which it is open.
        if words.last().is_some_and(|last| last == "drawer") {
            words.retain(|word| word != "open" && word != "opened");
        }
        let part = own_part(&mut words);
        let head_is_plural = is_plural(&words);
        let number = match number {
            Number::One if head_is_plural && !is_single => Number::All,
            // `both the apple and the pear`, `all the bread`
            // `all the fruit`, `the cutlery`
            Number::All if lexicon().is_collective(last(&words)) => Number::All,
            Number::One if !is_single && lexicon().is_always_collective(last(&words)) => Number::All,
            Number::Many(_) | Number::All if !head_is_plural => Number::One,
            number => number,
        };
        let except = if number == Number::All { self.exceptions() } else { Vec::new() };
        Some(Group { words, at, number, part, except })
    }

    /// Parses `except the banana` after a phrase for all objects of a kind.
    pub(super) fn exceptions(&mut self) -> Vec<Group> {
        let found = self.attempt(|listener| {
            listener.take(",");
            listener.take("except").then_some(())?;
            listener.noun_phrases()
        });
        found.unwrap_or_default()
    }

    /// Number from the words before the noun.
    fn number(&mut self) -> Number {
        let mut number = Number::One;
        loop {
            let word = self.ahead(0);
            let count = NUMBERS.iter().find(|(name, _)| *name == word).map(|(_, count)| *count);
            let is_comparison = COMPARATIVES.contains(&self.ahead(1));
            match (word, count) {
                ("all", _) => number = Number::All,
                ("both", _) => number = Number::Many(2),
                ("each" | "every", _) => number = Number::Each(None),
                ("couple" | "pair", _) if self.ahead(1) == "of" => number = Number::Many(2),
                ("of", _) if number != Number::One => {}
                ("few" | "several" | "many", _) => number = Number::All,
                ("another", _) => {}
                ("one", _) if self.ahead(1) == "of" => self.mind.next += 1,
                ("one", _) if self.is_end(self.mind.next + 1) || is_comparison => break,
                (_, Some(1)) => {}
                (_, Some(count)) if matches!(number, Number::Each(_)) => number = Number::Each(Some(count)),
                (_, Some(count)) => number = Number::Many(count),
                ("same", _) => {}
                (word, _) if vocabulary().articles.contains(&word) => {}
                _ => break,
            }
            self.mind.next += 1;
        }
        number
    }

    /// Parses `whichever mug is blue`, `whatever apple you like`.
    fn free_choice(&mut self) -> Option<Group> {
        self.take_any(&["whichever", "whatever", "any"])?;
        let mut noun = Vec::new();
        while !self.is_end(self.mind.next) && !["is", "looks", "you"].contains(&self.ahead(0)) {
            noun.push(self.ahead(0).to_owned());
            self.mind.next += 1;
        }
        let mut words = Vec::new();
        if self.take_any(&["you like", "you want", "you prefer", "you fancy", "you please", "you find"]).is_none() {
            self.take_any(&["is the", "is", "looks"])?;
            while !self.is_end(self.mind.next) && !super::places::begins(self) {
                words.push(self.ahead(0).to_owned());
                self.mind.next += 1;
            }
            (!words.is_empty()).then_some(())?;
        }
        words.extend(noun);
        self.complete(&mut words);
        (!words.is_empty()).then(|| Group::of(words))
    }

    /// A relative clause with a location; `Some(None)` for the table.
    fn location(&mut self) -> Option<Option<Place>> {
        self.take_any(&vocabulary().relatives)?;
        while !super::places::begins(self) && self.take_any(&vocabulary().relative_words).is_some() {}
        self.standing()
    }

    /// Number of tokens of a comparison of positions at an index; `None` if there is none.
    fn extreme_at(&self, index: usize) -> Option<usize> {
        const COMPARED: [&str; 12] = [
            "farthest to the robot's left",
            "farthest to the robot's right",
            "farthest to the camera's left",
            "farthest to the camera's right",
            "farthest to the left",
            "farthest to the right",
            "farthest from the robot",
            "farthest from the camera",
            "nearest to the robot",
            "nearest to the camera",
            "closest to the robot",
            "closest to the camera",
        ];
        COMPARED.iter().filter_map(|phrase| self.at_index(index, phrase)).max()
    }

    /// True at the end of a clause, where no noun phrase goes on.
    pub(super) fn is_end(&self, index: usize) -> bool {
        let word = self.token(index);
        word.is_empty() || is_mark(word) || is_boundary(word) || word == "or" || Some(index) == self.mind.stop
    }

    /// True if `and` continues a description (`with black wheels and red roof`, `red and white`).
    fn continues(&self, words: &[String]) -> bool {
        let follows = self.ahead(1);
        let (is_and, has_trait) = (self.ahead(0) == "and", words.iter().any(|word| word == "with"));
        let is_pair =
            words.last().is_some_and(|word| is_color(word)) && is_color(follows) && !self.is_end(self.mind.next + 2);
        is_and && !super::verbs::is_verb(follows) && (is_pair || has_trait && is_color(follows))
    }

    /// After `of the two apples`, `the smaller one` is one of those.
    fn choose_among(&mut self, words: &mut Vec<String>) {
        let is_comparison = words.first().is_some_and(|word| COMPARATIVES.contains(&word.as_str()));
        if self.mind.among.is_empty() || !is_comparison || words.len() > 2 {
            return;
        }
        words.truncate(1);
        words.extend(["of", "the"].map(String::from));
        words.append(&mut self.mind.among);
    }

    /// Replaces `one` by the noun it stands for, and remembers the noun.
    fn complete(&mut self, words: &mut [String]) {
        let is_one = |word: &String| word == "one" || word == "ones";
        if let (Some(last), Some(noun)) = (words.last_mut().filter(|last| is_one(last)), &self.mind.noun) {
            last.clone_from(noun);
        }
        let after = ["with", "without", "of", "marked", "lettered"];
        let head = words.iter().take_while(|word| !after.contains(&word.as_str())).last();
        if let Some(head) = head.filter(|head| !is_one(head)) {
            self.mind.noun = Some(head.clone());
        }
    }
}

/// True if the noun of a phrase is the plural of a noun for whole objects; `sardines` mean one tin.
fn is_plural(words: &[String]) -> bool {
    lexicon().is_plural(last(words))
}

/// The noun of a phrase without traits; empty if there are no words.
fn last(words: &[String]) -> &str {
    let after = ["with", "without", "marked", "lettered", "of"];
    words.iter().take_while(|word| !after.contains(&word.as_str())).last().map_or("", String::as_str)
}

/// Brings `leftmost mug` and `mug farthest to the left` into the form `mug farthest to the robot's left`.
fn outermost(words: &mut Vec<String>) {
    let sides = [("leftmost", "left"), ("rightmost", "right")];
    if let Some((index, side)) =
        sides.iter().find_map(|(word, side)| Some((words.iter().position(|w| w == word)?, side)))
        && words.len() > 1
    {
        words.remove(index);
        words.extend(["farthest", "to", "the", "robot's", side].map(String::from));
    }
    if let [.., farthest, to, the, side] = words.as_slice()
        && farthest == "farthest"
        && (to == "to" || to == "on")
        && the == "the"
        && (side == "left" || side == "right")
    {
        let side = side.clone();
        words.truncate(words.len() - 3);
        words.extend(["to", "the", "robot's", &side].map(String::from));
    }
}
