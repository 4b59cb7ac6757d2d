//! Resolves the phrases and commands of a parsed instruction in a scene.

use std::sync::Arc;

use genmanip_core::{HorizontalAxis, InstanceId, ObjectCard, ReferenceId, Relation, SceneGraph};

use super::change::{Action, Part, meanings};
use super::command::{Command, Group, Number, Place, TABLE};
use super::lexicon::{SceneObject, lexicon};
use super::space::{Certainty, Space};
use super::{Mismatch, ReadAtom};

/// Resolves the phrases of one instruction in one scene.
pub(super) struct Interpreter<'c> {
    things: Vec<SceneObject<'c>>,
    graph: &'c SceneGraph,
    space: Space<'c>,
    /// Clauses of the instruction that contain no command, such as a stated need.
    context: &'c str,
    phrases: Phrases,
    /// Groups of interchangeable copies among which the instruction does not choose.
    choices: Vec<Vec<InstanceId>>,
}

/// Noun phrases, each with the ids of the objects it means.
pub type Phrases = Vec<(String, Vec<InstanceId>)>;

/// Possible referents of a phrase: the first `certain` ones match it in every layout of the scene, the others in some
/// layouts.
struct Candidates<'c> {
    things: Vec<SceneObject<'c>>,
    certain: usize,
}

impl<'c> Interpreter<'c> {
    pub fn new(cards: &'c [Arc<ObjectCard>], graph: &'c SceneGraph, context: &'c str) -> Self {
        let things = graph.nodes.iter().zip(cards).map(|(node, card)| SceneObject { id: &node.id, card }).collect();
        Self { things, graph, space: Space::new(graph), context, phrases: Vec::new(), choices: Vec::new() }
    }

    /// Noun phrases resolved so far, and the groups of copies among which they do not choose.
    pub fn into_phrases(self) -> (Phrases, Vec<Vec<InstanceId>>) {
        (self.phrases, self.choices)
    }

    /// The conjunction of all commands, as alternatives of conditions.
    pub fn goal(&mut self, commands: &[Command]) -> Result<Vec<Vec<ReadAtom>>, Mismatch> {
        let mut goal = vec![Vec::new()];
        for command in commands {
            let options = self.options(command)?;
            goal = conjunctions(&goal, &options);
        }
        Ok(goal)
    }

    /// Alternative conjunctions of conditions that each fulfil one command.
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
                let mut options = Vec::new();
                for place in places {
                    options.extend(self.put(subjects, place)?);
                }
                Ok(options)
            }
            Command::Sides { subjects, of } => {
                let mut things = Vec::new();
                for subject in subjects {
                    things.extend(self.several(subject)?);
                }
                let middle = self.any(of)?;
                let beside = |(thing, side): (&SceneObject, Relation)| place_of(thing, &[side], &[middle]);
                let orders = [[Relation::Left, Relation::Right], [Relation::Right, Relation::Left]];
                Ok(orders.iter().map(|order| things.iter().zip(*order).map(beside).collect()).collect())
            }
            Command::Tower(groups) => {
                let mut things = Vec::new();
                for group in groups {
                    things.extend(self.several(group)?);
                }
                let orders =
                    if groups.len() == 1 { permutations(things.len()) } else { vec![(0..things.len()).collect()] };
                let on =
                    |pair: &[usize]| place_of(&things[pair[1]], &[Relation::On, Relation::Top], &[things[pair[0]]]);
                Ok(orders.iter().map(|order| order.windows(2).map(on).collect()).collect())
            }
            Command::Given(group) => {
                self.several(group)?;
                Ok(vec![Vec::new()])
            }
            Command::Change { object, part, action } => {
                let thing = self.any(object)?;
                let node = self.graph.nodes.iter().find(|node| node.id == *thing.id);
                let now = node.and_then(|node| node.state.as_deref());
                let state = |(action, part): (Action, Option<Part>)| {
                    let state = changed(thing.card, part, action, now)
                        .ok_or_else(|| Mismatch::Unreadable { phrase: format!("{action:?} {}", text(object)) })?;
                    Ok(vec![ReadAtom::State { object: thing.id.clone(), state }])
                };
                meanings(*action, *part, &thing.card.states).into_iter().map(state).collect()
            }
        }
    }

    /// Alternative conjunctions of conditions that bring all subjects to a place.
    fn put(&mut self, subjects: &[Group], place: &Place) -> Result<Vec<Vec<ReadAtom>>, Mismatch> {
        if let ([subject], [each]) = (subjects, place.objects.as_slice())
            && matches!(each.number, Number::Each(_))
        {
            let references = self.several(each)?;
            let number = if subject.number == Number::One { Number::Many(references.len()) } else { subject.number };
            let things = self.several(&Group { number, ..subject.clone() })?;
            if things.len() != references.len() {
                return Err(unclear(subject, &things));
            }
            let pair = |(thing, to): (&SceneObject, &usize)| place_of(thing, place.relations, &[references[*to]]);
            let pairs = |order: &Vec<usize>| things.iter().zip(order).map(pair).collect();
            return Ok(permutations(things.len()).iter().map(pairs).collect());
        }
        let mut things = Vec::new();
        for subject in subjects {
            things.extend(self.several(subject)?);
        }
        let references = self.references(place, Self::any)?;
        Ok(vec![things.iter().map(|thing| place_of(thing, place.relations, &references)).collect()])
    }

    /// All objects that a phrase means.
    fn several(&mut self, group: &Group) -> Result<Vec<SceneObject<'c>>, Mismatch> {
        let expected = match group.number {
            Number::One => return Ok(vec![self.any(group)?]),
            Number::Many(count) | Number::Each(Some(count)) => Some(count),
            Number::All | Number::Each(None) => None,
        };
        let Candidates { mut things, mut certain } = self.candidates(group)?;
        for other in &group.except {
            let other = self.any(other)?;
            let place = things.iter().position(|thing| thing.id == other.id);
            let place = place.ok_or_else(|| unclear(group, &things))?;
            things.remove(place);
            certain -= usize::from(place < certain);
        }
        self.note(group, &things);
        let is_complete = expected.map_or(things.len() > 1, |count| things.len() == count);
        if is_complete && certain == things.len() { Ok(things) } else { Err(unclear(group, &things)) }
    }

    /// References of a place; `each` resolves the phrase for one object.
    fn references(
        &mut self,
        place: &Place,
        each: fn(&mut Self, &Group) -> Result<SceneObject<'c>, Mismatch>,
    ) -> Result<Vec<SceneObject<'c>>, Mismatch> {
        match place.objects.as_slice() {
            [two] if place.relations == [Relation::Between] && two.number != Number::One => {
                let meant = self.several(two)?;
                if meant.len() == 2 { Ok(meant) } else { Err(unclear(two, &meant)) }
            }
            [two] if place.relations == [Relation::Between] => {
                let words: Vec<&str> = two.words.iter().map(String::as_str).collect();
                let meant = match words.as_slice() {
                    ["two", rest @ ..] => self.denote(rest, two)?,
                    _ => return Err(Mismatch::Unreadable { phrase: text(two) }),
                };
                self.note(two, &meant);
                if meant.len() == 2 { Ok(meant) } else { Err(unclear(two, &meant)) }
            }
            objects => objects
                .iter()
                .map(|group| match group.number {
                    Number::One => each(self, group),
                    _ => Err(Mismatch::Unreadable { phrase: text(group) }),
                })
                .collect(),
        }
    }

    /// The only object that a phrase can mean.
    fn one(&mut self, group: &Group) -> Result<SceneObject<'c>, Mismatch> {
        let Candidates { things, .. } = self.candidates(group)?;
        self.note(group, &things);
        match things.as_slice() {
            [thing] => Ok(*thing),
            _ => Err(unclear(group, &things)),
        }
    }

    /// The object that a phrase means, or the first one of several interchangeable copies.
    fn any(&mut self, group: &Group) -> Result<SceneObject<'c>, Mismatch> {
        let Candidates { things, certain } = self.candidates(group)?;
        self.note(group, &things);
        match things.as_slice() {
            [thing] => Ok(*thing),
            [first, others @ ..]
                if certain == things.len() && others.iter().all(|other| other.card.asset == first.card.asset) =>
            {
                self.choices.push(things.iter().map(|thing| thing.id.clone()).collect());
                Ok(*first)
            }
            _ => Err(unclear(group, &things)),
        }
    }

    fn note(&mut self, group: &Group, meant: &[SceneObject<'c>]) {
        self.phrases.push((text(group), meant.iter().map(|thing| thing.id.clone()).collect()));
    }

    /// All possible referents of a phrase.
    fn candidates(&mut self, group: &Group) -> Result<Candidates<'c>, Mismatch> {
        let all = |things: Vec<SceneObject<'c>>| Candidates { certain: things.len(), things };
        let words: Vec<&str> = group.words.iter().map(String::as_str).collect();
        let of_several = |key: &str| words.iter().position(|word| *word == key);
        if let Some(index) = of_several("two").or_else(|| of_several("three"))
            && words[..index].ends_with(&["of", "the"])
        {
            let rest = self.denote(&words[index + 1..], group)?;
            let expected = if words[index] == "two" { 2 } else { 3 };
            return if rest.len() == expected {
                Ok(all(self.chosen(words[0], rest)))
            } else {
                Err(unclear(group, &rest))
            };
        }
        let extreme = ["farthest", "nearest", "closest"].into_iter().find_map(of_several);
        if let Some(index) = extreme {
            let noun = words[..index].strip_suffix(&["that", "is"][..]).unwrap_or(&words[..index]);
            let meant = self.denote(noun, group)?;
            let extreme = self.extreme(&words[index..], &meant);
            return extreme.map(all).ok_or_else(|| Mismatch::Unreadable { phrase: text(group) });
        }
        let meant = self.denote(&words, group)?;
        let Some(place) = &group.at else { return Ok(all(meant)) };
        let references = self.references(place, Self::one)?;
        let mut certain = Vec::new();
        let mut possible = Vec::new();
        for thing in meant {
            if references.iter().any(|reference| reference.id == thing.id) {
                continue;
            }
            let certainty = match references.as_slice() {
                [one, other] => self.space.is_between(thing.id, one.id, other.id),
                [one] => self.space.stands(thing.id, place.relations, one.id),
                _ => Certainty::Impossible,
            };
            match certainty {
                Certainty::Certain => certain.push(thing),
                Certainty::Possible => possible.push(thing),
                Certainty::Impossible => {}
            }
        }
        if certain.is_empty() {
            return Ok(all(certain));
        }
        let count = certain.len();
        Ok(Candidates { things: certain.into_iter().chain(possible).collect(), certain: count })
    }

    fn denote(&self, words: &[&str], group: &Group) -> Result<Vec<SceneObject<'c>>, Mismatch> {
        lexicon().denote(words, self.context, &self.things).ok_or_else(|| Mismatch::Unreadable { phrase: text(group) })
    }

    /// Resolves phrases of choice such as `larger of the two` or `middle one of the three`.
    fn chosen(&self, word: &str, among: Vec<SceneObject<'c>>) -> Vec<SceneObject<'c>> {
        let volume = |thing: &SceneObject| thing.card.size_m.element_product();
        let extreme = |sign: f64| {
            let best = among.iter().map(|thing| sign * volume(thing)).fold(f64::NEG_INFINITY, f64::max);
            // Sizes within 20 % of each other count as equal.
            among.iter().copied().filter(|thing| sign * volume(thing) > best - 0.2 * best.abs()).collect()
        };
        match word {
            "larger" | "bigger" => extreme(1.0),
            "smaller" => extreme(-1.0),
            "middle" => {
                let between = |thing: &&SceneObject| {
                    [HorizontalAxis::Depth, HorizontalAxis::Width].into_iter().any(|axis| {
                        let beyond = |one: &InstanceId, other: &InstanceId| self.space.is_beyond(one, axis, other);
                        let others = || among.iter().filter(|other| other.id != thing.id);
                        others().any(|other| beyond(thing.id, other.id))
                            && others().any(|other| beyond(other.id, thing.id))
                    })
                };
                among.iter().filter(between).copied().collect()
            }
            _ => among,
        }
    }

    /// The objects that are certainly the farthest in the direction of the words; `None` if the words name no
    /// direction.
    fn extreme(&self, words: &[&str], among: &[SceneObject<'c>]) -> Option<Vec<SceneObject<'c>>> {
        let (axis, outward) = match words {
            // The camera faces the robot.
            ["farthest", "to", "the", "robot's", "left"] | ["farthest", "to", "the", "camera's", "right"] => {
                (HorizontalAxis::Width, true)
            }
            ["farthest", "to", "the", "robot's", "right"] | ["farthest", "to", "the", "camera's", "left"] => {
                (HorizontalAxis::Width, false)
            }
            ["farthest", "from", "the", "robot"] | ["nearest" | "closest", "to", "the", "camera"] => {
                (HorizontalAxis::Depth, true)
            }
            ["nearest" | "closest", "to", "the", "robot"] | ["farthest", "from", "the", "camera"] => {
                (HorizontalAxis::Depth, false)
            }
            _ => return None,
        };
        let wins = |thing: &&SceneObject| {
            among.iter().filter(|other| other.id != thing.id).all(|other| match outward {
                true => self.space.is_beyond(thing.id, axis, other.id),
                false => self.space.is_beyond(other.id, axis, thing.id),
            })
        };
        Some(among.iter().filter(wins).copied().collect())
    }
}

/// The condition that an object is at a place; without references, on the table.
fn place_of(thing: &SceneObject, relations: &[Relation], references: &[SceneObject]) -> ReadAtom {
    let mut ids: Vec<ReferenceId> = references.iter().map(|thing| thing.id.clone().into()).collect();
    if ids.is_empty() {
        ids.push(TABLE.into());
    }
    ReadAtom::Place { subject: thing.id.clone(), relations: relations.to_vec(), references: ids }
}

/// All orders of the numbers below `count`.
pub(super) fn permutations(count: usize) -> Vec<Vec<usize>> {
    (0..count).fold(vec![Vec::new()], |orders, last| {
        let insert = |order: &Vec<usize>| -> Vec<Vec<usize>> {
            (0..=order.len()).map(|at| [&order[..at], &[last], &order[at..]].concat()).collect()
        };
        orders.iter().flat_map(insert).collect()
    })
}

/// Conjunctions of every alternative of one list with every alternative of the other.
pub(super) fn conjunctions<T: Clone>(before: &[Vec<T>], options: &[Vec<T>]) -> Vec<Vec<T>> {
    before.iter().flat_map(|before| options.iter().map(move |more| [&before[..], more].concat())).collect()
}

/// The state after an action; `None` if the object has no such state or is already in it.
pub(crate) fn changed(card: &ObjectCard, part: Option<Part>, action: Action, now: Option<&str>) -> Option<String> {
    let drawers = card.states.iter().any(|state| state == "top_open");
    let now = now?;
    if action == Action::Reclose {
        return Some(now.to_owned()).filter(|now| now == "closed");
    }
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
        (Action::Close, Some(Part::Any), "top_open" | "bottom_open") if drawers => "closed",
        (Action::Open, None, _) if card.category == "faucet" => "on",
        (Action::Close, None, _) if card.category == "faucet" => "off",
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

fn unclear(group: &Group, meant: &[SceneObject]) -> Mismatch {
    let phrase = text(group);
    if meant.is_empty() {
        return Mismatch::Nothing { phrase };
    }
    Mismatch::Ambiguous { phrase, ids: meant.iter().map(|thing| thing.id.clone()).collect() }
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
