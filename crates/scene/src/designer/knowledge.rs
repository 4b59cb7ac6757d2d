//! What everyday needs ask for, and how states are changed: tables in `data/designer`.

use std::sync::LazyLock;

use genmanip_core::{ObjectCard, Relation};
use serde::Deserialize;

static NEEDS: LazyLock<Vec<Need>> = LazyLock::new(|| super::data(include_str!("../../data/designer/knowledge.json")));
static HANDLING: LazyLock<Vec<Handling>> =
    LazyLock::new(|| super::data(include_str!("../../data/designer/handling.json")));

/// A need of people and the one thing on the table that meets it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Need {
    /// The need in whole sentences.
    pub needs: Vec<String>,
    /// Categories of things that meet it.
    pub serves: Vec<String>,
    /// Names of single objects that meet it, where not the whole category does.
    #[serde(default)]
    pub names: Vec<String>,
    /// Categories that meet it in a way, so that there must be none on the table.
    pub rivals: Vec<String>,
    /// What the thing is called by what it is for.
    pub item: Vec<String>,
    /// How it may go to its place.
    pub relations: Vec<Relation>,
    /// Categories of places where it is of use.
    pub places: Vec<String>,
    /// What the place is called by what it is for; otherwise it is named.
    #[serde(default)]
    pub place_words: Vec<String>,
}

impl Need {
    /// Whether a thing meets the need.
    pub fn is_met_by(&self, card: &ObjectCard) -> bool {
        self.serves.contains(&card.category) || self.names.contains(&card.name)
    }

    /// Whether a thing makes the choice doubtful.
    pub fn is_doubtful(&self, card: &ObjectCard) -> bool {
        self.is_met_by(card) || self.rivals.contains(&card.category)
    }
}

/// How a state of a kind of thing is brought about.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Handling {
    /// Category of the thing.
    pub category: String,
    /// States it may be in before.
    pub from: Vec<String>,
    /// State it is in afterwards.
    pub to: String,
    /// The request without capital and full stop; `{y}` is the thing.
    pub say: Vec<String>,
    /// Reasons, as main clauses.
    pub why: Vec<String>,
}

pub(super) fn needs() -> &'static [Need] {
    &NEEDS
}

pub(super) fn handling() -> &'static [Handling] {
    &HANDLING
}
