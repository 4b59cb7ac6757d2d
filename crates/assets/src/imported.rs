//! Registration of packs with imported objects.
//!
//! Packs are read elsewhere. The program registers opened packs here once, before the first object is requested; then
//! [`crate::Catalogue`] serves their objects like any others.

use std::sync::{Arc, OnceLock};

use genmanip_core::ObjectCard;
use serde::{Deserialize, Serialize};

use crate::AssetSource;

/// Provenance of an imported object.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Source files, relative to the imported path, the main one first.
    pub source: String,
    /// Licence as stated in the source, or `unknown`.
    pub licence: String,
    /// Author; `None` if unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub creator: Option<String>,
}

/// Set of opened packs of imported objects.
pub trait Packs: AssetSource {
    /// Provenance of an object by its hash; `None` for an unknown hash.
    fn origin(&self, hash: &str) -> Option<Origin>;
}

static OPENED: OnceLock<Arc<dyn Packs>> = OnceLock::new();

/// Registers packs for the whole process; returns `false` and changes nothing if packs were registered before.
pub fn open(packs: Arc<dyn Packs>) -> bool {
    OPENED.set(packs).is_ok()
}

/// Registered packs; `None` before [`open`].
pub(crate) fn source() -> Option<&'static Arc<dyn Packs>> {
    OPENED.get()
}

/// Cards of the registered packs' objects; empty without packs.
pub(crate) fn cards() -> &'static [ObjectCard] {
    OPENED.get().map_or(&[], |packs| packs.cards())
}

/// Provenance of an imported object by its hash; `None` if no registered pack contains it.
pub(crate) fn origin(hash: &str) -> Option<Origin> {
    OPENED.get()?.origin(hash)
}
