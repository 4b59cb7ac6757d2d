//! Composes a task from a sentence: the independent reader parses it, the catalogue provides its objects, and the
//! designer builds a scene in which the sentence states exactly one goal.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{ObjectCard, Relation, RelationKind, Seed, Support, Task, TaskKind};
use rand::seq::IndexedRandom;

use super::balance::Balance;
use super::choices::Choices;
use super::composer::{Composer, Place};
use super::kinds::draft;
use super::naming::Style;
use super::settings::DesignSettings;
use super::sketch::{Condition, Sketch};
use super::things::{is_movable, things};
use super::{counted, gate};
use crate::references::sentence::{Action, Command, Noun, Part, Sentence, Where, changed_state, read_sentence};

/// Source of tasks that were composed from a sentence.
pub const SENTENCE: &str = "sentence";

/// Maximum number of candidates that a question lists.
const MAX_CANDIDATES: usize = 6;

/// Reason why a sentence is no task, as a question to its author.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SentenceError {
    /// The sentence is outside the grammar of requests.
    #[error("the sentence is not understood: `{sentence}`")]
    Unreadable {
        /// The whole sentence, verbatim.
        sentence: String,
    },
    /// A phrase fits no object of the catalogue.
    #[error("no object of the catalogue is `{phrase}`{}", listed(.candidates))]
    NoObject {
        /// The phrase without a matching object.
        phrase: String,
        /// Names of objects that share a word with the phrase.
        candidates: Vec<String>,
    },
    /// The phrase fits objects, but none of them can have its part in the request.
    #[error("`{phrase}` {why}{}", listed(.candidates))]
    Unsuitable {
        /// The phrase without a suitable object.
        phrase: String,
        /// Reason why the objects are unsuitable.
        why: &'static str,
        /// Names of objects that fit the phrase.
        candidates: Vec<String>,
    },
    /// No scene was found in which the sentence states one goal.
    #[error("no scene was found for the sentence in {draws} designs: {}", counted(.rejections))]
    NoScene {
        /// Number of designs tried.
        draws: usize,
        /// Number of rejections by reason.
        rejections: BTreeMap<String, usize>,
    },
}

fn listed(candidates: &[String]) -> String {
    if candidates.is_empty() { String::new() } else { format!("; candidates: {}", candidates.join(", ")) }
}

/// Composes the task that a sentence states, from these objects; `seed` decides among several suitable objects, and
/// what else is on the table and where.
///
/// The sentence becomes the instruction unchanged. It is read back in the finished scene, so that it is never ambiguous
/// there.
///
/// # Errors
/// [`SentenceError`] if the sentence or a phrase is not understood, or no scene suits it.
///
/// ```
/// use genmanip_assets::Catalogue;
/// use genmanip_core::{Atom, Relation, Seed};
/// use genmanip_tasks::designer::{DesignSettings, task_from_sentence};
///
/// let cards = Catalogue::builtin().cards();
/// let sentence = "put the red mug to the left of the bowl";
/// let task = task_from_sentence(sentence, cards, Seed::new(1), "mug", &DesignSettings::default())?;
/// let Atom::Relation { relation, .. } = &task.goal.alternatives[0][0] else { panic!() };
/// assert_eq!(*relation, Relation::Left);
/// # Ok::<(), genmanip_tasks::designer::SentenceError>(())
/// ```
pub fn task_from_sentence(
    sentence: &str,
    cards: &[ObjectCard],
    seed: Seed,
    id: &str,
    settings: &DesignSettings,
) -> Result<Task, SentenceError> {
    let unreadable = || SentenceError::Unreadable { sentence: sentence.to_owned() };
    let parsed = read_sentence(sentence, cards).ok_or_else(unreadable)?;
    check_nouns(&parsed)?;
    let kind = kind_of(&parsed);
    let choices = Choices::of(cards);
    let mut rejections: BTreeMap<String, usize> = BTreeMap::new();
    for draw in 0..settings.max_draws {
        let mut composer = Composer {
            choices: &choices,
            settings,
            rng: seed.fork_index(draw as u64).rng(),
            balance: Balance::default().ignored(),
            sketch: Sketch::new(),
            theme: &[],
        };
        let made = Scene::compose(&parsed, &mut composer)
            .and_then(|goal| draft(&mut composer, sentence.to_owned(), goal).ok_or("the table has no room"))
            .map_err(String::from)
            .and_then(|draft| gate::pass(&composer.sketch, &draft, kind, id, SENTENCE));
        match made {
            Ok(task) => return Ok(task),
            Err(reason) => *rejections.entry(reason).or_default() += 1,
        }
    }
    Err(SentenceError::NoScene { draws: settings.max_draws, rejections })
}

/// A noun phrase of a sentence.
#[derive(Clone, Debug, PartialEq)]
pub struct SentencePhrase<'c> {
    /// Words of the phrase.
    pub phrase: String,
    /// Objects that the phrase may mean, those named by the noun itself first; several where it is ambiguous.
    pub meant: Vec<&'c ObjectCard>,
    /// Objects that share a word with the phrase; empty if it means any object.
    pub alike: Vec<&'c ObjectCard>,
}

/// Noun phrases of a sentence, to ask which objects are meant before [`task_from_sentence`] decides by its seed.
///
/// # Errors
/// [`SentenceError::Unreadable`].
pub fn phrases_of_sentence<'c>(
    sentence: &str,
    cards: &'c [ObjectCard],
) -> Result<Vec<SentencePhrase<'c>>, SentenceError> {
    let unreadable = || SentenceError::Unreadable { sentence: sentence.to_owned() };
    let parsed = read_sentence(sentence, cards).ok_or_else(unreadable)?;
    let phrase = |noun: Noun<'c>| {
        let is_best = |card: &&ObjectCard| noun.best.iter().any(|best| best.uid == card.uid);
        let (best, others): (Vec<&ObjectCard>, Vec<&ObjectCard>) = noun.meant.iter().partition(|card| is_best(card));
        SentencePhrase { phrase: noun.phrase, meant: [best, others].concat(), alike: noun.alike }
    };
    Ok(parsed.nouns.into_iter().map(phrase).collect())
}

/// Checks that every phrase fits an object that can have its part in the request.
fn check_nouns(sentence: &Sentence) -> Result<(), SentenceError> {
    for noun in &sentence.nouns {
        if noun.meant.is_empty() {
            let candidates = named(noun.alike.iter().copied());
            return Err(SentenceError::NoObject { phrase: noun.phrase.clone(), candidates });
        }
    }
    let unsuitable = |noun: &Noun, why| SentenceError::Unsuitable {
        phrase: noun.phrase.clone(),
        why,
        candidates: named(noun.meant.iter().copied()),
    };
    for command in sentence.alternatives.iter().flatten() {
        match command {
            Command::Put { subject, place } => {
                let subject = &sentence.nouns[*subject];
                if !subject.meant.iter().any(|card| is_movable(card)) {
                    return Err(unsuitable(subject, "is nothing that the gripper can carry"));
                }
                let host = &sentence.nouns[place.references[0]];
                let fits = |host: &ObjectCard| subject.meant.iter().any(|item| support(place, host, item).is_some());
                let is_support = place.relations.iter().any(|relation| relation.is_support());
                if is_support && !host.meant.iter().any(|host| fits(host)) {
                    return Err(unsuitable(host, "has no room for the object"));
                }
            }
            Command::Change { object, part, action } => {
                let noun = &sentence.nouns[*object];
                if !noun.meant.iter().any(|card| can_change(card, *part, *action)) {
                    return Err(unsuitable(noun, "has no such state"));
                }
            }
        }
    }
    Ok(())
}

/// Names with uids of at most [`MAX_CANDIDATES`] objects, one of each category first.
fn named<'a>(cards: impl Iterator<Item = &'a ObjectCard>) -> Vec<String> {
    let mut categories = BTreeSet::new();
    let (first, more): (Vec<&ObjectCard>, Vec<&ObjectCard>) = cards.partition(|card| categories.insert(&card.category));
    first.iter().chain(&more).take(MAX_CANDIDATES).map(|card| format!("{} ({})", card.name, card.uid)).collect()
}

/// Kind of the task that a sentence states.
fn kind_of(sentence: &Sentence) -> TaskKind {
    let changes = |command: &Command| matches!(command, Command::Change { .. });
    if sentence.alternatives.iter().all(|commands| commands.iter().any(changes)) {
        TaskKind::Articulated
    } else if sentence.alternatives.iter().all(|commands| commands.len() > 1) {
        TaskKind::LongHorizon
    } else if sentence.nouns.iter().any(|noun| noun.at.is_some()) {
        TaskKind::Spatial
    } else {
        TaskKind::PickAndPlace
    }
}

/// Support relation in which `item` can be brought to a place at `host`; `None` if there is none.
fn support(place: &Where, host: &ObjectCard, item: &ObjectCard) -> Option<Relation> {
    let fits = |relation: Relation| match relation.kind() {
        RelationKind::Support(_) if host.uid == item.uid || !things().has_room(host, item) => false,
        RelationKind::Support(Support::In) => host.is_container && things().lies_inside(host, item),
        RelationKind::Support(Support::On) => host.annotations.room.is_none() && !host.is_articulated,
        RelationKind::Support(Support::OnOrIn) => host.annotations.room.is_some() && !host.is_articulated,
        RelationKind::Side(_) | RelationKind::Around | RelationKind::Between => false,
    };
    place.relations.iter().copied().find(|relation| fits(*relation))
}

/// A scene under construction: the object of each noun, and its index in the sketch.
struct Scene<'s, 'a> {
    sentence: &'s Sentence<'a>,
    cards: Vec<&'a ObjectCard>,
    objects: Vec<Option<usize>>,
}

/// Result of one design; the error is the reason for rejecting it.
type Made<T> = Result<T, &'static str>;

const NO_ROOM: &str = "the table has no room";

impl<'s, 'a> Scene<'s, 'a> {
    /// Adds the objects of the sentence and fillers; returns the goal.
    fn compose(sentence: &'s Sentence<'a>, composer: &mut Composer<'a>) -> Made<Vec<Vec<Condition>>> {
        let mut scene = Self::choose(sentence, composer)?;
        let commands = || sentence.alternatives.iter().flatten();
        // Objects of the goal are placed first, with free room for the goal, before anything else takes it.
        let mut conditions: Vec<(&Command, Condition)> = Vec::new();
        let mut moves = Vec::new();
        for command in commands() {
            if conditions.iter().any(|(known, _)| *known == command) {
                continue;
            }
            match command {
                Command::Put { subject, place } => {
                    moves.push((command, *subject, scene.destination(*subject, place, composer)?))
                }
                Command::Change { object, part, action } => {
                    let (index, card) = (scene.place(*object, composer)?, scene.cards[*object]);
                    let starts: Vec<(&String, String)> = card
                        .states
                        .iter()
                        .filter_map(|now| Some((now, changed_state(card, *part, *action, Some(now))?)))
                        .collect();
                    // The plainest change of an object with several states: from or to `closed`.
                    let closed = starts.iter().find(|(now, then)| *now == "closed" || then == "closed");
                    let (now, state) =
                        closed.or_else(|| starts.choose(&mut composer.rng)).ok_or("it has no such state")?;
                    composer.sketch.states[index] = Some((*now).clone());
                    conditions.push((command, Condition::State(index, state.clone())));
                }
            }
        }
        for (command, subject, place) in moves {
            let index = match scene.objects[subject] {
                Some(index) => index,
                None if sentence.nouns[subject].at.is_some() => scene.place(subject, composer)?,
                None => {
                    let index = composer.add_to_move(scene.cards[subject], place, Style::Plain).ok_or(NO_ROOM)?;
                    scene.objects[subject] = Some(index);
                    index
                }
            };
            if !composer.sketch.closed.contains(&index) {
                composer.sketch.closed.push(index);
            }
            conditions.push((command, place.of(index)));
        }
        for noun in 0..sentence.nouns.len() {
            scene.place(noun, composer)?;
        }
        scene.add_rivals(composer)?;
        let count = composer.object_count().max(composer.sketch.len());
        composer.fill(count);
        let condition = |command: &Command| {
            conditions.iter().find(|(known, _)| *known == command).map(|(_, condition)| condition.clone())
        };
        let goal = |commands: &Vec<Command>| commands.iter().filter_map(condition).collect();
        Ok(sentence.alternatives.iter().map(goal).collect())
    }

    /// Chooses an object for every noun, all different.
    fn choose(sentence: &'s Sentence<'a>, composer: &mut Composer<'a>) -> Made<Self> {
        let mut cards: Vec<&ObjectCard> = Vec::new();
        for (index, noun) in sentence.nouns.iter().enumerate() {
            let suits = |card: &&&ObjectCard| {
                let is_new = !cards.iter().any(|other| other.uid == card.uid);
                let card_of = |noun: usize| if noun == index { Some(**card) } else { cards.get(noun).copied() };
                is_new
                    && sentence
                        .commands_of(index)
                        .all(|command| can_have_part(command, index, card) && may_end_there(command, card_of))
            };
            let best: Vec<&&ObjectCard> = noun.best.iter().filter(suits).collect();
            let meant: Vec<&&ObjectCard> = noun.meant.iter().filter(suits).collect();
            let among = if best.is_empty() { &meant } else { &best };
            cards.push(among.choose(&mut composer.rng).ok_or("no object suits its part in the sentence")?);
        }
        Ok(Self { sentence, objects: vec![None; cards.len()], cards })
    }

    /// Index of a noun's object in the sketch; the object is added to the table unless it is there already.
    fn place(&mut self, noun: usize, composer: &mut Composer<'a>) -> Made<usize> {
        if let Some(index) = self.objects[noun] {
            return Ok(index);
        }
        let card = self.cards[noun];
        let index = match &self.sentence.nouns[noun].at {
            None => composer.add(card),
            Some(at) => {
                let references: Vec<usize> =
                    at.references.iter().map(|reference| self.place(*reference, composer)).collect::<Made<_>>()?;
                match (support(at, self.cards[at.references[0]], card), references.as_slice(), at.relations) {
                    (Some(relation), [host], _) => {
                        Some(composer.put(card, relation, *host).ok_or("the gripper could not take it out of there")?)
                    }
                    (None, [anchor], [relation]) => composer.add_beside(card, *relation, *anchor),
                    _ => return Err("it does not fit where it is to be taken from"),
                }
            }
        };
        let index = index.ok_or(NO_ROOM)?;
        self.objects[noun] = Some(index);
        Ok(index)
    }

    /// Goal position of a noun's object, with free room.
    fn destination(&mut self, subject: usize, place: &Where, composer: &mut Composer<'a>) -> Made<Place> {
        let item = self.cards[subject];
        let [first, ..] = place.references[..] else { return Err("the place has no object") };
        if let Some(relation) = support(place, self.cards[first], item) {
            let reference = self.place(first, composer)?;
            if !composer.sketch.closed.contains(&reference) {
                composer.sketch.closed.push(reference);
            }
            return Ok(Place { relation, reference, second: None });
        }
        let relation =
            *place.relations.iter().find(|relation| !relation.is_support()).ok_or("it does not fit there")?;
        let reference = self.place(first, composer)?;
        match place.references.get(1) {
            None => {
                // An object beside another one is also near it.
                let beside = Relation::SIDES.into_iter().filter(|side| side.implies(relation));
                let mut ways = std::iter::once(relation).chain(beside);
                ways.find_map(|way| composer.keep_free(item, way, reference)).ok_or(NO_ROOM)?;
                Ok(Place { relation, reference, second: None })
            }
            Some(&second) if self.objects[second].is_none() && self.sentence.nouns[second].at.is_none() => {
                let end = composer.add_across(item, reference, self.cards[second]).ok_or(NO_ROOM)?;
                self.objects[second] = Some(end);
                Ok(Place { relation, reference, second: Some(end) })
            }
            Some(_) => Err("both ends of the gap stand already"),
        }
    }

    /// Adds the objects with which a comparison such as `the larger bowl` compares.
    fn add_rivals(&self, composer: &mut Composer<'a>) -> Made<()> {
        for noun in self.sentence.nouns.iter().filter(|noun| noun.compares) {
            let rivals: Vec<&&ObjectCard> = noun.meant.iter().filter(|card| !composer.sketch.contains(card)).collect();
            let rival = rivals.choose(&mut composer.rng).ok_or("there is nothing to compare it with")?;
            composer.add(rival).ok_or(NO_ROOM)?;
        }
        Ok(())
    }
}

/// True if an action changes some state of an object; a cabinet with drawers has no door.
fn can_change(card: &ObjectCard, part: Option<Part>, action: Action) -> bool {
    let lacks_part = part == Some(Part::Other) && card.states.iter().any(|state| state == "top_open");
    !lacks_part && card.states.iter().any(|now| changed_state(card, part, action, Some(now)).is_some())
}

/// False if the subject of a command cannot be brought to its place; true while one of them is not chosen yet.
fn may_end_there<'a>(command: &Command, card_of: impl Fn(usize) -> Option<&'a ObjectCard>) -> bool {
    let Command::Put { subject, place } = command else { return true };
    let (Some(item), Some(host)) = (card_of(*subject), card_of(place.references[0])) else { return true };
    !place.relations.iter().any(|relation| relation.is_support()) || support(place, host, item).is_some()
}

/// True if the object can have the part in a command that the noun has.
fn can_have_part(command: &Command, noun: usize, card: &ObjectCard) -> bool {
    match command {
        Command::Put { subject, .. } if *subject == noun => is_movable(card),
        Command::Put { .. } => true,
        Command::Change { object, part, action } => *object != noun || can_change(card, *part, *action),
    }
}
