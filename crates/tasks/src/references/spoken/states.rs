//! Changes of state, as a request or as a wish.

use genmanip_core::Relation;

use super::super::change::{Action, Part, action};
use super::super::command::{Command, Group};
use super::listener::Listener;
use super::verbs::Class;
use super::words::{PARTS, vocabulary};

impl Listener {
    /// Parses a change of state: `flick the fan switch on`, `pull out the top drawer of the cabinet`.
    pub(super) fn state(&mut self) -> Option<Vec<Command>> {
        let verb = self.verb(Class::State)?;
        let mut particle = self.take_any(&vocabulary().state_particles).or_else(|| self.level());
        self.take_any(&["on"]);
        let objects = self.changed_objects()?;
        particle = self.level().or_else(|| self.take_any(&vocabulary().state_particles)).or(particle);
        particle = self.level().or(particle);
        self.take_any(&["again", "all the way", "fully", "wide", "over it", "behind it", "after it"]);
        let is_kept = ["get", "have", "keep", "leave", "make"].contains(&verb);
        let told = if is_kept && particle.is_none() { self.attempt(Self::wanted_state) } else { None };
        if let Some(action) = told.or_else(|| self.attempt(Self::resulting_state)) {
            return self.changes(&objects, action);
        }
        if verb == "lift" && particle.is_none() && objects.iter().all(|object| object.part.is_none()) {
            return None;
        }
        let action = action(verb, particle)?;
        // `push in the top drawer`
        let has_drawer = objects.iter().any(|object| object.part.is_some_and(|part| part != Part::Other));
        let action = if action == Action::Press && has_drawer { Action::Close } else { action };
        self.changes(&objects, action)
    }

    pub(super) fn changes(&mut self, objects: &[Group], action: Action) -> Option<Vec<Command>> {
        self.mind.pending.retain(|pending| !objects.iter().any(|object| object.words == pending.words));
        self.remember(objects.to_vec());
        self.mind.place = None;
        self.mind.action = Some(action);
        let change = |object: &Group| Command::Change { object: object.clone(), part: object.part, action };
        Some(objects.iter().map(change).collect())
    }

    /// Objects whose state changes, with the part that is named.
    pub(super) fn changed_objects(&mut self) -> Option<Vec<Group>> {
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
        if let Some(owners) = self.attempt(Self::part_owners) {
            return Some(owners);
        }
        let mut groups = self.noun_phrases()?;
        if part.is_some() {
            groups.iter_mut().for_each(|group| group.part = part);
        }
        Some(groups)
    }

    /// Parses `the door` or `its lid` alone: the part of what was spoken of last, a container before its content.
    fn part_owners(&mut self) -> Option<Vec<Group>> {
        self.take_any(&["the", "its"])?;
        let is_part = |(_, part): &&(&str, Part)| *part == Part::Other;
        let part = PARTS.iter().filter(is_part).find_map(|(phrase, part)| self.take(phrase).then_some(*part))?;
        let particles = &vocabulary().particles;
        let is_whole = self.at_boundary()
            || vocabulary().noun_ends.contains(&self.ahead(0))
            || particles.contains(&self.ahead(0)) && self.is_end(self.mind.next + 1);
        let holder = self.mind.place.clone().filter(|place| place.relations.contains(&Relation::In));
        let changed = self.mind.action.map(|_| self.mind.topic.clone());
        let mut owners = holder.map(|place| place.objects).or(changed).filter(|_| is_whole)?;
        (owners.len() == 1).then_some(())?;
        owners.iter_mut().for_each(|owner| owner.part = owner.part.or(Some(part)));
        Some(owners)
    }

    /// A level such as `to high` or `up to the maximum`, in the words of the table of actions.
    fn level(&mut self) -> Option<&'static str> {
        self.attempt(|listener| {
            listener.take_any(&["up", "down", "all the way up", "all the way", "right up"]);
            let is_said = listener.take_any(&["to", "on", "onto", "at"]).is_some();
            let names: Vec<&str> = vocabulary().levels.iter().map(|(name, _)| *name).collect();
            let name = listener.take_any(&names).filter(|_| is_said)?;
            listener.take_any(&["heat", "setting", "power"]);
            vocabulary().levels.iter().find(|(said, _)| *said == name).map(|(_, level)| *level)
        })
        .or_else(|| self.take("all the way up").then_some("high"))
    }

    /// Parses `until it is closed`.
    fn resulting_state(&mut self) -> Option<Action> {
        self.take_any(&vocabulary().results)?;
        self.take_any(&["it", "they", "that"])?;
        self.copula();
        self.wanted_state()
    }

    /// Parses `closed`, `switched on`, `off`, `to be opened`, `turned to high` at the end of a clause.
    pub(super) fn wanted_state(&mut self) -> Option<Action> {
        let before = self.ahead(0).to_owned();
        let adjective = self.take_any(&[
            "wide open",
            "open",
            "opened",
            "shut",
            "closed",
            "on",
            "off",
            "running",
            "run",
            "going",
            "started",
            "stopped",
            "pressed",
            "pushed",
        ]);
        let found = match adjective {
            Some("on" | "running" | "run" | "going" | "started") => Action::On,
            Some("off" | "stopped") => Action::Off,
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
                let particle = self.level().or_else(|| self.take_any(&vocabulary().state_particles));
                action(verb.unwrap_or("turn"), particle)?
            }
        };
        self.at_boundary().then_some(found)
    }
}
