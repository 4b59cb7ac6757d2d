//! The state of something with joints is changed, sometimes together with something else.

use genmanip_core::{ObjectCard, Relation};
use rand::RngExt;
use rand::seq::IndexedRandom;

use super::{Draft, draft, mover_for, say_place, wanted_relation};
use crate::designer::knowledge::{Handling, handling};
use crate::designer::naming::{Namer, Style};
use crate::designer::phrasing::{capitalised, choose, fill, phrases};
use crate::designer::scene::Condition;
use crate::designer::studio::Studio;

/// What is asked for beside the state.
enum Extra {
    Nothing,
    /// Another state, of another object, in its place or in addition.
    Other(usize, &'static Handling, bool),
    Move(usize, super::Place),
}

/// One, two or either of two states; or a state and something to move.
pub(super) fn compose(studio: &mut Studio) -> Option<Draft> {
    let style = *[Style::Plain, Style::Plain, Style::Looks, Style::Place].choose(&mut studio.rng)?;
    let (object, change) = add_changed(studio, style)?;
    let extra = match studio.rng.random_range(0..10) {
        0 | 1 => {
            let (other, change) = add_changed(studio, Style::Plain)?;
            Extra::Other(other, change, studio.rng.random())
        }
        2..5 => {
            let beside = [Relation::Near, Relation::Left, Relation::Right, Relation::Top, Relation::In, Relation::On];
            let relation = wanted_relation(studio, &beside)?;
            let item = mover_for(studio, relation, |_| true)?;
            let place = studio.destination(item, relation, Style::Plain)?;
            studio.balance.add(relation);
            Extra::Move(studio.add_to_move(item, place, Style::Plain)?, place)
        }
        _ => Extra::Nothing,
    };
    let count = studio.object_count().min(7);
    studio.fill(count);

    let said = say_change(studio, object, change, style)?;
    let state = |object: usize, change: &Handling| Condition::State(object, change.to.clone());
    match extra {
        Extra::Nothing => {
            let sentence = with_reason(studio, &said, change);
            draft(studio, sentence, vec![vec![state(object, change)]])
        }
        Extra::Other(other, second, instead) => {
            let also = say_change(studio, other, second, Style::Plain)?;
            let goal = if instead {
                vec![vec![state(object, change)], vec![state(other, second)]]
            } else {
                vec![vec![state(object, change), state(other, second)]]
            };
            let sentence = match instead {
                true => format!("Either {said} or {also}."),
                false => two_steps(studio, &said, &also),
            };
            draft(studio, sentence, goal)
        }
        Extra::Move(subject, place) => {
            let named = Namer::new(&studio.scene).name(subject, Style::Plain, &mut studio.rng)?;
            let (to, at) = say_place(studio, place, Style::Plain)?;
            let step = fill(choose(&phrases().steps.step, &mut studio.rng), &[("x", &named), ("to", &to), ("at", &at)]);
            let sentence =
                if studio.rng.random() { two_steps(studio, &said, &step) } else { two_steps(studio, &step, &said) };
            draft(studio, sentence, vec![vec![state(object, change), place.of(subject)]])
        }
    }
}

/// Adds something with joints in a state from which it can be changed.
fn add_changed(studio: &mut Studio, style: Style) -> Option<(usize, &'static Handling)> {
    let can = |card: &ObjectCard| handling().iter().any(|handling| handling.category == card.category);
    let has_twin = |card: &ObjectCard| card.category.ends_with("cabinet");
    let card = studio.pick(|card| card.is_articulated && can(card) && (style != Style::Place || has_twin(card)))?;
    let changes: Vec<&Handling> = handling().iter().filter(|handling| handling.category == card.category).collect();
    let change = *changes.choose(&mut studio.rng)?;
    let object = studio.add_styled(card, style)?;
    studio.scene.states[object] = change.from.choose(&mut studio.rng).cloned();
    Some((object, change))
}

fn say_change(studio: &mut Studio, object: usize, change: &Handling, style: Style) -> Option<String> {
    let named = Namer::new(&studio.scene).name(object, style, &mut studio.rng)?;
    Some(fill(choose(&change.say, &mut studio.rng), &[("y", &named)]))
}

fn with_reason(studio: &mut Studio, said: &str, change: &Handling) -> String {
    let why = choose(&change.why, &mut studio.rng);
    let said_first = capitalised(said);
    match studio.rng.random_range(0..6) {
        0 => format!("{}: {said}.", capitalised(why)),
        1 => format!("{}. Please {said}.", capitalised(why)),
        2 => format!("{said_first}, because {}.", why),
        3 => format!("Could you {said}? {}.", capitalised(why)),
        4 => format!("Please {said}."),
        _ => format!("{said_first}."),
    }
}

fn two_steps(studio: &mut Studio, first: &str, second: &str) -> String {
    let template = choose(&phrases().steps.two, &mut studio.rng);
    fill(template, &[("a", first), ("b", second)])
}
