//! What phrases mean in a scene, and what commands ask for.

use genmanip_core::{ObjectCard, Relation, SceneGraph};

use super::grammar::{Action, Command, Group, Part, Place};
use super::lexicon::lexicon;
use super::space::{Axis, Certainty, Space};
use super::{Mismatch, ReadAtom};

/// Somebody who knows a scene and hears a sentence about it.
pub(super) struct Listener<'c> {
    cards: Vec<&'c ObjectCard>,
    graph: &'c SceneGraph,
    space: Space<'c>,
    phrases: Vec<(String, Vec<String>)>,
}

impl<'c> Listener<'c> {
    pub fn new(cards: &'c [ObjectCard], graph: &'c SceneGraph) -> Self {
        Self { cards: cards.iter().collect(), graph, space: Space::new(graph), phrases: Vec::new() }
    }

    /// Noun phrases heard so far and what they mean.
    pub fn into_phrases(self) -> Vec<(String, Vec<String>)> {
        self.phrases
    }

    /// All commands together, as alternatives of conditions.
    pub fn goal(&mut self, commands: &[Command]) -> Result<Vec<Vec<ReadAtom>>, Mismatch> {
        let mut goal = vec![Vec::new()];
        for command in commands {
            let options = self.options(command)?;
            goal = goal
                .into_iter()
                .flat_map(|so_far: Vec<ReadAtom>| {
                    options.iter().map(move |more| so_far.iter().chain(more).cloned().collect())
                })
                .collect();
        }
        Ok(goal)
    }

    /// The ways to do what one command asks for.
    fn options(&mut self, command: &Command) -> Result<Vec<Vec<ReadAtom>>, Mismatch> {
        match command {
            Command::Either(commands) => {
                let mut options = Vec::new();
                for command in commands {
                    options.extend(self.options(command)?);
                }
                Ok(options)
            }
            Command::Put { subjects, places } => {
                let subjects = subjects.iter().map(|group| self.one(group)).collect::<Result<Vec<_>, _>>()?;
                let mut options = Vec::new();
                for place in places {
                    let references = self.references(place)?;
                    let atom = |subject: &&ObjectCard| ReadAtom::Place {
                        subject: subject.uid.clone(),
                        relations: place.relations.to_vec(),
                        references: references.iter().map(|card| card.uid.clone()).collect(),
                    };
                    options.push(subjects.iter().map(atom).collect());
                }
                Ok(options)
            }
            Command::Change { object, part, action } => {
                let card = self.one(object)?;
                let node = self.graph.nodes.iter().find(|node| node.id == card.uid);
                let now = node.and_then(|node| node.state.as_deref());
                let state = changed(card, *part, *action, now)
                    .ok_or_else(|| Mismatch::Unreadable { phrase: format!("{action:?} {}", text(object)) })?;
                Ok(vec![vec![ReadAtom::State { object: card.uid.clone(), state }]])
            }
        }
    }

    fn references(&mut self, place: &Place) -> Result<Vec<&'c ObjectCard>, Mismatch> {
        match place.objects.as_slice() {
            [two] if place.relations == [Relation::Between] => {
                let words: Vec<&str> = two.words.iter().map(String::as_str).collect();
                let meant = match words.as_slice() {
                    ["two", rest @ ..] => self.denote(rest, two)?,
                    _ => return Err(Mismatch::Unreadable { phrase: text(two) }),
                };
                self.note(two, &meant);
                if meant.len() == 2 { Ok(meant) } else { Err(unclear(two, &meant)) }
            }
            objects => objects.iter().map(|group| self.one(group)).collect(),
        }
    }

    /// The one object that a phrase means.
    fn one(&mut self, group: &Group) -> Result<&'c ObjectCard, Mismatch> {
        let meant = self.candidates(group)?;
        self.note(group, &meant);
        match meant.as_slice() {
            [card] => Ok(card),
            _ => Err(unclear(group, &meant)),
        }
    }

    fn note(&mut self, group: &Group, meant: &[&'c ObjectCard]) {
        self.phrases.push((text(group), meant.iter().map(|card| card.uid.clone()).collect()));
    }

    /// Everything that a phrase may mean.
    fn candidates(&mut self, group: &Group) -> Result<Vec<&'c ObjectCard>, Mismatch> {
        let words: Vec<&str> = group.words.iter().map(String::as_str).collect();
        let of_several = |key: &str| words.iter().position(|word| *word == key);
        if let Some(index) = of_several("two").or_else(|| of_several("three"))
            && index >= 3
        {
            let rest = self.denote(&words[index + 1..], group)?;
            let expected = if words[index] == "two" { 2 } else { 3 };
            return if rest.len() == expected { Ok(self.chosen(words[0], rest)) } else { Err(unclear(group, &rest)) };
        }
        let extreme = ["farthest", "nearest", "closest"].into_iter().find_map(of_several);
        if let Some(index) = extreme {
            let noun = words[..index].strip_suffix(&["that", "is"][..]).unwrap_or(&words[..index]);
            let meant = self.denote(noun, group)?;
            return self.extreme(&words[index..], &meant).ok_or_else(|| Mismatch::Unreadable { phrase: text(group) });
        }
        let meant = self.denote(&words, group)?;
        let Some(place) = &group.at else { return Ok(meant) };
        let references = self.references(place)?;
        let mut certain = Vec::new();
        let mut possible = Vec::new();
        for card in meant {
            if references.iter().any(|reference| reference.uid == card.uid) {
                continue;
            }
            let certainty = match references.as_slice() {
                [one, other] => self.space.is_between(&card.uid, &one.uid, &other.uid),
                [one] => self.space.stands(&card.uid, place.relations, &one.uid),
                _ => Certainty::Impossible,
            };
            match certainty {
                Certainty::Certain => certain.push(card),
                Certainty::Possible => possible.push(card),
                Certainty::Impossible => {}
            }
        }
        if certain.is_empty() {
            return Ok(certain);
        }
        Ok(certain.into_iter().chain(possible).collect())
    }

    fn denote(&self, words: &[&str], group: &Group) -> Result<Vec<&'c ObjectCard>, Mismatch> {
        lexicon().denote(words, &self.cards).ok_or_else(|| Mismatch::Unreadable { phrase: text(group) })
    }

    /// `larger of the two`, `middle one of the three`.
    fn chosen(&self, word: &str, among: Vec<&'c ObjectCard>) -> Vec<&'c ObjectCard> {
        let volume = |card: &ObjectCard| card.size_m.element_product();
        let extreme = |sign: f64| {
            let best = among.iter().map(|card| sign * volume(card)).fold(f64::NEG_INFINITY, f64::max);
            // Sizes that a person would not tell apart decide nothing.
            among.iter().copied().filter(|card| sign * volume(card) > best - 0.2 * best.abs()).collect()
        };
        match word {
            "larger" | "bigger" => extreme(1.0),
            "smaller" => extreme(-1.0),
            "middle" => {
                let between = |card: &&&ObjectCard| {
                    [Axis::Depth, Axis::Width].into_iter().any(|axis| {
                        let beyond = |one: &str, other: &str| self.space.is_beyond(one, axis, other);
                        let others = || among.iter().filter(|other| other.uid != card.uid);
                        others().any(|other| beyond(&card.uid, &other.uid))
                            && others().any(|other| beyond(&other.uid, &card.uid))
                    })
                };
                among.iter().filter(between).copied().collect()
            }
            _ => among,
        }
    }

    /// The ones that are certainly farther than all others in the direction that the words give, if they give one.
    fn extreme(&self, words: &[&str], among: &[&'c ObjectCard]) -> Option<Vec<&'c ObjectCard>> {
        let (axis, outward) = match words {
            ["farthest", "to", "the", "robot's", "left"] => (Axis::Width, true),
            ["farthest", "to", "the", "robot's", "right"] => (Axis::Width, false),
            ["farthest", "from", "the", "robot"] => (Axis::Depth, true),
            ["nearest" | "closest", "to", "the", "robot"] => (Axis::Depth, false),
            _ => return None,
        };
        let wins = |card: &&&ObjectCard| {
            among.iter().filter(|other| other.uid != card.uid).all(|other| match outward {
                true => self.space.is_beyond(&card.uid, axis, &other.uid),
                false => self.space.is_beyond(&other.uid, axis, &card.uid),
            })
        };
        Some(among.iter().filter(wins).copied().collect())
    }
}

/// The state that follows from an action, if the object has such a state and is not in it.
fn changed(card: &ObjectCard, part: Option<Part>, action: Action, now: Option<&str>) -> Option<String> {
    let drawers = card.states.iter().any(|state| state == "top_open");
    let now = now?;
    let state = match (action, part, now) {
        (Action::Open, Some(Part::Upper), "closed") if drawers => "top_open",
        (Action::Open, Some(Part::Upper), "bottom_open") if drawers => "both_open",
        (Action::Open, Some(Part::Lower), "closed") if drawers => "bottom_open",
        (Action::Open, Some(Part::Lower), "top_open") if drawers => "both_open",
        (Action::Open, Some(Part::Both), _) if drawers => "both_open",
        (Action::Close, Some(Part::Upper), "top_open") if drawers => "closed",
        (Action::Close, Some(Part::Upper), "both_open") if drawers => "bottom_open",
        (Action::Close, Some(Part::Lower), "bottom_open") if drawers => "closed",
        (Action::Close, Some(Part::Lower), "both_open") if drawers => "top_open",
        (Action::Close, Some(Part::Both), "both_open") if drawers => "closed",
        (Action::Open, None | Some(Part::Other), _) => "open",
        (Action::Close, None | Some(Part::Other), _) => "closed",
        (Action::On, None, _) => "on",
        (Action::Off, None, _) => "off",
        (Action::Low, None, _) => "low",
        (Action::High, None, _) => "high",
        (Action::Press, None, _) => "pressed",
        _ => return None,
    };
    let changes = card.states.iter().any(|known| known == state) && now != state;
    changes.then(|| state.to_owned())
}

fn unclear(group: &Group, meant: &[&ObjectCard]) -> Mismatch {
    let phrase = text(group);
    if meant.is_empty() {
        return Mismatch::Nothing { phrase };
    }
    Mismatch::Ambiguous { phrase, uids: meant.iter().map(|card| card.uid.clone()).collect() }
}

fn text(group: &Group) -> String {
    let words = group.words.join(" ");
    match &group.at {
        Some(place) => format!(
            "{words} {:?} {}",
            place.relations,
            place.objects.iter().map(text).collect::<Vec<_>>().join(" and ")
        ),
        None => words,
    }
}
