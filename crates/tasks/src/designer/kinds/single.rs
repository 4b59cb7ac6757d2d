//! Tasks that move one object to one place, referred to by name, position or appearance.

use genmanip_core::Relation;
use rand::seq::IndexedRandom;

use super::{Draft, another_place, draft, mover_for, say_place, toss, wanted_relation};
use crate::designer::composer::Composer;
use crate::designer::naming::{Namer, Style, has_looks};
use crate::designer::phrasing::{choose, fill, phrases};

/// Composes a task with one of the given pairs of styles: for the moved object and for its destination.
pub(super) fn compose(composer: &mut Composer, styles: &[(Style, Style)]) -> Option<Draft> {
    let &(moved, placed) = styles.choose(&mut composer.rng)?;
    let relation = wanted_relation(composer, &Relation::ALL)?;
    let item = mover_for(composer, relation, |card| moved != Style::Looks || has_looks(card))?;
    let place = composer.destination(item, relation, placed)?;
    composer.balance.add(relation);
    // After a description by position, an alternative place would make the sentence ambiguous.
    let other = match placed != Style::Place && toss(composer, composer.settings.disjunctions) {
        true => another_place(composer, item, place, placed),
        false => None,
    };
    let subject = composer.add_to_move(item, place, moved)?;
    let count = composer.object_count();
    composer.fill(count);
    if moved == Style::Looks && !composer.has_look_alike(subject) {
        return None;
    }

    let named = Namer::new(&composer.sketch).name(subject, moved, &mut composer.rng)?;
    let (to, at) = say_place(composer, place, placed)?;
    let described = moved == Style::Place;
    let (template, or) = match other {
        Some(other) => {
            let options = if described { &phrases().alternatives_described } else { &phrases().alternatives };
            (choose(options, &mut composer.rng), say_place(composer, other, placed)?.1)
        }
        None => {
            let options = if described { &phrases().move_described } else { &phrases().r#move };
            (choose(options, &mut composer.rng), String::new())
        }
    };
    let instruction = fill(template, &[("x", &named), ("to", &to), ("at", &at), ("or", &or)]);
    let goal = std::iter::once(place).chain(other).map(|place| vec![place.of(subject)]).collect();
    draft(composer, instruction, goal)
}
