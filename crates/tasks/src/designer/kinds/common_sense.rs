//! Tasks in which an everyday need decides which object is moved or where it goes; without the need, the request is
//! ambiguous.
//!
//! The table also holds an object for a different need, so that the same request after that need has a different goal.

use genmanip_core::{ObjectCard, Relation};
use rand::seq::IndexedRandom;

use super::{Draft, draft, say_place, toss, wanted_relation};
use crate::designer::composer::{Composer, Place};
use crate::designer::knowledge::{Decides, Need, needs};
use crate::designer::naming::{Namer, Style};
use crate::designer::phrasing::{choose, fill, phrases};
use crate::designer::things::{is_movable, things};

/// Probability that the goal relation is `near`: in everyday requests the side rarely matters.
const NEAR_PROBABILITY: f64 = 0.8;

/// Maximum number of other needs tried before the design is rejected.
const OTHER_NEEDS: usize = 60;

/// Composes a task in whose scene exactly one object meets the need and exactly one meets another need.
pub(super) fn compose(composer: &mut Composer) -> Option<Draft> {
    let need = needs().choose(&mut composer.rng)?;
    let is_near = need.relations.contains(&Relation::Near) && toss(composer, NEAR_PROBABILITY);
    let relation = if is_near { Relation::Near } else { wanted_relation(composer, &need.relations)? };
    let (subject, place, meets, other) = match need.decides {
        Decides::Object => what(composer, need, relation)?,
        Decides::Place => whereto(composer, need, relation)?,
    };
    composer.balance.add(relation);
    let count = composer.object_count();
    composer.fill(count);
    let cards = &composer.sketch.cards;
    let doubtful =
        |need: &Need, met: usize| (0..cards.len()).any(|object| object != met && need.is_doubtful(cards[object]));
    if doubtful(need, meets[0]) || doubtful(other, meets[1]) {
        return None;
    }

    let (named, to, at) = match need.decides {
        Decides::Object => {
            let (to, at) = say_place(composer, place, Style::Plain)?;
            (choose(&phrases().needed, &mut composer.rng).to_owned(), to, at)
        }
        Decides::Place => {
            let named = Namer::new(&composer.sketch).name(subject, Style::Plain, &mut composer.rng)?;
            let words = if relation.is_inside() { &phrases().needed_hollow } else { &phrases().needed_place };
            let word = choose(words, &mut composer.rng);
            let card = composer.sketch.cards[place.reference];
            let to = phrases().direction(relation, card, word, "", &mut composer.rng);
            (named, to, phrases().place(relation, card, word, "", &mut composer.rng))
        }
    };
    let request = fill(choose(&phrases().r#move, &mut composer.rng), &[("x", &named), ("to", &to), ("at", &at)]);
    let said = choose(&need.says, &mut composer.rng);
    let instead = format!("{} {request}", choose(&other.says, &mut composer.rng));
    let draft = draft(composer, format!("{said} {request}"), vec![vec![place.of(subject)]])?;
    Some(Draft { without_need: Some([request, instead]), ..draft })
}

/// The moved object, its goal position, the objects that meet the two needs, and the other need.
type Scene = (usize, Place, [usize; 2], &'static Need);

/// Scene for a need that decides the moved object; the destination is any other object on the table.
fn what(composer: &mut Composer, need: &'static Need, relation: Relation) -> Option<Scene> {
    let item = composer.pick_mover(|card| need.is_met_by(card))?;
    let (other, instead) = other_need(composer, need, |composer, other| {
        let suits = |card: &ObjectCard| is_movable(card) && other.is_met_by(card) && !need.is_doubtful(card);
        if other.is_doubtful(item) { None } else { composer.pick(suits) }
    })?;
    let anchor = composer.pick_filler().filter(|card| !need.is_doubtful(card) && !other.is_doubtful(card))?;
    let reference = composer.add(anchor)?;
    composer.keep_free(item, relation, reference)?;
    let place = Place { relation, reference, second: None };
    let subject = composer.add_to_move(item, place, Style::Plain)?;
    let instead = composer.add(instead)?;
    Some((subject, place, [subject, instead], other))
}

/// Scene for a need that decides the destination.
fn whereto(composer: &mut Composer, need: &'static Need, relation: Relation) -> Option<Scene> {
    let item = composer.pick_mover(|card| need.may_move(card) && !need.is_doubtful(card))?;
    let fits = |need: &Need, card: &ObjectCard| {
        need.is_met_by(card) && (!relation.is_support() || things().may_carry(card, item, relation))
    };
    let target = composer.pick(|card| fits(need, card))?;
    let (other, instead) = other_need(composer, need, |composer, other| {
        let suits = |card: &ObjectCard| fits(other, card) && !need.is_doubtful(card);
        let asks = other.relations.contains(&relation) && other.may_move(item) && !other.is_doubtful(item);
        if asks && !other.is_doubtful(target) { composer.pick(suits) } else { None }
    })?;
    let reference = composer.add(target)?;
    if relation.is_support() {
        composer.sketch.closed.push(reference);
    } else {
        composer.keep_free(item, relation, reference)?;
    }
    let place = Place { relation, reference, second: None };
    let subject = composer.add_to_move(item, place, Style::Plain)?;
    let instead = composer.add(instead)?;
    composer.sketch.closed.push(instead);
    Some((subject, place, [reference, instead], other))
}

/// Another need that decides the same part of the request, and a card that meets it; `None` if none was found.
fn other_need<'a>(
    composer: &mut Composer<'a>,
    need: &'static Need,
    mut find: impl FnMut(&mut Composer<'a>, &'static Need) -> Option<&'a ObjectCard>,
) -> Option<(&'static Need, &'a ObjectCard)> {
    for _ in 0..OTHER_NEEDS {
        let other = needs().choose(&mut composer.rng)?;
        if std::ptr::eq(other, need) || other.decides != need.decides {
            continue;
        }
        if let Some(card) = find(composer, other) {
            return Some((other, card));
        }
    }
    None
}
