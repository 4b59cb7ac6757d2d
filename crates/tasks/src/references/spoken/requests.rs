//! Requests: a verb with its objects and where they go.

use genmanip_core::Relation;

use super::super::change::Action;
use super::super::command::{Command, Group, Number, Place};
use super::listener::Listener;
use super::verbs::{Class, is_form};
use super::words::vocabulary;

pub(super) type Parser = fn(&mut Listener) -> Option<Vec<Command>>;

/// Parsers of requests with a verb.
pub(super) const VERBAL: [Parser; 12] = [
    Listener::swap,
    Listener::trade,
    Listener::stay,
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
pub(super) const OTHER: [Parser; 6] =
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
    pub(super) fn first_of(&mut self, parsers: &[Parser]) -> Option<Vec<Command>> {
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

    /// True if `and put it` comes next.
    pub(super) fn puts_it(&mut self) -> bool {
        self.skip_courtesies();
        self.verb(Class::Carry).is_some() && self.take_any(&["it", "them", "that", "both", "these"]).is_some()
    }

    /// Parses a verb with objects and a place: `park the toy car behind the cube`.
    pub(super) fn carry(&mut self) -> Option<Vec<Command>> {
        let verb = self.verb(Class::Carry)?;
        while self.take_any(&["me", "us", "down", "up", "back", "over", "away", "aside"]).is_some() {}
        let start = self.mind.next;
        let is_pronoun = ["it", "them", "that", "both", "this"].contains(&self.ahead(0));
        // `open the chest and put in the die`
        if let Some(commands) = self.attempt(Self::put_inside) {
            return Some(commands);
        }
        // `pick up the mug and place on the tray`
        let is_omitted = !self.mind.pending.is_empty() && super::places::begins(self);
        let mut subjects = if is_omitted { self.mind.pending.clone() } else { self.noun_phrases()? };
        if is_pronoun && self.mind.pending.len() < 2 {
            self.mind.pending.clear();
        }
        self.mind.subjects.clone_from(&subjects);
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

    /// Parses `in the die` after a verb where a container was opened before.
    fn put_inside(&mut self) -> Option<Vec<Command>> {
        let host = self.mind.topic.clone();
        (self.mind.action == Some(Action::Open) && host.len() == 1).then_some(())?;
        self.take("in").then_some(())?;
        let subjects = self.noun_phrases()?;
        self.at_boundary().then_some(())?;
        self.put(subjects, vec![Place { relations: &[Relation::In, Relation::Top], objects: host }])
    }

    /// The command that brings objects to a place; a second place after a comma is a second condition.
    pub(super) fn put(&mut self, mut subjects: Vec<Group>, mut places: Vec<Place>) -> Option<Vec<Command>> {
        self.mind.action = None;
        // `put each mug on a coaster` needs as many coasters as mugs.
        if let ([subject], [place]) = (subjects.as_mut_slice(), places.as_mut_slice())
            && let Number::Each(count) = subject.number
            && let ([host], true) = (place.objects.as_mut_slice(), self.mind.is_any)
        {
            host.number = Number::Each(count.or(Some(2)));
            subject.number = Number::Many(count.unwrap_or(2));
        }
        self.mind.subjects.clear();
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
