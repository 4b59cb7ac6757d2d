//! Parser of a sentence without a scene: candidate objects of a catalogue for each noun phrase, and the requested goal.

use genmanip_core::{ObjectCard, Relation};

pub(crate) use super::change::{Action, Part};
use super::grammar::{self, Group, Parsed, Place};
use super::lexicon::{COMPARATIVES, SceneObject, lexicon};
pub(crate) use super::meaning::changed as changed_state;
use super::meaning::conjunctions;
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
    /// Objects of `meant` whose name contains the noun itself.
    pub best: Vec<&'c ObjectCard>,
    /// Objects that share the noun or a word with the phrase; empty if it means any object.
    pub alike: Vec<&'c ObjectCard>,
    /// Location of the object in the initial scene, from a relative clause; `None` without one.
    pub at: Option<Where>,
    /// True if the phrase compares the size of the object with that of another one.
    pub compares: bool,
}

/// A place beside, in or on an object, or between two.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Where {
    /// Relations that the preposition can mean.
    pub relations: &'static [Relation],
    /// Indices of one noun, or of two for `between`.
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

impl Sentence<'_> {
    /// Commands in which a noun has a part.
    pub fn commands_of(&self, noun: usize) -> impl Iterator<Item = &Command> {
        self.alternatives.iter().flatten().filter(move |command| match command {
            Command::Put { subject, place } => *subject == noun || place.references.contains(&noun),
            Command::Change { object, .. } => *object == noun,
        })
    }
}

/// Reads a sentence; `None` if it is outside the grammar or compares locations (`the mug farthest from the robot`).
pub(crate) fn read_sentence<'c>(sentence: &str, cards: &'c [ObjectCard]) -> Option<Sentence<'c>> {
    let mut readings = grammar::readings(sentence).filter_map(|parsed| resolve(&parsed, cards));
    let first = readings.next()?;
    let is_clear = |sentence: &Sentence| sentence.nouns.iter().all(|noun| !noun.meant.is_empty());
    if is_clear(&first) { Some(first) } else { Some(readings.find(is_clear).unwrap_or(first)) }
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
    /// Noun phrases resolved so far, each with the index of its noun.
    groups: Vec<(Group, usize)>,
    nouns: Vec<Noun<'c>>,
}

impl<'c> Resolver<'c, '_> {
    /// Alternative lists of commands that fulfil a command of the grammar.
    fn options(&mut self, command: &grammar::Command) -> Option<Vec<Vec<Command>>> {
        match command {
            grammar::Command::Either(commands) => {
                let options: Option<Vec<_>> = commands.iter().map(|command| self.options(command)).collect();
                Some(options?.concat())
            }
            grammar::Command::Put { subjects, places } => {
                let subjects: Vec<usize> = subjects.iter().map(|group| self.noun(group)).collect::<Option<_>>()?;
                let places: Vec<Where> = places.iter().map(|place| self.place(place)).collect::<Option<_>>()?;
                let put = |subject: &usize, place: &Where| Command::Put { subject: *subject, place: place.clone() };
                Some(places.iter().map(|place| subjects.iter().map(|subject| put(subject, place)).collect()).collect())
            }
            grammar::Command::Change { object, part, action } => {
                Some(vec![vec![Command::Change { object: self.noun(object)?, part: *part, action: *action }]])
            }
        }
    }

    fn place(&mut self, place: &Place) -> Option<Where> {
        let references = match place.objects.as_slice() {
            [two] if place.relations == [Relation::Between] => {
                let rest = two.words.strip_prefix(&["two".to_owned()][..])?;
                let group = Group { words: rest.to_vec(), at: None };
                vec![self.add(&group)?, self.add(&group)?]
            }
            objects => objects.iter().map(|group| self.noun(group)).collect::<Option<_>>()?,
        };
        Some(Where { relations: place.relations, references })
    }

    /// Index of the noun of a phrase; the same phrase, or the end of an earlier one, means the same object.
    fn noun(&mut self, group: &Group) -> Option<usize> {
        let repeats = |known: &Group| group.at.is_none() && known.words.ends_with(&group.words);
        match self.groups.iter().find(|(known, _)| known == group || repeats(known)) {
            Some((_, noun)) => Some(*noun),
            None => self.add(group),
        }
    }

    fn add(&mut self, group: &Group) -> Option<usize> {
        let at = match &group.at {
            Some(place) => Some(self.place(place)?),
            None => None,
        };
        let words: Vec<&str> = group.words.iter().map(String::as_str).collect();
        let is_extreme = words.iter().any(|word| EXTREMES.contains(word));
        let (said, compares) = match words.as_slice() {
            [word, "of", "the", "two", rest @ ..]
                if COMPARATIVES.contains(word) || ["large", "small"].contains(word) =>
            {
                (rest, true)
            }
            [.., "of", "the", "two" | "three", _] => return None,
            _ => (&words[..], false),
        };
        if is_extreme || said.is_empty() {
            return None;
        }
        let compared = said.iter().any(|word| COMPARATIVES.contains(word));
        let plain: Vec<&str> = said.iter().copied().filter(|word| !COMPARATIVES.contains(word)).collect();
        let denote = |words: &[&str]| lexicon().denote(words, self.context, &self.things).unwrap_or_default();
        let cards = |things: Vec<SceneObject<'c, ()>>| things.into_iter().map(|thing| thing.card).collect::<Vec<_>>();
        let meant = cards(denote(&plain));
        let best = meant.iter().copied().filter(|card| lexicon().is_named(&plain, card)).collect();
        let alike = if meant.is_empty() { self.alike(&plain) } else { Vec::new() };
        let noun = Noun { phrase: words.join(" "), meant, best, alike, at, compares: compares || compared };
        self.nouns.push(noun);
        self.groups.push((group.clone(), self.nouns.len() - 1));
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
        among.into_iter().map(|thing| thing.card).collect()
    }
}
