//! Grammar of robot instructions: parses a fragment of English into commands.
//!
//! Clauses without a command are kept as context. A place after the verb's object is the destination of that object; a
//! place inside a description follows `that is`.

use genmanip_core::Relation;

use super::lexicon::is_color;

/// One request.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Command {
    /// Bring objects to a place, or to one of several.
    Put { subjects: Vec<Group>, places: Vec<Place> },
    /// Change the state of an object.
    Change { object: Group, part: Option<Part>, action: Action },
    /// Exactly one of these.
    Either(Vec<Command>),
}

/// A noun phrase.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Group {
    /// Its words without the article.
    pub words: Vec<String>,
    /// Location of the object, from a relative clause.
    pub at: Option<Box<Place>>,
}

/// A preposition with one noun phrase or two.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Place {
    /// Relations that the preposition can mean.
    pub relations: &'static [Relation],
    pub objects: Vec<Group>,
}

/// Part of an articulated object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Upper,
    Lower,
    Both,
    Other,
}

/// Change of state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    Open,
    Close,
    On,
    Off,
    Low,
    High,
    Press,
}

use Relation::{Back, Between, Front, In, Left, Near, On, Right, Top};

/// Prepositions, longer ones first. The designer has a table of its own, so that the reader checks it.
pub(super) const PLACES: [(&str, &[Relation]); 18] = [
    ("on the far side of", &[Front]),
    ("on the robot's side of", &[Back]),
    ("to the robot's left of", &[Left]),
    ("to the robot's right of", &[Right]),
    // The camera faces the robot.
    ("on the camera's side of", &[Front]),
    ("to the camera's left of", &[Right]),
    ("to the camera's right of", &[Left]),
    ("on top of", &[On, Top]),
    ("next to", &[Near]),
    ("close to", &[Near]),
    ("beside", &[Near]),
    ("near", &[Near]),
    ("between", &[Between]),
    ("inside", &[In, Top]),
    ("into", &[In, Top]),
    ("onto", &[On, Top]),
    ("in", &[In, Top]),
    ("on", &[On, Top]),
];

/// First words of noun phrases.
const DETERMINERS: [&str; 11] =
    ["the", "a", "an", "some", "my", "what", "whatever", "something", "both", "another", "one"];
const TAKE: [&str; 5] = ["pick up", "take", "grab", "find", "fetch"];
const PUT: [&str; 6] = ["put", "place", "set", "move", "stack", "bring"];
const STATE: [&str; 15] = [
    "open", "close", "shut", "pull", "push", "lift", "raise", "lower", "flip", "fold", "swing", "turn", "switch",
    "press", "set",
];
const PARTICLES: [&str; 13] = [
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
const JOINERS: [&str; 18] = [
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

/// A parsed instruction.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Parsed {
    /// Requests in the order of the sentence.
    pub commands: Vec<Command>,
    /// All clauses without a command, in lower case.
    pub context: String,
}

/// Parses an instruction; `None` if it has no command or a command is outside the grammar.
pub(super) fn read(instruction: &str) -> Option<Parsed> {
    let text = instruction.to_lowercase();
    let mut parsed = Parsed::default();
    for sentence in text.split(['.', '?', '!']) {
        let (sentence, reason) = sentence.split_once(", because ").unwrap_or((sentence, ""));
        let (before, after) = sentence.split_once(':').unwrap_or(("", sentence));
        parsed.context += &format!(" {before} {reason}");
        let mut reader = Reader::new(after);
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
    }
    (!parsed.commands.is_empty()).then_some(parsed)
}

struct Reader {
    words: Vec<String>,
    next: usize,
}

impl Reader {
    fn new(text: &str) -> Self {
        let spaced = text.replace(',', " , ").replace(';', " ; ");
        Self { words: spaced.split_whitespace().map(String::from).collect(), next: 0 }
    }

    fn is_done(&self) -> bool {
        self.next >= self.words.len()
    }

    fn word(&self, index: usize) -> &str {
        self.words.get(index).map_or("", String::as_str)
    }

    /// Number of words of `phrase` if it comes next.
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
        let start = self.next;
        let command = self.take("i want").then(|| {
            let subject = self.group()?;
            self.take("to be").then_some(())?;
            let places = self.places()?;
            Some(Command::Put { subjects: vec![subject], places })
        });
        let command = command.flatten();
        if command.is_none() {
            self.next = start;
        }
        command
    }

    fn command(&mut self) -> Option<Command> {
        if self.take("either") {
            let mut options = vec![self.command()?];
            while self.take(",") || self.take("or") {
                if !self.is_done() && self.at("or").is_none() {
                    options.push(self.command()?);
                }
            }
            return Some(Command::Either(options));
        }
        if self.take_any(&TAKE).is_some() {
            let subject = self.group()?;
            self.take("and").then_some(())?;
            self.take_any(&PUT)?;
            self.take("it").then_some(())?;
            let places = self.places()?;
            return Some(Command::Put { subjects: vec![subject], places });
        }
        let start = self.next;
        if let Some(command) = self.put() {
            return Some(command);
        }
        self.next = start;
        self.change()
    }

    /// Parses a request with its verb, or without one after another request.
    fn put(&mut self) -> Option<Command> {
        let verb = self.take_any(&PUT);
        if verb.is_none() && STATE.iter().any(|verb| self.at(verb).is_some()) {
            return None;
        }
        self.take("both");
        let mut subjects = vec![self.group()?];
        while self.take("and") {
            subjects.push(self.group()?);
        }
        let places = self.places()?;
        Some(Command::Put { subjects, places })
    }

    fn places(&mut self) -> Option<Vec<Place>> {
        while self
            .take_any(&["so that it is", "so that it ends up", "together", "either", "both", "down", ","])
            .is_some()
        {}
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
        let mut objects = vec![self.group()?];
        if relations == [Between] && self.take("and") {
            objects.push(self.group()?);
        }
        Some(Place { relations, objects })
    }

    /// The preposition at an index, unless it ends the clause.
    fn preposition(&self, index: usize) -> Option<(&'static [Relation], usize)> {
        let (relations, length) = PLACES
            .iter()
            .find_map(|(phrase, relations)| self.at_index(index, phrase).map(|length| (*relations, length)))?;
        let follows = self.word(index + length);
        let ends = follows.is_empty() || [",", ";", "and", "or", "its"].contains(&follows);
        // A location continues with a determiner: `on the`, `in a`. Descriptions such as `lettered in red` or `with a
        // cross on top` do not.
        let bare = ["in", "on"].contains(&self.word(index)) && length == 1 && !DETERMINERS.contains(&follows);
        (!ends && !bare).then_some((relations, length))
    }

    fn group(&mut self) -> Option<Group> {
        let mut words = Vec::new();
        let mut at = None;
        if ["the", "a", "an", "some", "my"].contains(&self.word(self.next)) {
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
            let stops = [",", ";", "and", "or", "so", "together", "both", "either", "down"];
            let goes_on = self.word(self.next) == "and" && self.continues(&words);
            let stops = stops.contains(&self.word(self.next)) && !goes_on;
            let ends = stops || self.at("to be").is_some() || self.at_particle();
            if ends || self.preposition(self.next).is_some() {
                break;
            }
            words.push(self.word(self.next).to_owned());
            self.next += 1;
        }
        (!words.is_empty()).then_some(Group { words, at })
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
        let part = self.part();
        let object = self.group()?;
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

fn action(verb: &str, particle: Option<&str>) -> Option<Action> {
    Some(match (verb, particle) {
        ("open" | "lift" | "raise", None | Some("up")) | ("pull", Some("out" | "open")) => Action::Open,
        ("flip" | "swing" | "push" | "open", Some("open")) => Action::Open,
        ("close" | "lower", None | Some("down")) | ("push" | "fold" | "pull", Some("shut")) | ("shut", None) => {
            Action::Close
        }
        ("turn" | "switch", Some("on")) => Action::On,
        ("turn" | "switch" | "shut" | "set", Some("off" | "to off")) => Action::Off,
        ("turn" | "set", Some("to low")) => Action::Low,
        ("turn" | "set", Some("to high" | "all the way up")) => Action::High,
        ("press", None | Some("down")) | ("push", Some("down")) => Action::Press,
        _ => return None,
    })
}
