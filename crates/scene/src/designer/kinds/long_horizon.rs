//! Two to four steps, some with a choice.

use genmanip_core::{ObjectCard, Relation};
use rand::RngExt;

use super::{Draft, any_relation, draft, mover_for, say_place, toss, wanted_relation};
use crate::designer::naming::{Namer, Style};
use crate::designer::phrasing::{choose, fill, phrases};
use crate::designer::scene::Condition;
use crate::designer::studio::{Place, Studio};
use crate::designer::things::things;

/// Supports only; what several things share.
const SUPPORTS: [Relation; 3] = [Relation::Top, Relation::On, Relation::In];

/// Share of sentences that begin with the first step.
const PLAIN_OPENINGS: f64 = 0.6;

/// One step: what goes where, or where else.
struct Step {
    subject: usize,
    place: Place,
    other: Option<Place>,
}

/// Steps in a row, two things to one place, or a tower.
pub(super) fn compose(studio: &mut Studio) -> Option<Draft> {
    // Pairs and towers nearly always work out, steps often do not and are drawn again.
    match studio.rng.random_range(0..120) {
        0..9 => compose_pair(studio),
        9 => compose_tower(studio),
        _ => compose_steps(studio),
    }
}

fn compose_steps(studio: &mut Studio) -> Option<Draft> {
    let count = [2, 2, 2, 2, 3, 3, 3, 4][studio.rng.random_range(0..8)];
    let mut items: Vec<(&ObjectCard, Place, Option<Place>)> = Vec::new();
    let mut may_choose = toss(studio, 2.0 * studio.settings.disjunctions);
    for _ in 0..count {
        let relation = wanted_relation(studio, any_relation())?;
        let item = mover_for(studio, relation, |card| items.iter().all(|(other, ..)| other.uid != card.uid))?;
        let place = studio.destination(item, relation, Style::Plain)?;
        studio.balance.add(relation);
        let other = match may_choose && count < 4 {
            true => super::another_place(studio, item, place, Style::Plain),
            false => None,
        };
        may_choose = false;
        items.push((item, place, other));
    }
    let mut steps = Vec::new();
    for (item, place, other) in items {
        steps.push(Step { subject: studio.add_to_move(item, place, Style::Plain)?, place, other });
    }
    let objects = studio.object_count();
    studio.fill(objects);

    let mut said = Vec::new();
    for step in &steps {
        let style = [Style::Plain, Style::Plain, Style::Looks][studio.rng.random_range(0..3)];
        let namer = Namer::new(&studio.scene);
        let named = namer.name(step.subject, style, &mut studio.rng)?;
        let (to, at) = say_place(studio, step.place, Style::Plain)?;
        let (templates, or) = match step.other {
            Some(other) => (&phrases().steps.step_or, say_place(studio, other, Style::Plain)?.1),
            None => (&phrases().steps.step, String::new()),
        };
        let template = choose(templates, &mut studio.rng);
        said.push(fill(template, &[("x", &named), ("to", &to), ("at", &at), ("or", &or)]));
    }
    let templates = match said.len() {
        2 => &phrases().steps.two,
        3 => &phrases().steps.three,
        _ => &phrases().steps.four,
    };
    let keys = ["a", "b", "c", "d"];
    let values: Vec<(&str, &str)> = keys.into_iter().zip(said.iter().map(String::as_str)).collect();
    let sentence = fill(choose(templates, &mut studio.rng), &values);
    let sentence = opened(studio, sentence);
    draft(studio, sentence, alternatives(&steps))
}

/// `Tidy up: put …`; what follows a colon begins small.
fn opened(studio: &mut Studio, sentence: String) -> String {
    let opening = choose(&phrases().steps.opening, &mut studio.rng);
    if toss(studio, PLAIN_OPENINGS) {
        return sentence;
    }
    let mut letters = sentence.chars();
    let small: String = letters.next().into_iter().flat_map(char::to_lowercase).chain(letters).collect();
    format!("{opening}{small}")
}

/// Every way to choose, each a conjunction of all steps.
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

/// Two things to one place, or to one of two places.
fn compose_pair(studio: &mut Studio) -> Option<Draft> {
    let relation = wanted_relation(studio, &SUPPORTS)?;
    let first = mover_for(studio, relation, |_| true)?;
    let place = studio.destination(first, relation, Style::Plain)?;
    let host = studio.scene.cards[place.reference];
    let second = studio.pick(|card| {
        let fits = things().may_carry(host, card, relation) && things().has_space_for(host, &[first], card);
        fits && card.uid != first.uid
    })?;
    studio.balance.add(relation);
    studio.balance.add(relation);
    let other = match studio.rng.random() {
        true => {
            let relation = wanted_relation(studio, &SUPPORTS)?;
            let fits = |card: &ObjectCard| {
                let room = things().may_carry(card, first, relation) && things().may_carry(card, second, relation);
                room && things().has_space_for(card, &[first], second)
            };
            let host = studio.pick(fits)?;
            let reference = studio.add(host)?;
            studio.scene.closed.push(reference);
            Some(Place { relation, reference, second: None })
        }
        false => None,
    };
    let subjects = [studio.add(first)?, studio.add(second)?];
    studio.scene.closed.extend(subjects);
    let objects = studio.object_count();
    studio.fill(objects);

    let namer = Namer::new(&studio.scene);
    let names = [
        namer.name(subjects[0], Style::Plain, &mut studio.rng)?,
        namer.name(subjects[1], Style::Plain, &mut studio.rng)?,
    ];
    let (to, at) = say_place(studio, place, Style::Plain)?;
    let (templates, or) = match other {
        Some(other) => (&phrases().steps.pair_or, say_place(studio, other, Style::Plain)?.1),
        None => (&phrases().steps.pair, String::new()),
    };
    let template = choose(templates, &mut studio.rng);
    let sentence = fill(template, &[("x", &names[0]), ("z", &names[1]), ("to", &to), ("at", &at), ("or", &or)]);
    let both = |place: Place| subjects.map(|subject| place.of(subject)).to_vec();
    let goal = std::iter::once(place).chain(other).map(both).collect();
    draft(studio, sentence, goal)
}

/// A small tower of blocks; the lowest is not moved.
fn compose_tower(studio: &mut Studio) -> Option<Draft> {
    let is_block = |card: &ObjectCard| things().kind(card).is_some_and(|kind| kind.class == "block");
    let lies_level = |upper: &ObjectCard, lower: &ObjectCard| upper.size_m.x <= lower.size_m.x + 0.001;
    let base = studio.pick(is_block)?;
    let middle = studio.pick(|card| is_block(card) && card.uid != base.uid && lies_level(card, base))?;
    let top = studio
        .pick(|card| is_block(card) && card.uid != base.uid && card.uid != middle.uid && lies_level(card, middle))?;
    studio.theme = &["office and toys", "containers", "tools"];
    let base = studio.add(base)?;
    studio.scene.closed.push(base);
    let middle = studio.add(middle)?;
    let top = studio.add(top)?;
    studio.scene.closed.extend([middle, top]);
    studio.balance.add(Relation::On);
    studio.balance.add(Relation::On);
    let objects = studio.object_count();
    studio.fill(objects);

    let namer = Namer::new(&studio.scene);
    let mut name = |object: usize| namer.name(object, Style::Plain, &mut studio.rng);
    let (x, y, z) = (name(middle)?, name(base)?, name(top)?);
    let sentence = fill(choose(&phrases().steps.tower, &mut studio.rng), &[("x", &x), ("y", &y), ("z", &z)]);
    let on = |subject: usize, reference: usize| Place { relation: Relation::On, reference, second: None }.of(subject);
    draft(studio, sentence, vec![vec![on(middle, base), on(top, middle)]])
}
