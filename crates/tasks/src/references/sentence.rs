//! Parser of a sentence without a scene: candidate objects of a catalogue for each noun phrase, and the requested goal.

use genmanip_core::{ObjectCard, Relation};

use super::change::meanings;
pub(crate) use super::change::{Action, Part};
pub(crate) use super::command::TABLE;
use super::command::{self, Group, Number, Parsed, Place};
use super::lexicon::{COMPARATIVES, SceneObject, lexicon};
pub(crate) use super::meaning::changed as changed_state;
use super::meaning::{conjunctions, permutations};
use super::spoken;
use super::words::EXTREMES;

/// A sentence with its noun phrases resolved in a catalogue.
#[derive(Debug)]
pub(crate) struct Sentence<'c> {
    /// Noun phrases, one per object to which the sentence refers.
    pub nouns: Vec<Noun<'c>>,
    /// Alternative lists of commands, one of which is to be carried out.
    pub alternatives: Vec<Vec<Command>>,
}

/// A noun phrase.
#[derive(Debug)]
pub(crate) struct Noun<'c> {
    pub phrase: String,
    /// Objects that the phrase may mean.
    pub meant: Vec<&'c ObjectCard>,
    /// Objects of `meant` that the noun means first.
    pub best: Vec<&'c ObjectCard>,
    /// True if the noun is the category of those in `best`, so that no others are meant.
    pub is_exact: bool,
    /// Objects that share the noun or a word with the phrase; empty if it means any object.
    pub alike: Vec<&'c ObjectCard>,
    /// Location of the object in the initial scene, from a relative clause; `None` without one.
    pub at: Option<Where>,
    /// Number of other objects with whose size or position the phrase compares that of the object.
    pub rivals: usize,
    /// Relation of those others to the object, if positions are compared: `leftmost` has them to its right.
    pub beyond: Option<Relation>,
    /// Part that is meant, such as the top drawer; `None` for the whole object.
    pub part: Option<Part>,
}

/// A place beside, in or on an object, or between two.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Where {
    /// Relations that the preposition can mean.
    pub relations: &'static [Relation],
    /// Indices of one noun, or of two for `between`; none for the table.
    pub references: Vec<usize>,
}

/// One request about nouns by index.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Command {
    /// Bring an object to a place.
    Put { subject: usize, place: Where },
    /// Change the state of an object.
    Change { object: usize, part: Option<Part>, action: Action },
}

impl<'c> Noun<'c> {
    /// Objects that can stand for the noun.
    pub fn candidates(&self) -> &[&'c ObjectCard] {
        if self.is_exact { &self.best } else { &self.meant }
    }
}

impl Sentence<'_> {
    /// Commands in which a noun has a part.
    pub fn commands_of(&self, noun: usize) -> impl Iterator<Item = &Command> {
        self.alternatives.iter().flatten().filter(move |command| match command {
            Command::Put { subject, place } => *subject == noun || place.references.contains(&noun),
            Command::Change { object, .. } => *object == noun,
        })
    }

    /// True if two commands bring different objects to the same place, but no alternative demands both.
    pub fn shares_room(&self, one: &Command, other: &Command) -> bool {
        let (Command::Put { place, .. }, Command::Put { place: known, .. }) = (one, other) else { return false };
        place == known && !self.alternatives.iter().any(|commands| commands.contains(one) && commands.contains(other))
    }
}

/// Reads a sentence; otherwise the reason why it is no request that a scene without layout can state, such as
/// a comparison of locations (`the mug farthest from the robot`).
pub(crate) fn read_sentence<'c>(sentence: &str, cards: &'c [ObjectCard]) -> Result<Sentence<'c>, String> {
    let parsed = spoken::hear(sentence)?;
    resolve(&parsed, cards).ok_or_else(|| "a phrase compares locations or means a choice of objects".into())
}

/// Resolves a parsed sentence in a catalogue; `None` if it compares locations.
fn resolve<'c>(parsed: &Parsed, cards: &'c [ObjectCard]) -> Option<Sentence<'c>> {
    let things = cards.iter().map(|card| SceneObject { id: (), card }).collect();
    let mut resolver = Resolver { things, context: &parsed.context, groups: Vec::new(), nouns: Vec::new() };
    let mut alternatives = vec![Vec::new()];
    for command in &parsed.commands {
        alternatives = conjunctions(&alternatives, &resolver.options(command)?);
    }
    Some(Sentence { nouns: resolver.nouns, alternatives })
}

struct Resolver<'c, 'p> {
    things: Vec<SceneObject<'c, ()>>,
    /// Clauses of the sentence that contain no command.
    context: &'p str,
    /// Noun phrases resolved so far, each with the indices of its nouns.
    groups: Vec<(Group, Vec<usize>)>,
    nouns: Vec<Noun<'c>>,
}

impl<'c> Resolver<'c, '_> {
    /// Alternative lists of commands that fulfil a command of the grammar.
    fn options(&mut self, command: &command::Command) -> Option<Vec<Vec<Command>>> {
        match command {
            command::Command::Either(commands) => {
                let options: Option<Vec<_>> = commands.iter().map(|command| self.options(command)).collect();
                Some(options?.concat())
            }
            command::Command::Put { subjects, places } => {
                let mut options = Vec::new();
                for place in places {
                    options.extend(self.put(subjects, place)?);
                }
                Some(options)
            }
            command::Command::Sides { subjects, of } => {
                let subjects: Vec<Vec<usize>> =
                    subjects.iter().map(|group| self.nouns(group)).collect::<Option<_>>()?;
                let (subjects, middle) = (subjects.concat(), self.noun(of)?);
                let beside = |(subject, side): (&usize, &'static [Relation])| Command::Put {
                    subject: *subject,
                    place: Where { relations: side, references: vec![middle] },
                };
                const LEFT: &[Relation] = &[Relation::Left];
                const RIGHT: &[Relation] = &[Relation::Right];
                let orders = [[LEFT, RIGHT], [RIGHT, LEFT]];
                let pairs = |order: &[&'static [Relation]; 2]| subjects.iter().zip(*order).map(beside).collect();
                (1..=2).contains(&subjects.len()).then(|| orders.iter().map(pairs).collect())
            }
            command::Command::Tower(groups) => {
                let nouns: Vec<Vec<usize>> = groups.iter().map(|group| self.nouns(group)).collect::<Option<_>>()?;
                let nouns = nouns.concat();
                let orders =
                    if groups.len() == 1 { permutations(nouns.len()) } else { vec![(0..nouns.len()).collect()] };
                let on = |pair: &[usize]| Command::Put {
                    subject: nouns[pair[1]],
                    place: Where { relations: &[Relation::On, Relation::Top], references: vec![nouns[pair[0]]] },
                };
                Some(orders.iter().map(|order| order.windows(2).map(on).collect()).collect())
            }
            command::Command::Given(group) => self.nouns(group).map(|_| vec![Vec::new()]),
            command::Command::Change { object, part, action } => {
                let object = self.noun(object)?;
                // `the lid of the bin`: of several kinds the one that has states.
                let noun = &mut self.nouns[object];
                if !noun.candidates().iter().any(|card| card.is_articulated)
                    && noun.meant.iter().any(|card| card.is_articulated)
                {
                    noun.meant.retain(|card| card.is_articulated);
                    noun.best.clone_from(&noun.meant);
                }
                let states = self.nouns[object].candidates().first().map_or(&[][..], |card| &card.states);
                let change = |(action, part)| vec![Command::Change { object, part, action }];
                Some(meanings(*action, *part, states).into_iter().map(change).collect())
            }
        }
    }

    /// Alternative lists of commands that bring all subjects to a place.
    fn put(&mut self, subjects: &[Group], place: &Place) -> Option<Vec<Vec<Command>>> {
        if let ([subject], [each]) = (subjects, place.objects.as_slice())
            && matches!(each.number, Number::Each(_))
        {
            let references = self.nouns(each)?;
            let number = if subject.number == Number::One { Number::Many(references.len()) } else { subject.number };
            let subjects = self.nouns(&Group { number, ..subject.clone() })?;
            if subjects.len() != references.len() {
                return None;
            }
            let pair = |(subject, to): (&usize, &usize)| Command::Put {
                subject: *subject,
                place: Where { relations: place.relations, references: vec![references[*to]] },
            };
            let pairs = |order: &Vec<usize>| subjects.iter().zip(order).map(pair).collect();
            return Some(permutations(subjects.len()).iter().map(pairs).collect());
        }
        let subjects: Vec<Vec<usize>> = subjects.iter().map(|group| self.nouns(group)).collect::<Option<_>>()?;
        let place = self.place(place)?;
        let put = |subject: &usize| Command::Put { subject: *subject, place: place.clone() };
        Some(vec![subjects.concat().iter().map(put).collect()])
    }

    fn place(&mut self, place: &Place) -> Option<Where> {
        let references = match place.objects.as_slice() {
            [two] if place.relations == [Relation::Between] => {
                let nouns = self.nouns(two)?;
                (nouns.len() == 2).then_some(nouns)?
            }
            objects => objects.iter().map(|group| self.noun(group)).collect::<Option<_>>()?,
        };
        Some(Where { relations: place.relations, references })
    }

    /// Index of the noun of a phrase for one object.
    fn noun(&mut self, group: &Group) -> Option<usize> {
        match self.nouns(group)?.as_slice() {
            [noun] => Some(*noun),
            _ => None,
        }
    }

    /// Indices of the nouns of a phrase, one per object; the same phrase, or the end of an earlier one, means the same
    /// objects. `all the pencils` are two.
    fn nouns(&mut self, group: &Group) -> Option<Vec<usize>> {
        let count = match group.number {
            Number::One => 1,
            Number::Many(count) | Number::Each(Some(count)) => count,
            Number::All | Number::Each(None) => 2,
        };
        let repeats = |known: &Group| group.at.is_none() && known.words.ends_with(&group.words);
        let known =
            self.groups.iter().find(|(known, nouns)| nouns.len() == count && (known == group || repeats(known)));
        if let Some((_, nouns)) = known {
            return Some(nouns.clone());
        }
        let at = match &group.at {
            Some(place) => Some(self.place(place)?),
            None => None,
        };
        let at = at.filter(|at| !at.references.is_empty());
        let nouns: Vec<usize> = (0..count).map(|_| self.add(group, at.clone())).collect::<Option<_>>()?;
        self.groups.push((group.clone(), nouns.clone()));
        for other in &group.except {
            self.noun(other)?;
        }
        Some(nouns)
    }

    fn add(&mut self, group: &Group, at: Option<Where>) -> Option<usize> {
        let words: Vec<&str> = group.words.iter().map(String::as_str).collect();
        let extreme = words.iter().position(|word| EXTREMES.contains(word));
        let beyond = match extreme {
            Some(index) => Some(others_beyond(&words[index..])?),
            None => None,
        };
        let named = &words[..extreme.unwrap_or(words.len())];
        let (said, rivals) = match named.strip_suffix(&["that", "is"]).unwrap_or(named) {
            [word, "of", "the", count @ ("two" | "three"), rest @ ..]
                if COMPARATIVES.contains(word) || ["large", "small"].contains(word) =>
            {
                (rest, if *count == "two" { 1 } else { 2 })
            }
            [.., "of", "the", "two" | "three", _] => return None,
            said => (said, 0),
        };
        if said.is_empty() {
            return None;
        }
        let compared = said.iter().any(|word| COMPARATIVES.contains(word));
        let plain: Vec<&str> = said.iter().copied().filter(|word| !COMPARATIVES.contains(word)).collect();
        let denote = |words: &[&str]| lexicon().denote(words, self.context, &self.things).unwrap_or_default();
        let cards = |things: Vec<SceneObject<'c, ()>>| things.into_iter().map(|thing| thing.card).collect::<Vec<_>>();
        let mut meant = cards(denote(&plain));
        if meant.is_empty() {
            // `the little car` among cars of one size
            let sizeless: Vec<&str> = plain.iter().copied().filter(|word| !lexicon().is_size(word)).collect();
            meant = if sizeless.is_empty() { meant } else { cards(denote(&sizeless)) };
        }
        if lexicon().is_label(&plain, &meant) {
            meant.clear();
        }
        if meant.iter().any(|card| lexicon().is_likely(&plain, card)) {
            meant.retain(|card| lexicon().is_likely(&plain, card));
        }
        let (best, is_exact) = lexicon().plainest(&plain, &meant);
        let alike = if meant.is_empty() { self.alike(&plain) } else { Vec::new() };
        let rivals = rivals.max(usize::from(compared || beyond.is_some()));
        let noun = Noun { phrase: words.join(" "), meant, best, alike, at, rivals, beyond, part: group.part, is_exact };
        self.nouns.push(noun);
        Some(self.nouns.len() - 1)
    }

    /// Objects that the noun without its adjectives may mean; if there are none, objects that share a word with the
    /// phrase.
    fn alike(&self, words: &[&str]) -> Vec<&'c ObjectCard> {
        let bare = lexicon().bare(words);
        let of_noun = lexicon().denote(&bare, self.context, &self.things).unwrap_or_default();
        let shares = |thing: &&SceneObject<'_, ()>| {
            let name = thing.card.name.to_lowercase();
            name.split(' ').any(|word| words.contains(&word)) || words.contains(&thing.card.category.as_str())
        };
        let among = if of_noun.is_empty() { self.things.iter().filter(shares).copied().collect() } else { of_noun };
        if among.is_empty() {
            let noun = bare.last().copied().unwrap_or_default();
            return lexicon().nearby(noun, self.things.iter().map(|thing| thing.card));
        }
        among.into_iter().map(|thing| thing.card).collect()
    }
}

/// Relation of other objects to the one that is the farthest or nearest in a direction; `None` if no layout by relations
/// decides it.
fn others_beyond(extreme: &[&str]) -> Option<Relation> {
    match extreme {
        // The camera faces the robot.
        ["farthest", "to", "the", "robot's", "left"] | ["farthest", "to", "the", "camera's", "right"] => {
            Some(Relation::Right)
        }
        ["farthest", "to", "the", "robot's", "right"] | ["farthest", "to", "the", "camera's", "left"] => {
            Some(Relation::Left)
        }
        ["farthest", "from", "the", "robot"] | ["nearest" | "closest", "to", "the", "camera"] => Some(Relation::Back),
        ["nearest" | "closest", "to", "the", "robot"] | ["farthest", "from", "the", "camera"] => Some(Relation::Front),
        _ => None,
    }
}
