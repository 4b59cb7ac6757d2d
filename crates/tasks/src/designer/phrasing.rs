//! Sentence templates from `data/designer/phrases.json`.

use std::sync::LazyLock;

use genmanip_core::{ObjectCard, Relation, RelationKind, Support};
use rand::Rng;
use rand::seq::IndexedRandom;
use serde::Deserialize;

use super::things::things;

static PHRASES: LazyLock<Phrases> = LazyLock::new(|| super::data(include_str!("../../data/designer/phrases.json")));

/// Prepositions for a location on or in a hollow reference.
const HOLLOW_LOCATED: [&str; 1] = ["in"];
/// Prepositions for a direction onto or into a hollow reference.
const HOLLOW_DIRECTED: [&str; 2] = ["into", "in"];

/// All templates. `{x}` is the moved object, `{to}` a place as a direction (`into the bowl`), `{at}` as a location (`in
/// the bowl`).
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Phrases {
    /// Requests to bring one object to one place.
    pub r#move: Vec<String>,
    /// Requests to bring one object, described by a whole clause, to one place.
    pub move_described: Vec<String>,
    /// Requests to bring one object to one of two places.
    pub alternatives: Vec<String>,
    /// Requests to bring one object, described by a whole clause, to one of two places.
    pub alternatives_described: Vec<String>,
    /// Noun phrases for a moved object that a common-sense need decides: `what I need`.
    pub needed: Vec<String>,
    /// Noun phrases for a destination that a need decides, if the object goes into it: `the right place`.
    pub needed_hollow: Vec<String>,
    /// Noun phrases for a destination that a need decides, in all other relations.
    pub needed_place: Vec<String>,
    /// Templates of tasks with several steps.
    pub steps: Steps,
    which: Which,
}

/// Beginnings of relative clauses: for flat objects, which lie, and for upright ones, which stand.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Which {
    flat: Vec<String>,
    tall: Vec<String>,
}

/// Templates of tasks with several steps.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Steps {
    pub two: Vec<String>,
    pub three: Vec<String>,
    pub four: Vec<String>,
    pub opening: Vec<String>,
    pub step: Vec<String>,
    /// Later steps of tasks with four steps, without a verb of their own.
    pub step_without_verb: Vec<String>,
    pub step_or: Vec<String>,
    pub pair: Vec<String>,
    pub pair_or: Vec<String>,
    pub tower: Vec<String>,
}

pub(super) fn phrases() -> &'static Phrases {
    &PHRASES
}

impl Phrases {
    /// A place as a location: `in the bowl`.
    pub fn place(
        &self,
        relation: Relation,
        reference: &ObjectCard,
        first: &str,
        second: &str,
        rng: &mut impl Rng,
    ) -> String {
        let prepositions = if is_said_in(relation, reference) { &HOLLOW_LOCATED } else { relation.facts().located };
        place(prepositions, first, second, rng)
    }

    /// A place as a direction: `into the bowl`.
    pub fn direction(
        &self,
        relation: Relation,
        reference: &ObjectCard,
        first: &str,
        second: &str,
        rng: &mut impl Rng,
    ) -> String {
        let prepositions = if is_said_in(relation, reference) { &HOLLOW_DIRECTED } else { relation.facts().directed };
        place(prepositions, first, second, rng)
    }

    /// `that stands` for objects taller than three quarters of their longer horizontal side, `that lies` for others.
    pub fn which(&self, card: &ObjectCard, rng: &mut impl Rng) -> &str {
        let is_tall = card.size_m.z > 0.75 * card.size_m.x.max(card.size_m.y);
        choose(if is_tall { &self.which.tall } else { &self.which.flat }, rng)
    }
}

/// True if a subject that may be on or in the reference is described as in it.
fn is_said_in(relation: Relation, reference: &ObjectCard) -> bool {
    let is_hollow = things().host(reference).is_some_and(|host| host.relations.contains(&Relation::In));
    relation.kind() == RelationKind::Support(Support::OnOrIn) && is_hollow
}

/// A place with a random one of the prepositions.
fn place(prepositions: &[&str], first: &str, second: &str, rng: &mut impl Rng) -> String {
    let preposition = prepositions.choose(rng).copied().unwrap_or_default();
    let second = if second.is_empty() { String::new() } else { format!(" and {second}") };
    format!("{preposition} {first}{second}")
}

/// A random template; empty if there is none.
pub(super) fn choose<'t>(templates: &'t [String], rng: &mut impl Rng) -> &'t str {
    templates.choose(rng).map_or("", String::as_str)
}

/// Replaces `{key}` by its value and `{Key}` by the capitalised value.
pub(super) fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut text = template.to_owned();
    for (key, value) in values {
        text = text.replace(&format!("{{{key}}}"), value);
        text = text.replace(&format!("{{{}}}", capitalised(key)), &capitalised(value));
    }
    text
}

/// The text with its first letter in upper case.
pub(super) fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
