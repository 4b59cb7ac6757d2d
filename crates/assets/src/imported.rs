//! Objects that were read from files: where their models come from, and what is written down of where they are from.
//!
//! The files are read and kept by others; whoever opens packs of imported objects hands them over once, before the
//! first object is asked for, and from then on [`crate::Catalogue`] knows them like any other.

use std::sync::{Arc, OnceLock};

use genmanip_core::ObjectCard;
use serde::{Deserialize, Serialize};

use crate::AssetSource;

/// Where an imported object is from.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// The files, relative to what was named, the main one first.
    pub source: String,
    /// Licence, or `unknown`.
    pub licence: String,
    /// Who made it, where that is said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub creator: Option<String>,
}

/// Opened packs.
pub trait Packs: AssetSource {
    /// Where an object is from; `None` for a hash of no object.
    fn origin(&self, hash: &str) -> Option<Origin>;
}

static OPENED: OnceLock<Arc<dyn Packs>> = OnceLock::new();

/// Makes imported objects known to the whole program; `false` when packs were opened before, which stay.
pub fn open(packs: Arc<dyn Packs>) -> bool {
    OPENED.set(packs).is_ok()
}

/// The opened packs.
pub(crate) fn source() -> Option<&'static Arc<dyn Packs>> {
    OPENED.get()
}

/// Cards of the objects of the opened packs.
pub(crate) fn cards() -> &'static [ObjectCard] {
    OPENED.get().map_or(&[], |packs| packs.cards())
}

/// Where an imported object is from.
pub(crate) fn origin(hash: &str) -> Option<Origin> {
    OPENED.get()?.origin(hash)
}
