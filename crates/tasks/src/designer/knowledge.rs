//! What everyday needs ask for, and how states are changed: tables in `data/designer`.

use std::sync::LazyLock;

use genmanip_core::{ObjectCard, Relation};
use serde::Deserialize;

use super::things::{is_named, things};

static NEEDS: LazyLock<Vec<Need>> = LazyLock::new(|| super::data(include_str!("../../data/designer/knowledge.json")));
static HANDLING: LazyLock<Vec<Handling>> =
    LazyLock::new(|| super::data(include_str!("../../data/designer/handling.json")));

/// A need of people, told before a request that leaves open what it is about.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Need {
    /// The need in whole sentences.
    pub says: Vec<String>,
    /// What follows from it.
    pub decides: Decides,
    /// Sorts of things that meet it, as [`is_of`] reads them.
    pub serves: Vec<String>,
    /// Sorts that meet it in a way, so that there must be none on the table.
    pub rivals: Vec<String>,
    /// Classes or sorts of things that may be moved, where the need decides the place.
    #[serde(default)]
    pub movers: Vec<String>,
    /// How the thing may go to its place.
    pub relations: Vec<Relation>,
}

/// What a need decides.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub(super) enum Decides {
    /// What is moved; the request says where to.
    Object,
    /// Where it goes; the request says what.
    Place,
}

impl Need {
    /// Whether a thing meets the need.
    pub fn is_met_by(&self, card: &ObjectCard) -> bool {
        self.serves.iter().any(|sort| is_of(sort, card))
    }

    /// Whether a thing makes the choice doubtful.
    pub fn is_doubtful(&self, card: &ObjectCard) -> bool {
        self.is_met_by(card) || self.rivals.iter().any(|sort| is_of(sort, card))
    }

    /// Whether a thing may be what is moved.
    pub fn may_move(&self, card: &ObjectCard) -> bool {
        let class = things().kind(card).map(|kind| &kind.class);
        self.movers.iter().any(|mover| Some(mover) == class || is_of(mover, card))
    }
}

/// Whether a thing is of a sort: a category, or `category:word` with a word of its name.
pub(super) fn is_of(sort: &str, card: &ObjectCard) -> bool {
    match sort.split_once(':') {
        Some((category, word)) => category == card.category && is_named(card, word),
        None => sort == card.category,
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
