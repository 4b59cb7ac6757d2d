//! Requests: a verb with its objects, a statement of where or how something should be, or a phrase with a place.

use super::super::command::{Command, Group, Place};
use super::listener::Listener;
use super::verbs::{Class, is_verb};
use super::words::{COPULAS, DUTIES, WISHES};

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
    pub(super) fn verb(&mut self, class: Class) -> Option<&'static str> {
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

    /// Parses `take the orange out of the bowl`; where it goes may follow.
    fn take_up(&mut self) -> Option<Vec<Command>> {
        let verb = self.verb(Class::Take)?;
        self.take_any(&["me", "us", "out", "up"]);
        let mut subjects = self.noun_phrases()?;
        self.take_any(&["up"]);
        self.come_from(&mut subjects)?;
        while self.take_any(&["up", "out", "off", "away"]).is_some() {}
        // `off the tray and onto a plate`
        if self.ahead(0) == "and" && super::places::begins_at(self, self.mind.next + 1) {
            self.mind.next += 1;
        }
        if !self.at_boundary() {
            let places = self.attempt(Self::places)?;
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

    pub(super) fn remember(&mut self, groups: Vec<Group>) {
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

    /// Requested places or states of objects.
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
