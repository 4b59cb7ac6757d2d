//! Grammar of robot instructions: parses a fragment of English into commands.
//!
//! Clauses without a command are kept as context. A place after the verb's object is the destination of that object; a
//! place inside a description follows `that is`.

use genmanip_core::Relation;

use super::change::{Part, action, own_part};
use super::command::{Command, Group, Parsed, Place};
use super::lexicon::is_color;
use super::spoken;
use super::words::{
    ADVERBS, ARTICLES, DETERMINERS, ENDS, EXTREMES, JOINERS, LOOSE, PARTICLES, PLACES, PRONOUNS, PUT, SOURCE, SOURCES,
    SPELLINGS, STATE, TAKE,
};

/// Parses an instruction; `None` if it has no command or a command is outside the grammar.
pub(super) fn read(instruction: &str) -> Option<Parsed> {
    readings(instruction).next()
}

/// The parsed instruction, read as a plain request and as people speak; the second reading is made only on demand.
pub(super) fn readings(instruction: &str) -> impl Iterator<Item = Parsed> {
    let text = instruction.to_lowercase();
    let plain = read_plain(&text).into_iter();
    plain.chain(std::iter::once_with(move || spoken::hear(&text).ok()).flatten())
}

fn read_plain(text: &str) -> Option<Parsed> {
    let mut parsed = Parsed::default();
    let mut spoken_of = (None, None);
    for sentence in text.split(['.', '?', '!']) {
        let (sentence, reason) = sentence.split_once(", because ").unwrap_or((sentence, ""));
        let (before, after) = sentence.split_once(':').unwrap_or(("", sentence));
        parsed.context += &format!(" {before} {reason}");
        let mut reader = Reader::new(after);
        (reader.object, reader.place) = std::mem::take(&mut spoken_of);
        reader.skip_joiners();
        let tower = before.trim().ends_with("tower");
        if reader.is_done() || !(reader.begins_command() || tower) {
            parsed.context += &format!(" {after}");
            continue;
        }
        if let Some(command) = reader.desire() {
            reader.skip_joiners();
            if reader.is_done() {
                parsed.commands.push(command);
                continue;
            }
            return None;
        }
        if reader.at("i want").is_some() {
            parsed.context += &format!(" {after}");
            continue;
        }
        while !reader.is_done() {
            parsed.commands.push(reader.command()?);
            reader.skip_joiners();
        }
        spoken_of = (reader.object, reader.place);
    }
    (!parsed.commands.is_empty()).then_some(parsed)
}

struct Reader {
    words: Vec<String>,
    next: usize,
    /// Noun of the last noun phrase, to which `one` in the next phrase refers; `None` before the first.
    noun: Option<String>,
    /// Object of the last request, to which `it` refers; `None` before the first.
    object: Option<Group>,
    /// Object of the last place, to which `it` in another place refers, and whether it holds things inside; `None` before
    /// the first.
    place: Option<(Group, bool)>,
}

impl Reader {
    fn new(text: &str) -> Self {
        let spaced = text.replace(',', " , ").replace(';', " ; ");
        let words = spaced.split_whitespace().map(|word| {
            let spelling = SPELLINGS.iter().find(|(other, _)| *other == word);
            spelling.map_or(word, |(_, usual)| usual).to_owned()
        });
        Self { words: words.collect(), next: 0, noun: None, object: None, place: None }
    }

    fn is_done(&self) -> bool {
        self.next >= self.words.len()
    }

    fn word(&self, index: usize) -> &str {
        self.words.get(index).map_or("", String::as_str)
    }

    /// Number of words of `phrase` if the next words are those of the phrase; `None` otherwise.
    fn at(&self, phrase: &str) -> Option<usize> {
        self.at_index(self.next, phrase)
    }

    fn at_index(&self, index: usize, phrase: &str) -> Option<usize> {
        let mut length = 0;
        for word in phrase.split(' ') {
            if self.word(index + length) != word {
                return None;
            }
            length += 1;
        }
        Some(length)
    }

    fn take(&mut self, phrase: &str) -> bool {
        let length = self.at(phrase);
        self.next += length.unwrap_or(0);
        length.is_some()
    }

    fn take_any<'p>(&mut self, phrases: &[&'p str]) -> Option<&'p str> {
        phrases.iter().copied().find(|phrase| self.take(phrase))
    }

    fn skip_joiners(&mut self) {
        while self.take_any(&JOINERS).is_some() {}
    }

    fn begins_command(&self) -> bool {
        let begins = |phrase: &&str| self.at(phrase).is_some();
        TAKE.iter().any(begins)
            || PUT.iter().any(begins)
            || STATE.iter().any(begins)
            || ["either", "i want"].iter().any(begins)
    }

    /// Parses `I want … to be somewhere`.
    fn desire(&mut self) -> Option<Command> {
        self.attempt(|reader| {
            reader.take("i want").then_some(())?;
            let subject = reader.group()?;
            reader.take("to be").then_some(())?;
            let places = reader.places()?;
            Some(Command::Put { subjects: vec![subject], places })
        })
    }

    /// Runs a parser, and returns to the position before it if it fails.
    fn attempt(&mut self, parse: impl FnOnce(&mut Self) -> Option<Command>) -> Option<Command> {
        let start = self.next;
        let command = parse(self);
        if command.is_none() {
            self.next = start;
        }
        command
    }

    fn command(&mut self) -> Option<Command> {
        let command = self.one_command()?;
        self.remember(&command);
        Some(command)
    }

    /// Keeps the object of a request for later pronouns.
    fn remember(&mut self, command: &Command) {
        self.object = match command {
            Command::Put { subjects, .. } => subjects.last().cloned(),
            Command::Change { object, .. } => Some(object.clone()),
            Command::Either(_) | Command::Tower(_) | Command::Sides { .. } | Command::Given(_) => None,
        };
    }

    fn one_command(&mut self) -> Option<Command> {
        if self.take("either") {
            let mut options = vec![self.command()?];
            while self.take(",") || self.take("or") {
                if !self.is_done() && self.at("or").is_none() {
                    options.push(self.command()?);
                }
            }
            return Some(Command::Either(options));
        }
        let taken = self.attempt(Self::fetch);
        if taken.is_some() {
            return taken;
        }
        let put = self.attempt(Self::put);
        if put.is_some() {
            return put;
        }
        self.change()
    }

    /// Parses `take … and put it somewhere`; a location after the object is its present location.
    fn fetch(&mut self) -> Option<Command> {
        self.take_any(&TAKE)?;
        self.take("me");
        let mut subject = self.group()?;
        if subject.at.is_none() && self.preposition(self.next).is_some() {
            subject.at = Some(Box::new(self.place()?));
        }
        while self.take_any(&["up", ",", "and", "then"]).is_some() {}
        self.take_any(&PUT)?;
        self.take_any(&PRONOUNS)?;
        let places = self.places()?;
        Some(Command::Put { subjects: vec![subject], places })
    }

    /// Parses a request with its verb, or without one after another request.
    fn put(&mut self) -> Option<Command> {
        let verb = self.take_any(&PUT);
        if verb.is_none() && STATE.iter().any(|verb| self.at(verb).is_some()) {
            return None;
        }
        while self.take_any(&["me", "away", "back", "both"]).is_some() {}
        let mut subjects = vec![self.group()?];
        while self.take("and") {
            subjects.push(self.group()?);
        }
        let places = self.places()?;
        // `put the apple in the bowl on the plate`: the first place is the present location of the apple.
        if let ([subject], [from]) = (subjects.as_mut_slice(), places.as_slice())
            && subject.at.is_none()
            && from.relations.iter().any(|relation| relation.is_support())
            && self.preposition(self.next).is_some()
        {
            subject.at = Some(Box::new(from.clone()));
            return Some(Command::Put { subjects, places: self.places()? });
        }
        Some(Command::Put { subjects, places })
    }

    fn places(&mut self) -> Option<Vec<Place>> {
        while self.take_any(&ADVERBS).is_some() {}
        let mut places = vec![self.place()?];
        while self.take("or") {
            self.take("both");
            places.push(self.place()?);
        }
        Some(places)
    }

    fn place(&mut self) -> Option<Place> {
        let (relations, length) = self.preposition(self.next)?;
        self.next += length;
        let (last, is_pronoun) = (self.place.clone(), PRONOUNS.contains(&self.word(self.next)));
        let first = self.group()?;
        let support = |relations: &[Relation]| relations.iter().any(|relation| relation.is_support());
        // `put the cheese on the board and the bread next to it` leaves open next to which.
        if is_pronoun && !support(relations) && last.as_ref().is_some_and(|(_, holds)| !holds) {
            return None;
        }
        let last = last.map_or_else(|| first.clone(), |(group, _)| group);
        let mut objects = vec![if is_pronoun { last } else { first }];
        if relations == [Relation::Between] && self.take("and") {
            objects.push(self.group()?);
        }
        // `on the board next to the bread`: the second place is the location of the board.
        if let [object] = objects.as_mut_slice()
            && object.at.is_none()
            && support(relations)
            && self.preposition(self.next).is_some_and(|(next, _)| !support(next))
        {
            object.at = Some(Box::new(self.place()?));
        }
        self.place = objects.first().map(|object| (object.clone(), relations.contains(&Relation::In)));
        Some(Place { relations, objects })
    }

    /// Relations of the preposition at an index, and the index after it; `None` if there is none or it ends the clause.
    fn preposition(&self, index: usize) -> Option<(&'static [Relation], usize)> {
        let (relations, length) = PLACES
            .iter()
            .find_map(|(phrase, relations)| self.at_index(index, phrase).map(|length| (*relations, length)))?;
        let follows = self.word(index + length);
        let ends = follows.is_empty() || [",", ";", "and", "or", "its"].contains(&follows);
        // A location continues with a determiner: `on the`, `in a`. Descriptions such as `lettered in red` or `with a
        // cross on top` do not.
        let is_definite = DETERMINERS.contains(&follows) || PRONOUNS.contains(&follows);
        let bare = LOOSE.contains(&self.word(index)) && length == 1 && !is_definite;
        let compares = index > 0 && EXTREMES.contains(&self.word(index - 1));
        (!ends && !bare && !compares).then_some((relations, length))
    }

    fn group(&mut self) -> Option<Group> {
        let mut words: Vec<String> = Vec::new();
        let mut at = None;
        if ARTICLES.contains(&self.word(self.next)) {
            self.next += 1;
        }
        while !self.is_done() {
            let relative = ["that is", "that lies", "that stands"].iter().find_map(|phrase| self.at(phrase));
            let relative = relative.or_else(|| (words == ["whatever"]).then(|| self.at("is")).flatten());
            if let Some(length) = relative
                && self.preposition(self.next + length).is_some()
            {
                self.next += length;
                at = Some(Box::new(self.place()?));
                break;
            }
            let source = SOURCES.iter().find_map(|phrase| self.at(phrase));
            if let Some(length) = source
                && words.last().is_some_and(|word| !EXTREMES.contains(&word.as_str()))
                && DETERMINERS.contains(&self.word(self.next + length))
            {
                self.next += length;
                at = Some(Box::new(Place { relations: SOURCE, objects: vec![self.group()?] }));
                break;
            }
            let goes_on = self.word(self.next) == "and" && self.continues(&words);
            let stops = ENDS.contains(&self.word(self.next)) && !goes_on;
            let ends = stops || self.at("to be").is_some() || self.at_particle();
            if ends || self.preposition(self.next).is_some() {
                break;
            }
            words.push(self.word(self.next).to_owned());
            self.next += 1;
        }
        if words.last().is_some_and(|word| word == "one")
            && let (Some(noun), Some(last)) = (&self.noun, words.last_mut())
        {
            last.clone_from(noun);
        }
        if words.first().is_some_and(|word| words.len() == 1 && PRONOUNS.contains(&word.as_str())) {
            return self.object.clone();
        }
        let after = ["with", "without", "of", "that", "lettered", "marked"];
        let head = words.iter().take_while(|word| !after.contains(&word.as_str())).last();
        self.noun = head.cloned().or_else(|| self.noun.take());
        (!words.is_empty()).then_some(Group { at, ..Group::of(words) })
    }

    /// True if `and` continues a description (`with black wheels and red roof`) instead of naming another object.
    fn continues(&self, words: &[String]) -> bool {
        let follows = self.word(self.next + 1);
        let is_command = [&TAKE[..], &PUT, &STATE, &JOINERS].iter().any(|list| list.contains(&follows));
        let looks = is_color(follows) || words.iter().any(|word| word == "with");
        looks && !is_command && !DETERMINERS.contains(&follows) && !["it", "both"].contains(&follows)
    }

    /// True before a particle that ends a clause, as in `turn the faucet on`.
    fn at_particle(&self) -> bool {
        PARTICLES.iter().any(|particle| {
            self.at(particle).is_some_and(|length| {
                let follows = self.word(self.next + length);
                follows.is_empty() || [",", ";", "and", "or"].contains(&follows)
            })
        })
    }

    fn change(&mut self) -> Option<Command> {
        let verb = self.take_any(&STATE)?;
        let mut particle = self.take_any(&["on", "off", "out", "open", "down", "up"]);
        let mut part = self.part();
        let mut object = self.group()?;
        if part.is_none() {
            part = own_part(&mut object.words);
        }
        if self.at_particle() {
            particle = self.take_any(&PARTICLES).or(particle);
        }
        let action = action(verb, particle)?;
        Some(Command::Change { object, part, action })
    }

    fn part(&mut self) -> Option<Part> {
        let parts = [
            ("the top drawer of", Part::Upper),
            ("the upper drawer of", Part::Upper),
            ("the bottom drawer of", Part::Lower),
            ("the lower drawer of", Part::Lower),
            ("both drawers of", Part::Both),
            ("the door of", Part::Other),
            ("the lid of", Part::Other),
            ("the flap of", Part::Other),
            ("the screen of", Part::Other),
        ];
        parts.into_iter().find_map(|(phrase, part)| self.take(phrase).then_some(part))
    }
}
