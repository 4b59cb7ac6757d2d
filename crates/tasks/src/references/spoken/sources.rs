//! Sources of an object: `off the tray`, `out of the bowl`.

use genmanip_core::Relation;

use super::super::command::{Command, Group, Place};
use super::super::words::{EXTREMES, SOURCE};
use super::listener::Listener;
use super::places::begins;
use super::verbs::Class;
use super::words::vocabulary;

/// True if the words at an index say where something comes from.
pub(super) fn is_source(listener: &Listener, index: usize) -> bool {
    ["from", "off", "out of", "away from"].iter().any(|word| {
        listener.at_index(index, word).is_some_and(|length| {
            let follows = index + length;
            *word == "from" && !EXTREMES.contains(&listener.token(index.wrapping_sub(1)))
                || listener.is_determined(follows)
                || listener.token(follows) == "of"
        })
    })
}

impl Listener {
    /// The place an object comes from: `off the tray`, `from the left side of the milk`; `Some(None)` for the table.
    pub(super) fn source(&mut self) -> Option<Option<Place>> {
        if !is_source(self, self.mind.next) {
            return None;
        }
        let said =
            self.take_any(&["out from", "from off", "off of", "off from", "out of", "away from", "from", "off"])?;
        self.take_any(&["out of", "off"]);
        let article = ["the", "my", "your", "our"].iter().find_map(|word| self.at(word)).unwrap_or(0);
        let spots = vocabulary().tables.iter().chain(&vocabulary().spots);
        let table = spots.filter_map(|word| self.at_index(self.mind.next + article, word)).max();
        if let Some(length) = table {
            self.mind.next += article + length;
            return Some(None);
        }
        if begins(self) {
            return Some(Some(self.place()?));
        }
        let objects = match self.attempt(Self::pronoun) {
            Some(_) => self.antecedents(SOURCE)?,
            None => vec![self.noun_phrase()?],
        };
        let relations: &[Relation] = match said {
            "out of" | "out from" => &[Relation::In, Relation::Top],
            "off" | "off of" | "off from" | "from off" => &[Relation::On, Relation::Top],
            _ => SOURCE,
        };
        // What something is moved away from need not hold it.
        Some((said != "away from").then_some(Place { relations, objects }))
    }

    /// Notes where the objects are taken from.
    pub(super) fn come_from(&mut self, subjects: &mut [Group]) -> Option<()> {
        if let Some(fronted) = self.mind.fronted.take() {
            subjects.iter_mut().for_each(|subject| subject.at = Some(Box::new(fronted.clone())));
            self.mind.source = Some(fronted);
        }
        while super::sources::is_source(self, self.mind.next) {
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

    /// True if a verb, with the words about a source that come next, leaves its object on the table unless another place
    /// is given: `take … out of`, `remove … from`.
    pub(super) fn frees(&self, verb: &str) -> bool {
        vocabulary().free.contains(&verb) || ["off", "out of"].iter().any(|word| self.at(word).is_some())
    }

    /// The command that brings objects to the table that were taken from somewhere and put nowhere else.
    pub(super) fn put_freed(&mut self) -> Option<Command> {
        let is_freed = |group: &Group| self.mind.freed.iter().any(|freed| freed.words == group.words);
        let has_all = !self.mind.pending.is_empty() && self.mind.pending.iter().all(is_freed);
        let subjects = has_all.then(|| std::mem::take(&mut self.mind.pending))?;
        Some(Command::Put { subjects, places: vec![Place::table()] })
    }
}
