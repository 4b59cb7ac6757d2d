//! Tables in `data/designer`: everyday needs and the objects that meet them, and how states of objects are changed.

use std::sync::LazyLock;

use genmanip_core::{ObjectCard, Relation};
use serde::Deserialize;

use super::things::{is_named, things};

static NEEDS: LazyLock<Vec<Need>> = LazyLock::new(|| super::data(include_str!("../../data/designer/knowledge.json")));
static HANDLING: LazyLock<Vec<Handling>> =
    LazyLock::new(|| super::data(include_str!("../../data/designer/handling.json")));

/// An everyday need, stated before a request that is ambiguous without it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Need {
    /// Whole sentences that state the need, one of which is chosen.
    pub says: Vec<String>,
    /// Part of the request that the need decides.
    pub decides: Decides,
    /// Sorts of objects that meet the need, in the syntax of [`is_of`].
    pub serves: Vec<String>,
    /// Sorts that meet the need partly. A scene must not contain any, as the answer would be ambiguous.
    pub rivals: Vec<String>,
    /// Classes or sorts of objects that may be moved, for needs that decide the destination.
    #[serde(default)]
    pub movers: Vec<String>,
    /// Relations between the moved object and its destination that the request allows.
    pub relations: Vec<Relation>,
}

/// The part of the request that a need decides.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub(super) enum Decides {
    /// The moved object; the request names the destination.
    Object,
    /// The destination; the request names the object.
    Place,
}

impl Need {
    /// True if the object meets the need.
    pub fn is_met_by(&self, card: &ObjectCard) -> bool {
        self.serves.iter().any(|sort| is_of(sort, card))
    }

    /// True if the object meets the need only partly, which would make the request ambiguous.
    pub fn is_doubtful(&self, card: &ObjectCard) -> bool {
        self.is_met_by(card) || self.rivals.iter().any(|sort| is_of(sort, card))
    }

    /// True if the object may be the moved one.
    pub fn may_move(&self, card: &ObjectCard) -> bool {
        let class = things().kind(card).map(|kind| &kind.class);
        self.movers.iter().any(|mover| Some(mover) == class || is_of(mover, card))
    }
}

/// True if the object is of a sort: a category, or `category:word` with a word of its name.
pub(super) fn is_of(sort: &str, card: &ObjectCard) -> bool {
    match sort.split_once(':') {
        Some((category, word)) => category == card.category && is_named(card, word),
        None => sort == card.category,
    }
}

/// A change of state of one category of objects, with its phrases.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Handling {
    /// Category of the objects that can be changed this way.
    pub category: String,
    /// Initial states from which this change is possible.
    pub from: Vec<String>,
    /// State after the change.
    pub to: String,
    /// Requests in lower case without a full stop; `{y}` stands for the object.
    pub say: Vec<String>,
    /// Reasons for the request, as main clauses.
    pub why: Vec<String>,
}

pub(super) fn needs() -> &'static [Need] {
    &NEEDS
}

pub(super) fn handling() -> &'static [Handling] {
    &HANDLING
}
