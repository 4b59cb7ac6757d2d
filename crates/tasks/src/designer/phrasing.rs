//! Sentence templates from `data/designer/phrases.json`.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use genmanip_core::{ObjectCard, Relation};
use rand::Rng;
use rand::seq::IndexedRandom;
use serde::Deserialize;

use super::things::things;

static PHRASES: LazyLock<Phrases> = LazyLock::new(|| super::data(include_str!("../../data/designer/phrases.json")));

/// All templates. `{x}` is the moved object, `{to}` a place as a direction (`into the bowl`), `{at}` as a location (`in
/// the bowl`).
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Phrases {
    /// One object to one place.
    pub r#move: Vec<String>,
    /// Same, for an object that is described by a whole clause.
    pub move_described: Vec<String>,
    /// One object to one of two places.
    pub alternatives: Vec<String>,
    /// Same, for an object that is described by a whole clause.
    pub alternatives_described: Vec<String>,
    /// For needs that decide the moved object.
    pub needed: Vec<String>,
    /// For needs that decide the destination, if the object goes into it.
    pub needed_hollow: Vec<String>,
    /// For needs that decide the destination, in all other relations.
    pub needed_place: Vec<String>,
    /// Several steps.
    pub steps: Steps,
    to: BTreeMap<String, Vec<String>>,
    at: BTreeMap<String, Vec<String>>,
    which: Which,
    hollow_top: BTreeMap<String, Vec<String>>,
}

/// Beginnings of relative clauses: for flat objects that lie and for upright ones that stand.
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
        self.fill_place(&self.at, "at", relation, reference, first, second, rng)
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
        self.fill_place(&self.to, "to", relation, reference, first, second, rng)
    }

    /// `that stands` for objects at least as tall as wide, `that lies` for others.
    pub fn which(&self, card: &ObjectCard, rng: &mut impl Rng) -> &str {
        let is_tall = card.size_m.z > 0.75 * card.size_m.x.max(card.size_m.y);
        choose(if is_tall { &self.which.tall } else { &self.which.flat }, rng)
    }

    #[allow(clippy::too_many_arguments)] // one call site per direction of speech
    fn fill_place(
        &self,
        table: &BTreeMap<String, Vec<String>>,
        key: &str,
        relation: Relation,
        reference: &ObjectCard,
        first: &str,
        second: &str,
        rng: &mut impl Rng,
    ) -> String {
        let is_hollow = things().host(reference).is_some_and(|host| host.relations.contains(&Relation::In));
        let hollow = (relation == Relation::Top && is_hollow).then(|| self.hollow_top.get(key)).flatten();
        let template = hollow.or_else(|| table.get(relation.name())).map_or("", |options| choose(options, rng));
        fill(template, &[("y", first), ("z", second)])
    }
}

/// A random template.
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

/// The text with a capital first letter.
pub(super) fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
