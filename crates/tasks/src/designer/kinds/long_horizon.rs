//! Tasks of two to four steps, some with alternatives.

use genmanip_core::{ObjectCard, Relation};
use rand::RngExt;

use super::{Draft, draft, mover_for, say_place, toss, wanted_relation};
use crate::designer::composer::{Composer, Place};
use crate::designer::naming::{Namer, Style};
use crate::designer::phrasing::{choose, fill, phrases};
use crate::designer::sketch::Condition;
use crate::designer::things::things;

/// Probability that a sentence begins directly with its first step, without an opening phrase.
const PLAIN_OPENING_PROBABILITY: f64 = 0.6;

/// For tasks of more than two steps: probability that a later step uses the destination of an earlier one, and number
/// of attempts per object.
const SHARED_PLACE_PROBABILITY: f64 = 0.5;
const TRIES: usize = 4;

/// One step: a moved object, its destination and possibly an alternative destination.
struct Step {
    subject: usize,
    place: Place,
    other: Option<Place>,
}

/// Composes a sequence of steps, two objects moved to one place, or a tower of blocks.
pub(super) fn compose(composer: &mut Composer) -> Option<Draft> {
    // Pairs and towers rarely fail, sequences often do and are drawn again. Pairs and towers always have two steps.
    let is_two = composer.settings.steps[0] <= 2;
    match composer.rng.random_range(0..120) {
        _ if !is_two => compose_steps(composer),
        0..9 => compose_pair(composer),
        9 => compose_tower(composer),
        _ => compose_steps(composer),
    }
}

fn compose_steps(composer: &mut Composer) -> Option<Draft> {
    let [fewest, most] = composer.settings.steps;
    let count = [2, 2, 2, 2, 3, 3, 3, 4][composer.rng.random_range(0..8)].clamp(fewest, most.max(fewest));
    let mut items: Vec<(&ObjectCard, Place, Option<Place>)> = Vec::new();
    let mut may_choose = toss(composer, 2.0 * composer.settings.disjunctions);
    for _ in 0..count {
        let relation = wanted_relation(composer, &Relation::ALL)?;
        let item = mover_for(composer, relation, |card| items.iter().all(|(other, ..)| other.uid != card.uid))?;
        let place = match shared_place(composer, &items, item) {
            Some(place) => place,
            None => with_retries(composer, |composer| composer.destination(item, relation, Style::Plain))?,
        };
        composer.balance.add(place.relation);
        let other = match may_choose && count < 4 {
            true => super::another_place(composer, item, place, Style::Plain),
            false => None,
        };
        may_choose = false;
        items.push((item, place, other));
    }
    let mut steps = Vec::new();
    for (item, place, other) in items {
        let subject = with_retries(composer, |composer| composer.add_to_move(item, place, Style::Plain))?;
        steps.push(Step { subject, place, other });
    }
    let objects = composer.object_count();
    composer.fill(objects);

    let mut said = Vec::new();
    for step in &steps {
        let style = match steps.len() {
            // Descriptions by appearance would make sentences of four steps too long.
            4 => Style::Plain,
            _ => [Style::Plain, Style::Plain, Style::Looks][composer.rng.random_range(0..3)],
        };
        let namer = Namer::new(&composer.sketch);
        let named = namer.name(step.subject, style, &mut composer.rng)?;
        let (to, at) = say_place(composer, step.place, Style::Plain)?;
        let (templates, or) = match step.other {
            Some(other) => (&phrases().steps.step_or, say_place(composer, other, Style::Plain)?.1),
            None if steps.len() == 4 && !said.is_empty() => (&phrases().steps.step_without_verb, String::new()),
            None => (&phrases().steps.step, String::new()),
        };
        let template = choose(templates, &mut composer.rng);
        said.push(fill(template, &[("x", &named), ("to", &to), ("at", &at), ("or", &or)]));
    }
    let templates = match said.len() {
        2 => &phrases().steps.two,
        3 => &phrases().steps.three,
        _ => &phrases().steps.four,
    };
    let keys = ["a", "b", "c", "d"];
    let values: Vec<(&str, &str)> = keys.into_iter().zip(said.iter().map(String::as_str)).collect();
    let sentence = fill(choose(templates, &mut composer.rng), &values);
    let sentence = opened(composer, sentence);
    draft(composer, sentence, alternatives(&steps))
}

/// Result of one attempt for tasks of two steps; of several for longer ones, where room on the table is scarce.
fn with_retries<'a, T>(
    composer: &mut Composer<'a>,
    mut attempt: impl FnMut(&mut Composer<'a>) -> Option<T>,
) -> Option<T> {
    let times = if has_many(composer) { TRIES } else { 1 };
    (0..times).find_map(|_| attempt(composer))
}

/// Destination of an earlier step, if it has room for one more object. Without sharing, a task of many steps would need
/// as many destinations.
fn shared_place(
    composer: &mut Composer,
    items: &[(&ObjectCard, Place, Option<Place>)],
    item: &ObjectCard,
) -> Option<Place> {
    if !has_many(composer) || !toss(composer, SHARED_PLACE_PROBABILITY) {
        return None;
    }
    items.iter().map(|(_, place, _)| *place).find(|place| {
        let host = composer.sketch.cards[place.reference];
        let there: Vec<&ObjectCard> =
            items.iter().filter(|(_, other, _)| other.reference == place.reference).map(|(card, ..)| *card).collect();
        place.relation.is_support()
            && things().may_carry(host, item, place.relation)
            && things().has_space_for(host, &there, item)
    })
}

fn has_many(composer: &Composer) -> bool {
    composer.settings.steps[0] > 2
}

/// Sentence with an opening such as `Tidy up:` before it; the first step then starts in lower case.
fn opened(composer: &mut Composer, sentence: String) -> String {
    let opening = choose(&phrases().steps.opening, &mut composer.rng);
    if toss(composer, PLAIN_OPENING_PROBABILITY) {
        return sentence;
    }
    let mut letters = sentence.chars();
    let small: String = letters.next().into_iter().flat_map(char::to_lowercase).chain(letters).collect();
    format!("{opening}{small}")
}

/// All combinations of the steps' alternatives, each as a conjunction over all steps.
fn alternatives(steps: &[Step]) -> Vec<Vec<Condition>> {
    let mut goal = vec![Vec::new()];
    for step in steps {
        let options: Vec<Condition> =
            std::iter::once(step.place).chain(step.other).map(|place| place.of(step.subject)).collect();
        goal = goal
            .into_iter()
            .flat_map(|so_far: Vec<Condition>| {
                options.iter().map(move |option| so_far.iter().cloned().chain([option.clone()]).collect())
            })
            .collect();
    }
    goal
}

/// Composes a task that moves two objects to one place, or to one of two places.
fn compose_pair(composer: &mut Composer) -> Option<Draft> {
    let relation = wanted_relation(composer, &Relation::SUPPORTS)?;
    let first = mover_for(composer, relation, |_| true)?;
    let place = composer.destination(first, relation, Style::Plain)?;
    let host = composer.sketch.cards[place.reference];
    let second = composer.pick(|card| {
        let fits = things().may_carry(host, card, relation) && things().has_space_for(host, &[first], card);
        fits && card.uid != first.uid
    })?;
    composer.balance.add(relation);
    composer.balance.add(relation);
    let other = match composer.rng.random() {
        true => {
            let relation = wanted_relation(composer, &Relation::SUPPORTS)?;
            let fits = |card: &ObjectCard| {
                let room = things().may_carry(card, first, relation) && things().may_carry(card, second, relation);
                room && things().has_space_for(card, &[first], second)
            };
            let host = composer.pick(fits)?;
            let reference = composer.add(host)?;
            composer.sketch.closed.push(reference);
            Some(Place { relation, reference, second: None })
        }
        false => None,
    };
    let subjects = [composer.add(first)?, composer.add(second)?];
    composer.sketch.closed.extend(subjects);
    let objects = composer.object_count();
    composer.fill(objects);

    let namer = Namer::new(&composer.sketch);
    let names = [
        namer.name(subjects[0], Style::Plain, &mut composer.rng)?,
        namer.name(subjects[1], Style::Plain, &mut composer.rng)?,
    ];
    let (to, at) = say_place(composer, place, Style::Plain)?;
    let (templates, or) = match other {
        Some(other) => (&phrases().steps.pair_or, say_place(composer, other, Style::Plain)?.1),
        None => (&phrases().steps.pair, String::new()),
    };
    let template = choose(templates, &mut composer.rng);
    let sentence = fill(template, &[("x", &names[0]), ("z", &names[1]), ("to", &to), ("at", &at), ("or", &or)]);
    let both = |place: Place| subjects.map(|subject| place.of(subject)).to_vec();
    let goal = std::iter::once(place).chain(other).map(both).collect();
    draft(composer, sentence, goal)
}

/// Composes a task that builds a small tower of blocks; the lowest block is not moved.
fn compose_tower(composer: &mut Composer) -> Option<Draft> {
    let is_block = |card: &ObjectCard| things().kind(card).is_some_and(|kind| kind.class == "block");
    let lies_level = |upper: &ObjectCard, lower: &ObjectCard| upper.size_m.x <= lower.size_m.x + 0.001;
    let base = composer.pick(is_block)?;
    let middle = composer.pick(|card| is_block(card) && card.uid != base.uid && lies_level(card, base))?;
    let top = composer
        .pick(|card| is_block(card) && card.uid != base.uid && card.uid != middle.uid && lies_level(card, middle))?;
    composer.theme = &["office and toys", "containers", "tools"];
    let base = composer.add(base)?;
    composer.sketch.closed.push(base);
    let middle = composer.add(middle)?;
    let top = composer.add(top)?;
    composer.sketch.closed.extend([middle, top]);
    composer.balance.add(Relation::On);
    composer.balance.add(Relation::On);
    let objects = composer.object_count();
    composer.fill(objects);

    let namer = Namer::new(&composer.sketch);
    let mut name = |object: usize| namer.name(object, Style::Plain, &mut composer.rng);
    let (x, y, z) = (name(middle)?, name(base)?, name(top)?);
    let sentence = fill(choose(&phrases().steps.tower, &mut composer.rng), &[("x", &x), ("y", &y), ("z", &z)]);
    let on = |subject: usize, reference: usize| Place { relation: Relation::On, reference, second: None }.of(subject);
    draft(composer, sentence, vec![vec![on(middle, base), on(top, middle)]])
}
