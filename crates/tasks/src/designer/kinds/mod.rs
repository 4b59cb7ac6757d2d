//! One module per kind of task: the scene that it needs and its sentence.

mod articulated;
mod common_sense;
mod long_horizon;
mod single;

use genmanip_core::{ObjectCard, Relation, TaskKind};

use super::composer::{Composer, Place};
use super::naming::{Namer, Style, chance};
use super::phrasing::{capitalised, phrases};
use super::sketch::{Condition, Sketch};

/// A complete design except for its scene, which is the composer's sketch.
pub(super) struct Draft {
    pub instruction: String,
    pub description: String,
    /// Alternatives of the goal, each a conjunction.
    pub goal: Vec<Vec<Condition>>,
    /// The request without its stated need ("I am thirsty"), and with another need: neither may be understood as this
    /// goal. `None` for tasks without a need.
    pub without_need: Option<[String; 2]>,
}

/// Composes a task, starting from an empty scene; `None` if this attempt fails.
pub(super) fn compose(kind: TaskKind, composer: &mut Composer) -> Option<Draft> {
    match kind {
        TaskKind::PickAndPlace => single::compose(composer, &[(Style::Plain, Style::Plain)]),
        TaskKind::Spatial => single::compose(
            composer,
            &[(Style::Place, Style::Plain), (Style::Plain, Style::Place), (Style::Place, Style::Place)],
        ),
        TaskKind::Appearance => single::compose(composer, &[(Style::Looks, Style::Looks)]),
        TaskKind::CommonSense => common_sense::compose(composer),
        TaskKind::LongHorizon => long_horizon::compose(composer),
        TaskKind::Articulated => articulated::compose(composer),
    }
}

/// Completes a design whose scene is finished; `None` if the scene has too few objects.
pub(super) fn draft(composer: &mut Composer, instruction: String, goal: Vec<Vec<Condition>>) -> Option<Draft> {
    if composer.sketch.len() < composer.settings.objects[0] {
        return None;
    }
    initial_states(composer);
    let description = describe(&composer.sketch);
    Some(Draft { instruction: capitalised(&instruction), description, goal, without_need: None })
}

/// Gives every articulated object that the task does not mention a random initial state.
fn initial_states(composer: &mut Composer) {
    use rand::seq::IndexedRandom;
    for object in 0..composer.sketch.len() {
        let card = composer.sketch.cards[object];
        if card.is_articulated && composer.sketch.states[object].is_none() {
            composer.sketch.states[object] = card.states.choose(&mut composer.rng).cloned();
        }
    }
}

/// Description of the scene: one short sentence per relation.
fn describe(scene: &Sketch) -> String {
    let name = |object: usize| scene.cards[object].name.as_str();
    let sentences: Vec<String> = scene
        .edges
        .iter()
        .map(|link| {
            let place = link.relation.describe(name(link.reference), link.second.map(name));
            format!("The {} is {place}.", name(link.subject))
        })
        .collect();
    sentences.join(" ")
}

/// The relation of a goal: the one in the settings if it is in `among`, otherwise the one of `among` with the most
/// missing occurrences.
fn wanted_relation(composer: &mut Composer, among: &[Relation]) -> Option<Relation> {
    if let Some(asked) = composer.settings.goal_relation.filter(|asked| among.contains(asked)) {
        return Some(asked);
    }
    composer.balance.choose(among, composer.settings, &mut composer.rng)
}

/// An object to move for which this relation is possible; `None` if there is none.
fn mover_for<'a>(
    composer: &mut Composer<'a>,
    relation: Relation,
    suits: impl Fn(&ObjectCard) -> bool,
) -> Option<&'a ObjectCard> {
    composer.pick_mover_for(relation.is_support().then_some(relation), suits)
}

/// An alternative place for the same object: the opposite side of the same reference, or another object to put it in or
/// on.
fn another_place(composer: &mut Composer, item: &ObjectCard, place: Place, style: Style) -> Option<Place> {
    if place.relation.is_support() {
        let supports: Vec<Relation> = Relation::SUPPORTS.into_iter().rev().collect();
        let relation = wanted_relation(composer, &supports)?;
        return composer.destination(item, relation, style);
    }
    let other = place.relation.inverse().filter(|inverse| *inverse != place.relation)?;
    composer.keep_free(item, other, place.reference)?;
    Some(Place { relation: other, ..place })
}

/// Text of a place, as a direction (`into the bowl`) and as a location (`in the bowl`); `None` if a reference cannot be
/// named uniquely.
fn say_place(composer: &mut Composer, place: Place, style: Style) -> Option<(String, String)> {
    let scene = &composer.sketch;
    let namer = Namer::new(scene);
    let card = scene.cards[place.reference];
    let first = namer.name(place.reference, style, &mut composer.rng)?;
    let second = match place.second {
        Some(second) => {
            namer.name(second, if style == Style::Looks { style } else { Style::Plain }, &mut composer.rng)?
        }
        None => String::new(),
    };
    // The reference with a relative clause comes last: `between X and the Y that is …`.
    let (first, second) = if style == Style::Place && !second.is_empty() { (second, first) } else { (first, second) };
    let to = phrases().direction(place.relation, card, &first, &second, &mut composer.rng);
    let at = phrases().place(place.relation, card, &first, &second, &mut composer.rng);
    Some((to, at))
}

fn toss(composer: &mut Composer, share: f64) -> bool {
    chance(share, &mut composer.rng)
}
