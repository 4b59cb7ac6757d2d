//! Requests in which the verb's object is the place, that act on a part, or that repeat the request before.

use genmanip_core::Relation;

use super::super::change::Action;
use super::super::command::{Command, Group, Number, Place};
use super::listener::Listener;
use super::verbs::is_form;
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
}
