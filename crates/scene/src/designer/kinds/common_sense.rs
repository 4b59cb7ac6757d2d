//! A need from everyday life, and the one thing on the table that meets it.

use genmanip_core::Relation;
use rand::seq::IndexedRandom;

use super::{Draft, draft, toss, wanted_relation};
use crate::designer::composer::{Composer, Place};
use crate::designer::knowledge::needs;
use crate::designer::naming::Style;
use crate::designer::phrasing::{choose, fill, phrases};
use crate::designer::things::things;

/// Share of things that are only wanted near by.
const AT_HAND: f64 = 0.8;

/// A scene with exactly one thing that meets the need.
pub(super) fn compose(composer: &mut Composer) -> Option<Draft> {
    let need = needs().choose(&mut composer.rng)?;
    let item = composer.pick_mover(|card| need.is_met_by(card))?;
    // People mostly want a thing at hand and do not care on which side.
    let is_near = need.relations.contains(&Relation::Near) && toss(composer, AT_HAND);
    let relation = if is_near { Relation::Near } else { wanted_relation(composer, &need.relations)? };
    let is_place = |category: &String| need.places.contains(category);
    let target = composer.pick(|card| {
        let suits = is_place(&card.category) && !need.is_doubtful(card);
        suits && (!relation.is_support() || things().may_carry(card, item, relation))
    })?;
    let reference = composer.add(target)?;
    if relation.is_support() {
        composer.sketch.closed.push(reference);
    } else {
        composer.keep_free(item, relation, reference)?;
    }
    composer.balance.add(relation);
    let place = Place { relation, reference, second: None };
    let subject = composer.add_to_move(item, place, Style::Plain)?;
    let count = composer.object_count();
    composer.fill(count);
    let scene = &composer.sketch;
    let others = (0..scene.len()).filter(|&object| object != subject);
    if others.into_iter().any(|object| need.is_doubtful(scene.cards[object])) {
        return None;
    }

    let named = choose(&need.item, &mut composer.rng).to_owned();
    let (to, at) = if need.place_words.is_empty() {
        super::say_place(composer, place, Style::Plain)?
    } else {
        let word = choose(&need.place_words, &mut composer.rng);
        let card = composer.sketch.cards[reference];
        let to = phrases().direction(relation, card, word, "", &mut composer.rng);
        (to, phrases().place(relation, card, word, "", &mut composer.rng))
    };
    let said = choose(&need.needs, &mut composer.rng);
    let request = fill(choose(&phrases().r#move, &mut composer.rng), &[("x", &named), ("to", &to), ("at", &at)]);
    draft(composer, format!("{said} {request}"), vec![vec![place.of(subject)]])
}
