//! Requests: a verb with its objects, a statement of where or how something should be, or a phrase with a place.

use genmanip_core::Relation;

use super::super::change::{Action, Part, action};
use super::super::grammar::{Command, Group, Number, Place};
use super::Listener;
use super::verbs::{Class, is_verb};

/// Phrases before the object of a wish.
const WISHES: [&str; 43] = [
    "i want",
    "i want for",
    "i would like for",
    "i would like",
    "i would love",
    "i would prefer",
    "i need",
    "we need",
    "we want",
    "i would rather have",
    "make sure that",
    "make sure",
    "ensure that",
    "ensure",
    "see to it that",
    "see that",
    "check that",
    "let",
    "have",
    "get",
    "i wish",
    "can i have",
    "could i have",
    "may i have",
    "can we have",
    "could we have",
    "could",
    "can",
    "would",
    "may",
    "might",
    "there should be",
    "there must be",
    "there needs to be",
    "there has to be",
    "there ought to be",
    "i want there to be",
    "i would like there to be",
    "make sure that there is",
    "make sure there is",
    "make sure there are",
    "ensure there is",
    "there should end up being",
];
/// Words between an object and where or how it should be.
const COPULAS: [&str; 51] = [
    "should", "must", "shall", "ought", "to", "needs", "need", "has", "have", "will", "can", "could", "would", "may",
    "be", "being", "is", "are", "supposed", "meant", "going", "go", "goes", "end", "ends", "up", "stand", "stands",
    "standing", "lie", "lies", "lying", "sit", "sits", "sitting", "stay", "rest", "rests", "live", "lives", "belong",
    "belongs", "hang", "hangs", "come", "comes", "all", "both", "now", "also", "wants",
];
/// Words without which a phrase with a place states a fact.
const DUTIES: [&str; 22] = [
    "should", "must", "shall", "ought", "needs", "need", "to", "go", "goes", "belongs", "belong", "can", "could",
    "would", "wants", "has", "have", "will", "comes", "lives", "supposed", "may",
];
/// Particles of a change of state.
const PARTICLES: [&str; 11] = ["wide open", "open", "shut", "closed", "on", "off", "out", "up", "down", "in", "to off"];
/// Levels of a knob.
const LEVELS: [(&str, &str); 12] = [
    ("high", "high"),
    ("full", "high"),
    ("full power", "high"),
    ("full blast", "high"),
    ("max", "high"),
    ("maximum", "high"),
    ("the maximum", "high"),
    ("the highest setting", "high"),
    ("low", "low"),
    ("minimum", "low"),
    ("the minimum", "low"),
    ("the lowest setting", "low"),
];
const PARTS: [(&str, Part); 16] = [
    ("top drawer", Part::Upper),
    ("topmost drawer", Part::Upper),
    ("upper drawer", Part::Upper),
    ("bottom drawer", Part::Lower),
    ("bottommost drawer", Part::Lower),
    ("lower drawer", Part::Lower),
    ("drawers", Part::Both),
    ("two drawers", Part::Both),
    ("door", Part::Other),
    ("lid", Part::Other),
    ("cover", Part::Other),
    ("flap", Part::Other),
    ("screen", Part::Other),
    ("display", Part::Other),
    ("handle", Part::Other),
    ("front", Part::Other),
];

impl Listener {
    /// Commands of the request that begins here; `None` if there is none.
    pub(super) fn request(&mut self) -> Option<Vec<Command>> {
        self.choice();
        let parsers = [
            Self::tower,
            Self::state,
            Self::take_up,
            Self::carry,
            Self::wish,
            Self::given,
            Self::statement,
            Self::fragment,
            Self::named,
        ];
        for parse in parsers {
            let found = self.attempt(|listener| {
                listener.mind.source = None;
                let commands = parse(listener)?;
                if listener.at_boundary() {
                    return Some(commands);
                }
                let rest = listener.clause(listener.mind.next);
                listener.blame(format!("`{rest}` is not understood"))
            });
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// Remembers `of the two apples,` for the next phrase.
    fn choice(&mut self) {
        let found = self.attempt(|listener| {
            listener.take_any(&["of the", "from the", "out of the"])?;
            let is_number = ["two", "three"].contains(&listener.ahead(0));
            let end = (1..5).find(|&offset| listener.ahead(offset) == ",").filter(|_| is_number)?;
            let start = listener.mind.next;
            listener.mind.next += end + 1;
            Some(listener.tokens[start..start + end].to_vec())
        });
        if let Some(among) = found {
            self.mind.among = among;
        }
    }

    /// Takes a verb of a class; returns its base form.
    fn verb(&mut self, class: Class) -> Option<&'static str> {
        let mut phrases: Vec<&'static str> = class.phrases().collect();
        phrases.sort_by_key(|phrase| std::cmp::Reverse(phrase.len()));
        let several = phrases.into_iter().find_map(|phrase| {
            let (first, rest) = phrase.split_once(' ')?;
            let length = self.at_index(self.mind.next + 1, rest)?;
            (class.base(self.ahead(0)) == class.base(first) && class.base(first).is_some())
                .then_some((phrase, length + 1))
        });
        if let Some((phrase, length)) = several {
            self.mind.next += length;
            return Some(phrase);
        }
        let base = class.base(self.ahead(0))?;
        self.mind.next += 1;
        Some(base)
    }

    /// Parses `build a tower with the blue cube at the bottom, …`.
    fn tower(&mut self) -> Option<Vec<Command>> {
        self.verb(Class::Build)?;
        self.take_any(&["me", "us"]);
        let names =
            ["a tower", "a stack", "a pile", "a column", "one tower", "the tower", "a little tower", "a small tower"];
        let is_named = self.take_any(&names).is_some();
        if is_named {
            self.take_any(&["with", "of", "from", "out of", "using", "made of", "made from", "consisting of"]);
            while self.take_any(&[",", "out of"]).is_some() {}
        }
        let (lowest, middle, highest) = (
            ["at the bottom", "on the bottom", "at the base", "as the base", "lowest", "in the bottom"],
            ["in the middle", "in between", "in the centre", "in the center"],
            ["on top", "at the top", "on the top", "uppermost", "at the very top", "on the very top"],
        );
        let mut items: Vec<(Option<usize>, Group)> = Vec::new();
        loop {
            let before = self.position(&[&lowest, &middle, &highest]);
            self.take_any(&[","]);
            let group = self.noun_phrase()?;
            while self.take_any(&["goes", "is", "comes", "should be", "go", "should go"]).is_some() {}
            let level = before.or_else(|| self.position(&[&lowest, &middle, &highest]));
            items.push((level, group));
            let joined = self.attempt(|listener| {
                let mut is_joined = false;
                while listener.take_any(&[",", "and", "then"]).is_some() {
                    is_joined = true;
                }
                (is_joined && !is_verb(listener.ahead(0)) && !listener.is_done() && listener.ahead(0) != ".")
                    .then_some(())
            });
            if joined.is_none() {
                break;
            }
        }
        let on_each_other = ["on top of each other", "on top of one another", "on each other", "into a tower", "up"];
        let in_order = ["in this order", "in that order", "from bottom to top", "from the bottom up", "bottom to top"];
        let is_stack = self.take_any(&on_each_other).is_some() | is_named;
        if self.take_any(&["from top to bottom", "top to bottom"]).is_some() {
            items.reverse();
            items.iter_mut().for_each(|(level, _)| *level = Some(0));
        } else if self.take_any(&in_order).is_some() {
            items.iter_mut().for_each(|(level, _)| *level = Some(0));
        }
        let several = matches!(items.as_slice(), [(_, group)] if group.number != Number::One);
        if !several
            && items.iter().any(|(level, _)| level.is_none())
            && items.iter().filter(|(level, _)| level.is_some()).count() < 2
        {
            return if is_stack {
                self.blame("which object of the tower is at the bottom and which on top?")
            } else {
                None
            };
        }
        if items.len() < 2 && !(several && is_stack) {
            return None;
        }
        items.sort_by_key(|(level, _)| level.unwrap_or(1));
        let groups: Vec<Group> = items.into_iter().map(|(_, group)| group).collect();
        self.remember(groups.clone());
        Some(vec![Command::Tower(groups)])
    }

    fn position(&mut self, levels: &[&[&str]]) -> Option<usize> {
        levels.iter().position(|phrases| self.take_any(phrases).is_some())
    }

    /// Parses a change of state: `flick the fan switch on`, `pull out the top drawer of the cabinet`.
    fn state(&mut self) -> Option<Vec<Command>> {
        let verb = self.verb(Class::State)?;
        let mut particle = self.take_any(&PARTICLES).or_else(|| self.level());
        self.take_any(&["on"]);
        let mut objects = self.changed_objects()?;
        particle = self.level().or_else(|| self.take_any(&PARTICLES)).or(particle);
        particle = self.level().or(particle);
        self.take_any(&["again", "all the way", "fully", "wide"]);
        if verb == "lift" && particle.is_none() && objects.iter().all(|object| object.part.is_none()) {
            return None;
        }
        let Some(action) = action(verb, particle) else { return None };
        self.changes(&mut objects, action)
    }

    fn changes(&mut self, objects: &mut [Group], action: Action) -> Option<Vec<Command>> {
        self.remember(objects.to_vec());
        self.mind.place = None;
        let change = |object: &Group| Command::Change { object: object.clone(), part: object.part, action };
        Some(objects.iter().map(change).collect())
    }

    /// Objects whose state changes, with the part that is named.
    fn changed_objects(&mut self) -> Option<Vec<Group>> {
        let part = self.attempt(|listener| {
            listener.take_any(&["the", "both", "both the", "a", "its"]);
            let part = PARTS.iter().find_map(|(phrase, part)| listener.take(phrase).then_some(*part))?;
            listener.take_any(&["of", "on"]).map(|_| part)
        });
        // `put the battery in the box and close it`: what has a lid is not what was carried.
        let holder = self.mind.place.clone().filter(|place| place.relations.contains(&Relation::In));
        if let Some(place) = holder
            && self.attempt(Self::pronoun).is_some()
        {
            return Some(place.objects);
        }
        let mut groups = self.noun_phrases()?;
        if part.is_some() {
            groups.iter_mut().for_each(|group| group.part = part);
        }
        Some(groups)
    }

    /// A level such as `to high` or `up to the maximum`, in the words of the table of actions.
    fn level(&mut self) -> Option<&'static str> {
        self.attempt(|listener| {
            listener.take_any(&["up", "down", "all the way up", "all the way", "right up"]);
            let is_said = listener.take_any(&["to", "on", "onto", "at"]).is_some();
            let names: Vec<&str> = LEVELS.iter().map(|(name, _)| *name).collect();
            let name = listener.take_any(&names).filter(|_| is_said)?;
            listener.take_any(&["heat", "setting", "power"]);
            LEVELS.iter().find(|(said, _)| *said == name).map(|(_, level)| *level)
        })
        .or_else(|| self.take("all the way up").then_some("high"))
    }

    /// Parses `take the orange out of the bowl`; where it goes may follow.
    fn take_up(&mut self) -> Option<Vec<Command>> {
        let verb = self.verb(Class::Take)?;
        self.take_any(&["me", "us", "out", "up"]);
        let mut subjects = self.noun_phrases()?;
        self.come_from(&mut subjects)?;
        while self.take_any(&["up", "out", "off", "away"]).is_some() {}
        if !self.at_boundary() {
            let place = self.attempt(Self::places);
            let Some(places) = place else { return None };
            let (before, is_next) = (self.mind.next, self.puts_it());
            self.mind.next = before;
            if !is_next {
                if verb == "raise" || verb == "hold" {
                    return None;
                }
                return self.put(subjects, places);
            }
            let ([subject], [place]) = (subjects.as_mut_slice(), places.as_slice()) else { return None };
            subject.at = Some(Box::new(place.clone()));
        }
        self.mind.pending.clone_from(&subjects);
        self.remember(subjects);
        Some(Vec::new())
    }

    /// True if `and put it` comes next.
    fn puts_it(&mut self) -> bool {
        self.skip_courtesies();
        self.verb(Class::Carry).is_some() && self.take_any(&["it", "them", "that"]).is_some()
    }

    /// Notes where the objects are taken from.
    fn come_from(&mut self, subjects: &mut [Group]) -> Option<()> {
        while super::places::is_source(self, self.mind.next) {
            let source = self.source()?;
            if let ([subject], Some(place)) = (&mut *subjects, &source)
                && subject.at.is_none()
            {
                subject.at = Some(Box::new(place.clone()));
            } else if subjects.len() > 1 && source.is_some() {
                for subject in subjects.iter_mut().filter(|subject| subject.at.is_none()) {
                    subject.at = source.clone().map(Box::new);
                }
            }
            self.mind.source = source;
        }
        Some(())
    }

    /// Parses a verb with objects and a place: `park the toy car behind the cube`.
    fn carry(&mut self) -> Option<Vec<Command>> {
        let verb = self.verb(Class::Carry)?;
        while self.take_any(&["me", "us", "down", "up", "back", "over", "away", "aside"]).is_some() {}
        let is_pronoun = ["it", "them", "that", "both", "this"].contains(&self.ahead(0));
        let mut subjects = self.noun_phrases()?;
        if is_pronoun {
            self.mind.pending.clear();
        }
        // `put the apple and put it …`
        self.come_from(&mut subjects)?;
        // `put the apple or the pear in the bowl`
        let other = self.attempt(|listener| {
            listener.take("or").then_some(())?;
            listener.noun_phrase()
        });
        let elliptic =
            self.mind.place.clone().filter(|_| verb == "add" || self.ahead(0) == "too" || self.at("as well").is_some());
        let places = match self.attempt(Self::places) {
            Some(places) => places,
            None => match elliptic.filter(|_| self.at_boundary()) {
                Some(place) => vec![place],
                None => {
                    let said: Vec<String> = subjects.iter().map(|subject| subject.words.join(" ")).collect();
                    if self.at_boundary()
                        || ["there", "here", "away", "aside"].contains(&self.ahead(0))
                        || self.at("over there").is_some()
                    {
                        return self.blame(format!("no place is given for `{}`", said.join(" and ")));
                    }
                    return None;
                }
            },
        };
        self.come_from(&mut subjects)?;
        if let Some(other) = other {
            let one = self.put(subjects, places.clone())?;
            let other = self.put(vec![other], places)?;
            return Some(vec![Command::Either([one, other].concat())]);
        }
        // `put the apple in the bowl on the plate`: the first place is the present location of the apple.
        if let ([subject], [from]) = (subjects.as_mut_slice(), places.as_slice())
            && subject.at.is_none()
            && from.relations.iter().any(|relation| relation.is_support())
            && super::places::begins(self)
        {
            subject.at = Some(Box::new(from.clone()));
            let places = self.places()?;
            return self.put(subjects, places);
        }
        self.put(subjects, places)
    }

    /// The command that brings objects to a place; a second place after a comma is a second condition.
    fn put(&mut self, subjects: Vec<Group>, places: Vec<Place>) -> Option<Vec<Command>> {
        let mut commands = vec![Command::Put { subjects: subjects.clone(), places: places.clone() }];
        if let Some(more) = self.attempt(|listener| {
            listener.take_any(&[",", "and"]);
            let is_beside = super::places::begins(listener);
            let place = is_beside.then(|| listener.place()).flatten()?;
            (place.relations.iter().all(|relation| !relation.is_support()) && listener.at_boundary()).then_some(place)
        }) {
            commands.push(Command::Put { subjects: subjects.clone(), places: vec![more] });
        }
        let mut objects = places.iter().flat_map(|place| &place.objects);
        if objects.any(|object| subjects.iter().any(|subject| subject.words == object.words)) {
            return self.blame("the sentence leaves open which object goes where");
        }
        self.remember(subjects);
        Some(commands)
    }

    fn remember(&mut self, groups: Vec<Group>) {
        self.mind.topic = groups;
    }

    /// Parses `I want the mug on the plate`, `make sure the tap is off`, `could the glass go to the left of the jug`.
    fn wish(&mut self) -> Option<Vec<Command>> {
        // `grandma needs her mug on the tray`
        if self.take_any(&WISHES).is_none() {
            let offset = (1..4).find(|&offset| ["needs", "wants", "need", "want"].contains(&self.ahead(offset)))?;
            self.mind.next += offset + 1;
            (!self.is_end(self.mind.next) && self.ahead(0) != "to").then_some(())?;
        }
        self.take("that");
        let mut subjects = self.changed_objects()?;
        self.copula();
        self.goal(&mut subjects)
    }

    /// Parses `the toy car should be parked behind the cube`, `the eggs go in the pan`, `the oven needs closing`.
    fn statement(&mut self) -> Option<Vec<Command>> {
        let mut subjects = self.changed_objects()?;
        let start = self.mind.next;
        self.copula();
        let is_duty = self.tokens[start..self.mind.next].iter().any(|word| DUTIES.contains(&word.as_str()));
        is_duty.then_some(())?;
        self.goal(&mut subjects)
    }

    /// Skips the words between an object and its place or state.
    fn copula(&mut self) {
        loop {
            let word = self.ahead(0);
            let is_place = super::places::begins(self);
            let is_verb = Class::Carry.base(word).is_some() && word != "left" && self.at("put on").is_none();
            if is_place || !(COPULAS.contains(&word) || is_verb) {
                return;
            }
            self.mind.next += 1;
        }
    }

    /// Where or how objects should be.
    fn goal(&mut self, subjects: &mut Vec<Group>) -> Option<Vec<Command>> {
        if let Some(action) = self.attempt(Self::wanted_state) {
            return self.changes(subjects, action);
        }
        self.come_from(subjects)?;
        self.copula();
        let places = self.attempt(Self::places)?;
        self.come_from(subjects)?;
        self.put(std::mem::take(subjects), places)
    }

    /// Parses `closed`, `switched on`, `off`, `to be opened`, `turned to high` at the end of a clause.
    fn wanted_state(&mut self) -> Option<Action> {
        let before = self.ahead(0).to_owned();
        let adjective =
            self.take_any(&["wide open", "open", "opened", "shut", "closed", "on", "off", "pressed", "pushed"]);
        let found = match adjective {
            Some("on") => Action::On,
            Some("off") => Action::Off,
            Some("pressed" | "pushed") => {
                self.take_any(&["down", "in"]);
                Action::Press
            }
            Some("wide open" | "open" | "opened") => Action::Open,
            Some(_) => Action::Close,
            None => {
                let verb = Class::State.base(&before);
                if verb.is_some() {
                    self.mind.next += 1;
                }
                let particle = self.level().or_else(|| self.take_any(&PARTICLES));
                action(verb.unwrap_or("turn"), particle)?
            }
        };
        self.at_boundary().then_some(found)
    }

    /// Parses a fact about the initial scene: `the potato is already in the pot`, `there is an apple in the bowl`.
    fn given(&mut self) -> Option<Vec<Command>> {
        let is_there = self.take_any(&["there is already", "there is", "there are", "here is"]).is_some();
        let mut group = self.noun_phrase()?;
        if !is_there {
            self.take_any(&[
                "is already",
                "is currently",
                "is still",
                "is now",
                "is",
                "are already",
                "are currently",
                "are",
            ])?;
            self.take_any(&["standing", "lying", "sitting"]);
        }
        let at = match group.at.take() {
            Some(at) => at,
            None => {
                self.skip_modifiers();
                Box::new(self.place()?)
            }
        };
        group.at = Some(at);
        self.remember(vec![group.clone()]);
        Some(vec![Command::Given(group)])
    }

    /// Parses `the red mug,` before `put it …`.
    fn named(&mut self) -> Option<Vec<Command>> {
        let group = self.noun_phrase()?;
        (self.ahead(0) == "," && is_verb(self.ahead(1)) && ["it", "them"].contains(&self.ahead(2))).then_some(())?;
        self.mind.pending = vec![group.clone()];
        self.remember(vec![group]);
        Some(Vec::new())
    }

    /// Parses a phrase with a place, without a verb.
    fn fragment(&mut self) -> Option<Vec<Command>> {
        let mut subjects = self.noun_phrases()?;
        self.come_from(&mut subjects)?;
        let last = self.mind.place.clone().filter(|_| self.ahead(0) == "too" || self.at("as well").is_some());
        let places = match self.attempt(Self::places) {
            Some(places) => places,
            None => vec![last?],
        };
        self.put(subjects, places)
    }
}
