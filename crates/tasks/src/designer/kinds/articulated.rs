//! Tasks that change the state of an articulated object, possibly together with another goal.

use genmanip_core::{ObjectCard, Relation};
use rand::RngExt;
use rand::seq::IndexedRandom;

use super::{Draft, draft, mover_for, say_place, wanted_relation};
use crate::designer::composer::Composer;
use crate::designer::knowledge::{Handling, handling};
use crate::designer::naming::{Namer, Style};
use crate::designer::phrasing::{capitalised, choose, fill, phrases};
use crate::designer::sketch::Condition;

/// A second goal besides the change of state.
enum Extra {
    Nothing,
    /// A change of state of another object with this handling; `true` if it is an alternative to the first one.
    Other(usize, &'static Handling, bool),
    Move(usize, super::Place),
}

/// Composes a task with one state change, with two of them (both or either), or with a state change and an object to
/// move.
pub(super) fn compose(composer: &mut Composer) -> Option<Draft> {
    let style = *[Style::Plain, Style::Plain, Style::Looks, Style::Place].choose(&mut composer.rng)?;
    let (object, change) = add_changed(composer, style)?;
    let extra = match composer.rng.random_range(0..10) {
        0 | 1 => {
            let (other, change) = add_changed(composer, Style::Plain)?;
            Extra::Other(other, change, composer.rng.random())
        }
        2..5 => {
            let beside = [Relation::Near, Relation::Left, Relation::Right, Relation::Top, Relation::In, Relation::On];
            let relation = wanted_relation(composer, &beside)?;
            let item = mover_for(composer, relation, |_| true)?;
            let place = composer.destination(item, relation, Style::Plain)?;
            composer.balance.add(relation);
            Extra::Move(composer.add_to_move(item, place, Style::Plain)?, place)
        }
        _ => Extra::Nothing,
    };
    let count = composer.object_count().min(7);
    composer.fill(count);

    let said = say_change(composer, object, change, style)?;
    let state = |object: usize, change: &Handling| Condition::State(object, change.to.clone());
    match extra {
        Extra::Nothing => {
            let sentence = with_reason(composer, &said, change);
            draft(composer, sentence, vec![vec![state(object, change)]])
        }
        Extra::Other(other, second, instead) => {
            let also = say_change(composer, other, second, Style::Plain)?;
            let goal = if instead {
                vec![vec![state(object, change)], vec![state(other, second)]]
            } else {
                vec![vec![state(object, change), state(other, second)]]
            };
            let sentence = match instead {
                true => format!("Either {said} or {also}."),
                false => two_steps(composer, &said, &also),
            };
            draft(composer, sentence, goal)
        }
        Extra::Move(subject, place) => {
            let named = Namer::new(&composer.sketch).name(subject, Style::Plain, &mut composer.rng)?;
            let (to, at) = say_place(composer, place, Style::Plain)?;
            let step =
                fill(choose(&phrases().steps.step, &mut composer.rng), &[("x", &named), ("to", &to), ("at", &at)]);
            let sentence = if composer.rng.random() {
                two_steps(composer, &said, &step)
            } else {
                two_steps(composer, &step, &said)
            };
            draft(composer, sentence, vec![vec![state(object, change), place.of(subject)]])
        }
    }
}

/// Adds an articulated object in an initial state from which it can be changed.
fn add_changed(composer: &mut Composer, style: Style) -> Option<(usize, &'static Handling)> {
    let can = |card: &ObjectCard| handling().iter().any(|handling| handling.category == card.category);
    let has_twin = |card: &ObjectCard| card.category.ends_with("cabinet");
    let card = composer.pick(|card| card.is_articulated && can(card) && (style != Style::Place || has_twin(card)))?;
    let changes: Vec<&Handling> = handling().iter().filter(|handling| handling.category == card.category).collect();
    let change = *changes.choose(&mut composer.rng)?;
    let object = composer.add_styled(card, style)?;
    composer.sketch.states[object] = change.from.choose(&mut composer.rng).cloned();
    Some((object, change))
}

fn say_change(composer: &mut Composer, object: usize, change: &Handling, style: Style) -> Option<String> {
    let named = Namer::new(&composer.sketch).name(object, style, &mut composer.rng)?;
    Some(fill(choose(&change.say, &mut composer.rng), &[("y", &named)]))
}

fn with_reason(composer: &mut Composer, said: &str, change: &Handling) -> String {
    let why = choose(&change.why, &mut composer.rng);
    let said_first = capitalised(said);
    match composer.rng.random_range(0..6) {
        0 => format!("{}: {said}.", capitalised(why)),
        1 => format!("{}. Please {said}.", capitalised(why)),
        2 => format!("{said_first}, because {}.", why),
        3 => format!("Could you {said}? {}.", capitalised(why)),
        4 => format!("Please {said}."),
        _ => format!("{said_first}."),
    }
}

fn two_steps(composer: &mut Composer, first: &str, second: &str) -> String {
    let template = choose(&phrases().steps.two, &mut composer.rng);
    fill(template, &[("a", first), ("b", second)])
}
