//! Towers: `build a tower with the blue cube at the bottom, …`.

use super::super::command::{Command, Group, Number};
use super::super::lexicon::is_color;
use super::listener::Listener;
use super::verbs::{Class, is_verb};

/// Places of objects that form a tower of any order.
const ON_EACH_OTHER: [&str; 7] = [
    "on top of each other",
    "on top of one another",
    "one on top of the other",
    "on each other",
    "into a tower",
    "in a tower",
    "up",
];

/// Words after objects that are named from the lowest to the highest.
const IN_ORDER: [&str; 11] = [
    "in this order",
    "in that order",
    "from bottom to top",
    "from the bottom up",
    "bottom to top",
    "in that order from the bottom",
    "in this order from the bottom",
    "in that order , from the bottom up",
    "in that order from bottom to top",
    "starting from the bottom",
    "bottom first",
];

impl Listener {
    /// Parses `on top of each other` after objects, whose order is free.
    pub(super) fn on_each_other(&mut self, subjects: &[Group]) -> Option<Vec<Command>> {
        self.take_any(&ON_EACH_OTHER[..6]).filter(|_| self.at_boundary())?;
        let towers = match subjects {
            [several] if several.number != Number::One => vec![Command::Tower(subjects.to_vec())],
            [one, other] if one.number == Number::One && other.number == Number::One => {
                let orders = [[one, other], [other, one]];
                orders.map(|order| Command::Tower(order.map(Clone::clone).to_vec())).to_vec()
            }
            _ => return None,
        };
        self.mind.place = None;
        self.remember(subjects.to_vec());
        Some(if towers.len() == 1 { towers } else { vec![Command::Either(towers)] })
    }

    /// Parses `build a tower with the blue cube at the bottom, …`.
    pub(super) fn tower(&mut self) -> Option<Vec<Command>> {
        let is_stacked = ["stack", "stack up", "pile", "pile up"].contains(&self.verb(Class::Build)?);
        self.take_any(&["me", "us"]);
        let names =
            ["a tower", "a stack", "a pile", "a column", "one tower", "the tower", "a little tower", "a small tower"];
        let is_named = self.take_any(&names).is_some();
        if is_named {
            self.take_any(&["with", "of", "from", "out of", "using", "made of", "made from", "consisting of"]);
            while self.take_any(&[",", "out of"]).is_some() {}
        }
        let (lowest, middle, highest) = (
            [
                "at the bottom",
                "on the bottom",
                "at the base",
                "as the base",
                "as base",
                "lowest",
                "in the bottom",
                "as the bottom",
                "as the foundation",
                "underneath",
            ],
            ["in the middle", "in between", "in the centre", "on it", "on that", "on top of it", "on top of that"],
            ["on top", "at the top", "on the top", "as the top", "uppermost", "at the very top", "on the very top"],
        );
        let mut items: Vec<(Option<usize>, Group)> = Vec::new();
        loop {
            let before = self.position(&[&lowest, &middle, &highest]);
            self.take_any(&[","]);
            let noun = self.mind.noun.clone();
            let mut group = self.noun_phrase()?;
            // `the red cube at the bottom, then green`
            if let Some(noun) = noun.filter(|_| group.words.iter().all(|word| is_color(word))) {
                self.mind.noun = Some(noun.clone());
                group.words.push(noun);
            }
            while self.take_any(&["goes", "is", "comes", "should be", "go", "should go"]).is_some() {}
            let level = before.or_else(|| self.position(&[&lowest, &middle, &highest]));
            items.push((level, group));
            let joined = self.attempt(|listener| {
                let mut is_joined = false;
                while listener.take_any(&[",", "and", "then"]).is_some() {
                    is_joined = true;
                }
                let is_order = IN_ORDER.iter().any(|order| listener.at(order).is_some());
                (is_joined && !is_order && !is_verb(listener.ahead(0)) && !listener.is_done())
                    .then_some(())
                    .filter(|()| listener.ahead(0) != ".")
            });
            if joined.is_none() {
                break;
            }
        }
        self.attempt(|listener| listener.order(&mut items, &[&lowest, &middle, &highest]));
        if IN_ORDER.iter().any(|order| self.at_index(self.mind.next + 1, order).is_some()) {
            self.take(",");
        }
        // `stack the books`
        let is_free = is_stacked && items.len() == 1 && self.at_boundary();
        let is_stack = self.take_any(&ON_EACH_OTHER).is_some() | is_named | is_free;
        if self.take_any(&["from top to bottom", "top to bottom"]).is_some() {
            items.reverse();
            items.iter_mut().for_each(|(level, _)| *level = Some(0));
        } else if self.take_any(&IN_ORDER).is_some() {
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

    /// Parses `with the red one at the bottom and the blue one on top` after the objects of a tower.
    fn order(&mut self, items: &mut [(Option<usize>, Group)], levels: &[&[&str]]) -> Option<()> {
        self.take(",");
        self.take("with").then_some(())?;
        loop {
            let group = self.noun_phrase()?;
            let level = self.position(levels)?;
            let item = items.iter_mut().find(|(_, known)| known.words == group.words)?;
            item.0 = Some(level);
            self.take(",");
            if !self.take("and") {
                break;
            }
        }
        Some(())
    }

    fn position(&mut self, levels: &[&[&str]]) -> Option<usize> {
        levels.iter().position(|phrases| {
            // `on top of each other` is no level.
            let found = self.attempt(|listener| {
                listener.take_any(phrases)?;
                (listener.ahead(0) != "of").then_some(())
            });
            found.is_some()
        })
    }
}
