//! One module per kind of task: which scene it needs and what is said about it.

mod articulated;
mod common_sense;
mod long_horizon;
mod single;

use genmanip_core::{ObjectCard, Relation, TaskKind};

use super::naming::{Namer, Style, chance};
use super::phrasing::{capitalised, phrases};
use super::scene::{Condition, Scene};
use super::studio::{Place, Studio};
use super::things::things;

/// A finished design; its scene is the studio's.
pub(super) struct Draft {
    pub instruction: String,
    pub description: String,
    /// Alternatives of the goal.
    pub goal: Vec<Vec<Condition>>,
}

/// Composes a task in an empty studio; `None` when the draws do not work out.
pub(super) fn compose(kind: TaskKind, studio: &mut Studio) -> Option<Draft> {
    match kind {
        TaskKind::PickAndPlace => single::compose(studio, &[(Style::Plain, Style::Plain)]),
        TaskKind::Spatial => single::compose(
            studio,
            &[(Style::Place, Style::Plain), (Style::Plain, Style::Place), (Style::Place, Style::Place)],
        ),
        TaskKind::Appearance => single::compose(studio, &[(Style::Looks, Style::Looks)]),
        TaskKind::CommonSense => common_sense::compose(studio),
        TaskKind::LongHorizon => long_horizon::compose(studio),
        TaskKind::Articulated => articulated::compose(studio),
    }
}

/// Finishes a design whose scene is complete.
fn draft(studio: &mut Studio, instruction: String, goal: Vec<Vec<Condition>>) -> Option<Draft> {
    if studio.scene.len() < studio.settings.objects[0] {
        return None;
    }
    initial_states(studio);
    let description = describe(&studio.scene);
    Some(Draft { instruction: capitalised(&instruction), description, goal })
}

/// Articulated objects that the task says nothing about are in any of their states.
fn initial_states(studio: &mut Studio) {
    use rand::seq::IndexedRandom;
    for object in 0..studio.scene.len() {
        let card = studio.scene.cards[object];
        if card.is_articulated && studio.scene.states[object].is_none() {
            studio.scene.states[object] = card.states.choose(&mut studio.rng).cloned();
        }
    }
}

/// The scene in words: one short sentence per relation.
fn describe(scene: &Scene) -> String {
    let name = |object: usize| scene.cards[object].name.as_str();
    let sentences: Vec<String> = scene
        .edges
        .iter()
        .map(|link| {
            let reference = name(link.reference);
            let place = match (link.relation, link.second) {
                (Relation::Front, _) => format!("on the far side of the {reference}"),
                (Relation::Back, _) => format!("on the robot's side of the {reference}"),
                (Relation::Left, _) => format!("to the robot's left of the {reference}"),
                (Relation::Right, _) => format!("to the robot's right of the {reference}"),
                (Relation::In, _) => format!("in the {reference}"),
                (Relation::On | Relation::Top, _) => format!("on the {reference}"),
                (Relation::Between, Some(second)) => format!("between the {reference} and the {}", name(second)),
                (Relation::Near | Relation::Between, _) => format!("near the {reference}"),
            };
            format!("The {} is {place}.", name(link.subject))
        })
        .collect();
    sentences.join(" ")
}

/// A relation for a goal: the rarest so far among those that something exists for.
fn wanted_relation(studio: &mut Studio, among: &[Relation]) -> Option<Relation> {
    studio.balance.choose(among, studio.settings, &mut studio.rng)
}

/// Something to carry that the relation is possible for.
fn mover_for<'a>(
    studio: &mut Studio<'a>,
    relation: Relation,
    suits: impl Fn(&ObjectCard) -> bool,
) -> Option<&'a ObjectCard> {
    let cards = studio.cards;
    let has_place =
        |card: &ObjectCard| !relation.is_support() || cards.iter().any(|host| things().may_carry(host, card, relation));
    studio.pick_mover(|card| has_place(card) && suits(card))
}

/// Another place for the same object: the other side of the same reference, or another thing to put it in or on.
fn another_place(studio: &mut Studio, item: &ObjectCard, place: Place, style: Style) -> Option<Place> {
    if place.relation.is_support() {
        let relation = wanted_relation(studio, &[Relation::In, Relation::On, Relation::Top])?;
        return studio.destination(item, relation, style);
    }
    let other = place.relation.inverse().filter(|inverse| *inverse != place.relation)?;
    studio.keep_free(item, other, place.reference)?;
    Some(Place { relation: other, ..place })
}

/// A place in words: as where something goes, and as where it then is.
fn say_place(studio: &mut Studio, place: Place, style: Style) -> Option<(String, String)> {
    let scene = &studio.scene;
    let namer = Namer::new(scene);
    let card = scene.cards[place.reference];
    let first = namer.name(place.reference, style, &mut studio.rng)?;
    let second = match place.second {
        Some(second) => {
            namer.name(second, if style == Style::Looks { style } else { Style::Plain }, &mut studio.rng)?
        }
        None => String::new(),
    };
    // `between X and the Y that is …`: what takes a clause comes last.
    let (first, second) = if style == Style::Place && !second.is_empty() { (second, first) } else { (first, second) };
    let to = phrases().direction(place.relation, card, &first, &second, &mut studio.rng);
    let at = phrases().place(place.relation, card, &first, &second, &mut studio.rng);
    Some((to, at))
}

/// All nine relations.
fn any_relation() -> &'static [Relation] {
    &Relation::ALL
}

fn toss(studio: &mut Studio, share: f64) -> bool {
    chance(share, &mut studio.rng)
}
