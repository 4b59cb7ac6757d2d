//! A need from everyday life, and the one thing on the table that meets it.

use genmanip_core::Relation;
use rand::seq::IndexedRandom;

use super::{Draft, draft, toss, wanted_relation};
use crate::designer::knowledge::needs;
use crate::designer::naming::Style;
use crate::designer::phrasing::{choose, fill, phrases};
use crate::designer::studio::{Place, Studio};
use crate::designer::things::things;

/// Share of things that are only wanted near by.
const AT_HAND: f64 = 0.8;

/// A scene with exactly one thing that meets the need.
pub(super) fn compose(studio: &mut Studio) -> Option<Draft> {
    let need = needs().choose(&mut studio.rng)?;
    let item = studio.pick_mover(|card| need.is_met_by(card))?;
    // People mostly want a thing at hand and do not care on which side.
    let is_near = need.relations.contains(&Relation::Near) && toss(studio, AT_HAND);
    let relation = if is_near { Relation::Near } else { wanted_relation(studio, &need.relations)? };
    let is_place = |category: &String| need.places.contains(category);
    let target = studio.pick(|card| {
        let suits = is_place(&card.category) && !need.is_doubtful(card);
        suits && (!relation.is_support() || things().may_carry(card, item, relation))
    })?;
    let reference = studio.add(target)?;
    if relation.is_support() {
        studio.scene.closed.push(reference);
    } else {
        studio.keep_free(item, relation, reference)?;
    }
    studio.balance.add(relation);
    let place = Place { relation, reference, second: None };
    let subject = studio.add(item)?;
    let count = studio.object_count();
    studio.fill(count);
    let scene = &studio.scene;
    let others = (0..scene.len()).filter(|&object| object != subject);
    if others.into_iter().any(|object| need.is_doubtful(scene.cards[object])) {
        return None;
    }

    let named = choose(&need.item, &mut studio.rng).to_owned();
    let (to, at) = if need.place_words.is_empty() {
        super::say_place(studio, place, Style::Plain)?
    } else {
        let word = choose(&need.place_words, &mut studio.rng);
        let card = studio.scene.cards[reference];
        let to = phrases().direction(relation, card, word, "", &mut studio.rng);
        (to, phrases().place(relation, card, word, "", &mut studio.rng))
    };
    let said = choose(&need.needs, &mut studio.rng);
    let request = fill(choose(&phrases().r#move, &mut studio.rng), &[("x", &named), ("to", &to), ("at", &at)]);
    draft(studio, format!("{said} {request}"), vec![vec![place.of(subject)]])
}
