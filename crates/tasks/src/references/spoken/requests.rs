//! Requests: a verb with its objects and where they go.

use genmanip_core::Relation;

use super::super::command::{Command, Group, Number, Place};
use super::listener::Listener;
use super::verbs::{Class, is_form};
use super::words::vocabulary;

type Parser = fn(&mut Listener) -> Option<Vec<Command>>;

/// Parsers of requests with a verb.
const VERBAL: [Parser; 10] = [
    Listener::swap,
    Listener::discard,
    Listener::listed,
    Listener::tower,
    Listener::state,
    Listener::touch,
    Listener::fill,
    Listener::take_up,
    Listener::carry,
    Listener::repeat,
];
/// Parsers of other requests and of facts about the initial scene.
const OTHER: [Parser; 6] =
    [Listener::wish, Listener::inverted, Listener::given, Listener::statement, Listener::fragment, Listener::named];

impl Listener {
    /// Commands of the request that begins here; `None` if there is none.
    pub(super) fn request(&mut self) -> Option<Vec<Command>> {
        self.choice();
        let plain = if self.asks() {
            self.attempt(Self::sought)
        } else {
            self.first_of(&VERBAL).or_else(|| self.first_of(&OTHER))
        };
        let plain = plain.or_else(|| self.attempt(Self::continued));
        plain.or_else(|| self.attempt(Self::wrapped)).or_else(|| self.attempt(Self::reported))
    }

    /// Commands of the first parser that reads as far as the end of a clause.
    fn first_of(&mut self, parsers: &[Parser]) -> Option<Vec<Command>> {
        parsers.iter().find_map(|parse| {
            self.attempt(|listener| {
                listener.mind.source = None;
                let commands = parse(listener)?;
                if listener.at_boundary() {
                    return Some(commands);
                }
                let rest = listener.clause(listener.mind.next);
                listener.blame(format!("`{rest}` is not understood"))
            })
        })
    }

    /// Parses a request after words of politeness, the fewest that leave one: `would it be possible to move …`,
    /// `it would be nice if the mug was …`.
    fn wrapped(&mut self) -> Option<Vec<Command>> {
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
    fn reported(&mut self) -> Option<Vec<Command>> {
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
            is_form(self.ahead(0), first).then_some((phrase, length + 1))
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
    pub(super) fn take_up(&mut self) -> Option<Vec<Command>> {
        let verb = self.verb(Class::Take)?;
        self.take_any(&["me", "us", "out", "up"]);
        let mut subjects = self.noun_phrases()?;
        self.take_any(&["up", "over there", "there", "here"]);
        let frees = self.frees(verb);
        self.come_from(&mut subjects)?;
        let mut leaves = frees && self.mind.source.is_some();
        while let Some(particle) = self.take_any(&["up", "out", "off", "away"]) {
            // `there is an egg in the pan; take it out`
            leaves |= ["out", "off"].contains(&particle) && subjects.iter().all(|subject| subject.at.is_some());
        }
        if !self.at_boundary() || self.at_result() {
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
            subject.at = Some(place.clone()).filter(|place| !place.objects.is_empty()).map(Box::new);
        }
        if leaves {
            self.mind.freed.clone_from(&subjects);
        }
        // `take the spoon, then the fork, and lay both …`
        let is_new = |group: &Group| !subjects.iter().any(|subject| subject.words == group.words);
        self.mind.pending.retain(is_new);
        self.mind.pending.extend(subjects);
        self.remember(self.mind.pending.clone());
        Some(Vec::new())
    }

    /// True if a verb, with the words about a source that come next, leaves its object on the table unless another place
    /// is given: `take … out of`, `remove … from`.
    fn frees(&self, verb: &str) -> bool {
        vocabulary().free.contains(&verb) || ["off", "out of"].iter().any(|word| self.at(word).is_some())
    }

    /// The command that brings objects to the table that were taken from somewhere and put nowhere else.
    pub(super) fn put_freed(&mut self) -> Option<Command> {
        let is_freed = |group: &Group| self.mind.freed.iter().any(|freed| freed.words == group.words);
        let has_all = !self.mind.pending.is_empty() && self.mind.pending.iter().all(is_freed);
        let subjects = has_all.then(|| std::mem::take(&mut self.mind.pending))?;
        Some(Command::Put { subjects, places: vec![Place::table()] })
    }

    /// Parses `swap the apple on the plate and the pear in the bowl`.
    fn swap(&mut self) -> Option<Vec<Command>> {
        let start = self.mind.next;
        self.take_any(&vocabulary().swap)?;
        let joins =
            |&index: &usize| ["and", "with", "for"].contains(&self.token(index)) && self.is_determined(index + 1);
        self.mind.stop = (self.mind.next..self.clause_end()).find(joins);
        let one = self.placed()?;
        self.mind.stop = None;
        self.take_any(&["and", "with", "for"])?;
        let other = self.placed()?;
        self.take_any(&["around", "round", "over"]);
        let (Some(here), Some(there)) = (one.at.clone(), other.at.clone()) else {
            let said = self.token(start).to_owned();
            return self.blame(format!("`{said}` needs two places: say in or on what each of the two objects is now"));
        };
        self.remember(vec![one.clone(), other.clone()]);
        Some(vec![
            Command::Put { subjects: vec![one], places: vec![*there] },
            Command::Put { subjects: vec![other], places: vec![*here] },
        ])
    }

    /// Parses a noun phrase with the place where its object is: `the apple on the plate`.
    fn placed(&mut self) -> Option<Group> {
        let mut group = self.noun_phrase()?;
        if group.at.is_none() && super::places::begins(self) {
            group.at = self.place().map(Box::new);
        }
        Some(group)
    }

    /// Parses `throw away the banana`: into the bin.
    fn discard(&mut self) -> Option<Vec<Command>> {
        let verb = self.take_any(&vocabulary().discard)?;
        let subjects = self.noun_phrases()?;
        let is_away = verb != "throw" && verb != "chuck" && verb != "toss";
        (self.take_any(&["away", "out"]).is_some() || is_away).then_some(())?;
        self.at_boundary().then_some(())?;
        let bin = Group::of(vec!["bin".to_owned()]);
        self.put(subjects, vec![Place { relations: &[Relation::In, Relation::Top], objects: vec![bin] }])
    }

    /// Parses `put the following in the basket: the apple, the pear and the lemon`.
    fn listed(&mut self) -> Option<Vec<Command>> {
        self.verb(Class::Carry)?;
        while self.take_any(&["me", "us", "down", "up", "back", "over", "away", "aside"]).is_some() {}
        self.take_any(&vocabulary().lists)?;
        let places = self.places()?;
        self.take_any(&[",", "."])?;
        let subjects = self.noun_phrases()?;
        self.put(subjects, places)
    }

    /// True if `and put it` comes next.
    fn puts_it(&mut self) -> bool {
        self.skip_courtesies();
        self.verb(Class::Carry).is_some() && self.take_any(&["it", "them", "that", "both", "these"]).is_some()
    }

    /// Notes where the objects are taken from.
    pub(super) fn come_from(&mut self, subjects: &mut [Group]) -> Option<()> {
        if let Some(fronted) = self.mind.fronted.take() {
            subjects.iter_mut().for_each(|subject| subject.at = Some(Box::new(fronted.clone())));
            self.mind.source = Some(fronted);
        }
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
            // `off the tray and onto a plate`
            let goes_on = super::places::begins_at(self, self.mind.next + 1);
            let is_put =
                Class::Carry.base(self.ahead(1)).is_some() && super::places::begins_at(self, self.mind.next + 2);
            if ["and", ","].contains(&self.ahead(0)) && (goes_on || is_put) {
                self.mind.next += if goes_on { 1 } else { 2 };
            }
        }
        Some(())
    }

    /// Parses a verb with objects and a place: `park the toy car behind the cube`.
    pub(super) fn carry(&mut self) -> Option<Vec<Command>> {
        let verb = self.verb(Class::Carry)?;
        while self.take_any(&["me", "us", "down", "up", "back", "over", "away", "aside"]).is_some() {}
        let start = self.mind.next;
        let is_pronoun = ["it", "them", "that", "both", "this"].contains(&self.ahead(0));
        // `pick up the mug and place on the tray`
        let is_omitted = !self.mind.pending.is_empty() && super::places::begins(self);
        let mut subjects = if is_omitted { self.mind.pending.clone() } else { self.noun_phrases()? };
        if is_pronoun && self.mind.pending.len() < 2 {
            self.mind.pending.clear();
        }
        let leaves = self.frees(verb);
        self.come_from(&mut subjects)?;
        // `clear the apple off the plate`
        if leaves && self.mind.source.is_some() && self.at_boundary() {
            self.mind.freed.clone_from(&subjects);
            self.mind.pending.clone_from(&subjects);
            self.remember(subjects);
            return Some(Vec::new());
        }
        if let Some(commands) = self.attempt(|listener| listener.either_side(&subjects, start)) {
            return Some(commands);
        }
        if let Some(commands) = self.attempt(|listener| listener.mutual(&subjects)) {
            return Some(commands);
        }
        if let Some(commands) = self.attempt(|listener| listener.on_each_other(&subjects)) {
            return Some(commands);
        }
        // `put the apple or the pear in the bowl`
        let other = self.attempt(|listener| {
            listener.take("or").then_some(())?;
            listener.noun_phrase()
        });
        let last = self.mind.place.clone();
        let elliptic = last.filter(|_| verb == "add" || self.take_any(&vocabulary().likewise).is_some());
        let places = match self.attempt(Self::places) {
            Some(places) => places,
            None => match elliptic.filter(|_| self.at_boundary()) {
                Some(place) => vec![place],
                None => {
                    // `bring the egg over here and put it …`
                    self.take_any(&["over here", "here", "over"]);
                    let before = self.mind.next;
                    let goes_on = |word: &String| word == "it" || word == "them";
                    let is_named_again = self.tokens[before.min(self.tokens.len())..].iter().any(goes_on);
                    if self.at_boundary() && (is_named_again || self.puts_it()) {
                        self.mind.next = before;
                        self.mind.pending.clone_from(&subjects);
                        self.remember(subjects);
                        return Some(Vec::new());
                    }
                    self.mind.next = before;
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
            subject.at = Some(from.clone()).filter(|from| !from.objects.is_empty()).map(Box::new);
            let places = self.places()?;
            return self.put(subjects, places);
        }
        self.put(subjects, places)
    }

    /// The command that brings objects to a place; a second place after a comma is a second condition.
    pub(super) fn put(&mut self, mut subjects: Vec<Group>, places: Vec<Place>) -> Option<Vec<Command>> {
        self.mind.action = None;
        if let [subject] = subjects.as_mut_slice()
            && subject.number == Number::All
            && subject.except.is_empty()
        {
            subject.except = self.exceptions();
        }
        let mut commands = vec![Command::Put { subjects: subjects.clone(), places: places.clone() }];
        // `beside the book, on its left side`
        self.remember(places.iter().flat_map(|place| place.objects.clone()).collect());
        if let Some(more) = self.attempt(|listener| {
            listener.take_any(&[",", "and"]);
            listener.result();
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
        self.mind.pending.retain(|pending| !subjects.iter().any(|subject| subject.words == pending.words));
        self.remember(subjects);
        Some(commands)
    }

    pub(super) fn remember(&mut self, groups: Vec<Group>) {
        self.mind.topic = groups;
    }
}
