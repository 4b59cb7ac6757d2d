//! One object to one place: by name, by place or by looks.

use rand::seq::IndexedRandom;

use super::{Draft, another_place, any_relation, draft, mover_for, say_place, toss, wanted_relation};
use crate::designer::naming::{Namer, Style, has_looks};
use crate::designer::phrasing::{choose, fill, phrases};
use crate::designer::studio::Studio;

/// One of these styles for what is moved and for where it goes.
pub(super) fn compose(studio: &mut Studio, styles: &[(Style, Style)]) -> Option<Draft> {
    let &(moved, placed) = styles.choose(&mut studio.rng)?;
    let relation = wanted_relation(studio, any_relation())?;
    let item = mover_for(studio, relation, |card| moved != Style::Looks || has_looks(card))?;
    let place = studio.destination(item, relation, placed)?;
    studio.balance.add(relation);
    // A place in so many words and another one after it would read two ways.
    let other = match placed != Style::Place && toss(studio, studio.settings.disjunctions) {
        true => another_place(studio, item, place, placed),
        false => None,
    };
    let subject = studio.add_styled(item, moved)?;
    let count = studio.object_count();
    studio.fill(count);
    if moved == Style::Looks && !studio.has_look_alike(subject) {
        return None;
    }

    let named = Namer::new(&studio.scene).name(subject, moved, &mut studio.rng)?;
    let (to, at) = say_place(studio, place, placed)?;
    let described = moved == Style::Place;
    let (template, or) = match other {
        Some(other) => {
            let options = if described { &phrases().alternatives_described } else { &phrases().alternatives };
            (choose(options, &mut studio.rng), say_place(studio, other, placed)?.1)
        }
        None => {
            let options = if described { &phrases().move_described } else { &phrases().r#move };
            (choose(options, &mut studio.rng), String::new())
        }
    };
    let instruction = fill(template, &[("x", &named), ("to", &to), ("at", &at), ("or", &or)]);
    let goal = std::iter::once(place).chain(other).map(|place| vec![place.of(subject)]).collect();
    draft(studio, instruction, goal)
}
