//! Composes a task from a sentence: the independent reader parses it, the catalogue provides its objects, and the
//! designer builds a scene in which the sentence states exactly one goal.

use std::collections::BTreeMap;

use genmanip_core::{ObjectCard, Relation, Seed, Task, TaskKind};
use rand::seq::IndexedRandom;

use super::balance::Balance;
use super::choices::Choices;
use super::composer::{Composer, Place};
use super::gate;
use super::kinds::draft;
use super::naming::Style;
use super::questions::{can_change, check_consistency, check_nouns, is_support};
use super::room::{open_state, support};
use super::sentence_error::SentenceError;
use super::settings::DesignSettings;
use super::sketch::{Condition, Sketch};
use super::things::{is_movable, things};
use crate::references::sentence::{Command, Noun, Sentence, Where, changed_state, read_sentence};

/// Source of tasks that were composed from a sentence.
pub const SENTENCE: &str = "sentence";

/// Factor by which the area of a sketch grows if a sentence's objects find no room in the usual one.
const SPACIOUS: f64 = 1.35;

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
    let unreadable = |why| SentenceError::Unreadable { sentence: sentence.to_owned(), why };
    let parsed = read_sentence(sentence, cards).map_err(unreadable)?;
    check_nouns(&parsed)?;
    check_consistency(&parsed).map_err(unreadable)?;
    let kind = kind_of(&parsed);
    let choices = Choices::of(cards);
    let mut rejections: BTreeMap<String, usize> = BTreeMap::new();
    // Sketches take objects for squares of their longer sides. Layouts find room for more.
    let spacious = DesignSettings { area_m: settings.area_m.map(|side| SPACIOUS * side), ..settings.clone() };
    for draw in 0..settings.max_draws {
        let mut composer = Composer {
            choices: &choices,
            settings: if 2 * draw < settings.max_draws { settings } else { &spacious },
            rng: seed.fork_index(draw as u64).rng(),
            balance: Balance::default().ignored(),
            sketch: Sketch::new(),
            theme: &[],
        };
        let is_strict = 2 * draw < settings.max_draws;
        let made = Scene::compose(&parsed, &mut composer, is_strict)
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
    let unreadable = |why| SentenceError::Unreadable { sentence: sentence.to_owned(), why };
    let parsed = read_sentence(sentence, cards).map_err(unreadable)?;
    let phrase = |noun: Noun<'c>| {
        let is_best = |card: &&ObjectCard| noun.best.iter().any(|best| best.uid == card.uid);
        let (best, others): (Vec<&ObjectCard>, Vec<&ObjectCard>) = noun.meant.iter().partition(|card| is_best(card));
        SentencePhrase { phrase: noun.phrase, meant: [best, others].concat(), alike: noun.alike }
    };
    Ok(parsed.nouns.into_iter().map(phrase).collect())
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

/// A scene under construction: the object of each noun, and its index in the sketch.
struct Scene<'s, 'a> {
    sentence: &'s Sentence<'a>,
    cards: Vec<&'a ObjectCard>,
    objects: Vec<Option<usize>>,
    /// True if objects that are to be moved must stand where they are easy to grasp.
    is_strict: bool,
}

/// Result of one design; the error is the reason for rejecting it.
type Made<T> = Result<T, &'static str>;

const NO_ROOM: &str = "the table has no room";

impl<'s, 'a> Scene<'s, 'a> {
    /// Adds the objects of the sentence and fillers; returns the goal.
    fn compose(sentence: &'s Sentence<'a>, composer: &mut Composer<'a>, is_strict: bool) -> Made<Vec<Vec<Condition>>> {
        let mut scene = Self { is_strict, ..Self::choose(sentence, composer)? };
        let commands = || sentence.alternatives.iter().flatten();
        // Objects of the goal are placed first, with free room for the goal, before anything else takes it.
        let mut conditions: Vec<(&Command, Condition)> = Vec::new();
        let mut moves: Vec<(&Command, usize, Place)> = Vec::new();
        let mut cleared = Vec::new();
        for command in commands() {
            if conditions.iter().any(|(known, _)| *known == command) {
                continue;
            }
            match command {
                Command::Put { subject, place } if place.references.is_empty() => cleared.push((command, *subject)),
                Command::Put { subject, place } => {
                    let is_kept_free = moves.iter().any(|(known, ..)| sentence.shares_room(command, known));
                    moves.push((command, *subject, scene.destination(*subject, place, is_kept_free, composer)?))
                }
                Command::Change { object, part, action } => {
                    let (index, card) = (scene.place(*object, composer)?, scene.cards[*object]);
                    let starts: Vec<(&String, String)> = card
                        .states
                        .iter()
                        .filter_map(|now| Some((now, changed_state(card, *part, *action, Some(now))?)))
                        .collect();
                    // The plainest change of an object with several states: from or to `closed`, or from `off`.
                    let is_plain = |now: &str, then: &str| now == "closed" || then == "closed" || now == "off";
                    let closed = starts.iter().find(|(now, then)| is_plain(now, then));
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
        for (command, subject) in cleared {
            let index = scene.place_off_table(subject, composer)?;
            composer.sketch.closed.push(index);
            conditions.push((command, Condition::OnTable(index)));
        }
        for noun in 0..sentence.nouns.len() {
            scene.place(noun, composer)?;
        }
        scene.open_hosts(composer)?;
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
            let meant: Vec<&&ObjectCard> = noun.candidates().iter().filter(suits).collect();
            let among = if best.is_empty() { &meant } else { &best };
            cards.push(among.choose(&mut composer.rng).ok_or("no object suits its part in the sentence")?);
        }
        Ok(Self { sentence, objects: vec![None; cards.len()], cards, is_strict: true })
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
                let moves = |command: &Command| matches!(command, Command::Put { subject, .. } if *subject == noun);
                if at.relations.iter().all(|relation| relation.is_support())
                    && self.sentence.commands_of(noun).any(moves)
                    && !things().lets_go(self.cards[at.references[0]], card, self.is_strict)
                {
                    return Err("the gripper does not reach it where it is");
                }
                match (support(at, self.cards[at.references[0]], card), references.as_slice(), at.relations) {
                    (Some(relation), [host], _) => Some(
                        composer
                            .sketch
                            .put_said(card, relation, *host)
                            .ok_or("it does not fit where it is to be taken from")?,
                    ),
                    (None, [anchor], [relation]) => composer.add_beside(card, *relation, *anchor),
                    _ => return Err("it does not fit where it is to be taken from"),
                }
            }
        };
        let index = index.ok_or(NO_ROOM)?;
        self.objects[noun] = Some(index);
        Ok(index)
    }

    /// Index of the object of a noun that stands on or in another one, from which it is brought to the table.
    fn place_off_table(&mut self, noun: usize, composer: &mut Composer<'a>) -> Made<usize> {
        if self.objects[noun].is_none() && self.sentence.nouns[noun].at.is_none() {
            let card = self.cards[noun];
            self.objects[noun] = Some(composer.add_on_something(card).ok_or("nothing suits that it could stand on")?);
        }
        let index = self.place(noun, composer)?;
        composer.sketch.carrier(index).map(|_| index).ok_or("it is on the table already")
    }

    /// Goal position of a noun's object; its free room is reserved unless `is_kept_free`.
    fn destination(
        &mut self,
        subject: usize,
        place: &Where,
        is_kept_free: bool,
        composer: &mut Composer<'a>,
    ) -> Made<Place> {
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
                if !is_kept_free {
                    ways.find_map(|way| composer.keep_free(item, way, reference)).ok_or(NO_ROOM)?;
                }
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

    /// Opens the lids and drawers of objects that others are put into, unless the sentence asks for that.
    fn open_hosts(&self, composer: &mut Composer<'a>) -> Made<()> {
        for command in self.sentence.alternatives.iter().flatten() {
            let Command::Put { subject, place } = command else { continue };
            let Some(&host) = place.references.first() else { continue };
            let (card, noun) = (self.cards[host], &self.sentence.nouns[host]);
            let is_inside = support(place, card, self.cards[*subject]) == Some(Relation::In);
            if let Some(index) = self.objects[host].filter(|_| is_inside && card.is_articulated)
                && composer.sketch.states[index].is_none()
            {
                composer.sketch.states[index] = Some(open_state(card, noun.part).ok_or("it does not open")?.to_owned());
            }
        }
        Ok(())
    }

    /// Adds the objects with which a comparison such as `the larger bowl` compares.
    fn add_rivals(&self, composer: &mut Composer<'a>) -> Made<()> {
        for (index, noun) in self.sentence.nouns.iter().enumerate() {
            for _ in 0..noun.rivals {
                let rivals: Vec<&&ObjectCard> =
                    noun.meant.iter().filter(|card| !composer.sketch.contains(card)).collect();
                let rival = rivals.choose(&mut composer.rng).ok_or("there is nothing to compare it with")?;
                match noun.beyond {
                    None => composer.add(rival).ok_or(NO_ROOM)?,
                    Some(relation) => {
                        let object = self.objects[index].ok_or("it is not in the scene")?;
                        composer.add_beside(rival, relation, object).ok_or(NO_ROOM)?
                    }
                };
            }
        }
        Ok(())
    }
}

/// False if the subject of a command cannot be brought to its place; true while one of them is not chosen yet.
fn may_end_there<'a>(command: &Command, card_of: impl Fn(usize) -> Option<&'a ObjectCard>) -> bool {
    let Command::Put { subject, place } = command else { return true };
    let Some(&host) = place.references.first() else { return true };
    let (Some(item), Some(host)) = (card_of(*subject), card_of(host)) else { return true };
    !is_support(place) || support(place, host, item).is_some()
}

/// True if the object can have the part in a command that the noun has.
fn can_have_part(command: &Command, noun: usize, card: &ObjectCard) -> bool {
    match command {
        Command::Put { subject, .. } if *subject == noun => is_movable(card),
        Command::Put { .. } => true,
        Command::Change { object, part, action } => *object != noun || can_change(card, *part, *action),
    }
}
