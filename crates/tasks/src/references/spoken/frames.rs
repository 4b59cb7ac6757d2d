//! Requests of a form of their own: the object of the verb is the place, two objects change places, a list follows.

use genmanip_core::Relation;

use super::super::change::Action;
use super::super::command::{Command, Group, Number, Place};
use super::listener::Listener;
use super::verbs::{Class, is_form};
use super::words::vocabulary;

impl Listener {
    /// Parses `fill the basket with the lemons`, `top the cube with the die`.
    pub(super) fn fill(&mut self) -> Option<Vec<Command>> {
        let verb = vocabulary().fill.iter().find(|verb| is_form(self.ahead(0), verb)).copied()?;
        self.mind.next += 1;
        self.take_any(&["up", "off"]);
        let end = self.clause_end();
        let with = (self.mind.next..end).find(|&index| self.token(index) == "with")?;
        self.mind.stop = Some(with);
        let hosts = self.noun_phrases()?;
        self.take_any(&["up", "off"]);
        self.mind.stop = None;
        self.take("with").then_some(())?;
        let subjects = self.noun_phrases()?;
        let relations: &[Relation] = match verb {
            "top" | "crown" => &[Relation::On, Relation::Top],
            "fill" => &[Relation::In, Relation::Top],
            _ => &[Relation::In, Relation::On, Relation::Top],
        };
        let place = Place { relations, objects: hosts };
        self.mind.place = Some(place.clone());
        self.put(subjects, vec![place])
    }

    /// Parses `give the button a push`.
    pub(super) fn touch(&mut self) -> Option<Vec<Command>> {
        self.take_any(&["give", "giving"])?;
        let end = self.clause_end();
        self.mind.stop = (self.mind.next + 1..end).find(|&index| self.token(index) == "a");
        let objects = self.noun_phrases()?;
        self.mind.stop = None;
        self.take_any(&["a", "a quick", "a gentle", "a little", "a good", "a firm", "a light"])?;
        self.take_any(&["push", "press", "tap", "poke", "click", "prod", "jab", "punch"])?;
        self.changes(&objects, Action::Press)
    }

    /// Parses two objects that are to be beside each other.
    pub(super) fn mutual(&mut self, subjects: &[Group]) -> Option<Vec<Command>> {
        let [one, other] = subjects else { return None };
        if self.take_any(&vocabulary().mutual).is_none() {
            self.skip_modifiers();
            self.take_any(&vocabulary().mutual)?;
        }
        let is_single = one.number == Number::One && other.number == Number::One;
        (is_single && self.at_boundary()).then_some(())?;
        self.put(vec![one.clone()], vec![Place { relations: &[Relation::Near], objects: vec![other.clone()] }])
    }

    /// Parses `do the same with the pear`.
    pub(super) fn repeat(&mut self) -> Option<Vec<Command>> {
        self.take_any(&vocabulary().repeats)?;
        let subjects = self.noun_phrases()?;
        self.again(subjects)
    }

    /// The request before, for other objects.
    pub(super) fn again(&mut self, subjects: Vec<Group>) -> Option<Vec<Command>> {
        if let Some(action) = self.mind.action {
            return self.changes(&subjects, action);
        }
        let place = self.mind.place.clone()?;
        self.put(subjects, vec![place])
    }

    /// Parses `swap the apple on the plate and the pear in the bowl`.
    pub(super) fn swap(&mut self) -> Option<Vec<Command>> {
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
        Some(self.exchanged([one, other], [*here, *there]))
    }

    /// Parses `make the apple and the pear trade places`, which lacks the places.
    pub(super) fn trade(&mut self) -> Option<Vec<Command>> {
        self.take_any(&["make", "let", "have"]);
        let groups = self.noun_phrases()?;
        while self.take_any(&["should", "must", "to", "need"]).is_some() {}
        self.take_any(&["swap", "switch", "trade", "change", "exchange"])?;
        self.take_any(&["places", "positions", "spots", "locations", "seats"])?;
        let [one, other] = groups.as_slice() else { return None };
        let places = (one.at.clone(), other.at.clone());
        if let (Some(here), Some(there)) = places {
            return Some(self.exchanged([one.clone(), other.clone()], [*here, *there]));
        }
        self.blame("changing places needs two places: say in or on what each of the two objects is now")
    }

    /// The commands that bring two objects each to the place of the other.
    fn exchanged(&mut self, objects: [Group; 2], [here, there]: [Place; 2]) -> Vec<Command> {
        self.remember(objects.to_vec());
        let [one, other] = objects.map(|object| vec![object]);
        vec![Command::Put { subjects: one, places: vec![there] }, Command::Put { subjects: other, places: vec![here] }]
    }

    /// Parses `leave the bowl where it is`, which names an object without a change.
    pub(super) fn stay(&mut self) -> Option<Vec<Command>> {
        self.take_any(&["leave", "keep", "let", "leaving", "keeping"])?;
        let groups = self.noun_phrases()?;
        self.take_any(&vocabulary().stays)?;
        self.remember(groups);
        Some(Vec::new())
    }

    /// Parses a noun phrase with the place where its object is: `the apple on the plate`.
    pub(super) fn placed(&mut self) -> Option<Group> {
        let mut group = self.noun_phrase()?;
        if group.at.is_none() && super::places::begins(self) {
            group.at = self.place().map(Box::new);
        }
        Some(group)
    }

    /// Parses `throw away the banana`: into the bin.
    pub(super) fn discard(&mut self) -> Option<Vec<Command>> {
        let verb = self.take_any(&vocabulary().discard)?;
        let subjects = self.noun_phrases()?;
        let is_away = verb != "throw" && verb != "chuck" && verb != "toss";
        (self.take_any(&["away", "out"]).is_some() || is_away).then_some(())?;
        self.at_boundary().then_some(())?;
        let bin = Group::of(vec!["bin".to_owned()]);
        self.put(subjects, vec![Place { relations: &[Relation::In, Relation::Top], objects: vec![bin] }])
    }

    /// Parses `put the following in the basket: the apple, the pear and the lemon`, `these go in the basket: …`.
    pub(super) fn listed(&mut self) -> Option<Vec<Command>> {
        let is_told = self.verb(Class::Carry).is_some();
        while is_told && self.take_any(&["me", "us", "down", "up", "back", "over", "away", "aside"]).is_some() {}
        self.take_any(&vocabulary().lists)?;
        if !is_told {
            let start = self.mind.next;
            self.copula();
            self.is_duty(start).then_some(())?;
        }
        let places = self.places()?;
        self.take_any(&[",", "."])?;
        let subjects = self.noun_phrases()?;
        self.put(subjects, places)
    }
}
