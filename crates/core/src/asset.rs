//! Assets and their instances: what things are made from, and what a scene calls them.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::Seed;

/// What an instance is made from.
///
/// Uids are opaque texts that hold neither `#` nor `/`: the first marks copies, the second parts of an instance.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "source", rename_all = "snake_case", deny_unknown_fields)]
pub enum AssetRef {
    /// An object of the catalogue that comes with the program.
    Builtin {
        /// Its uid.
        uid: String,
        /// Version of its record; grows when its physics change.
        version: u32,
    },
    /// An object that a parametric family makes.
    Generated {
        /// Name of the family, e.g. `mug`.
        family: String,
        /// Parameters of the family by name.
        #[serde(default)]
        params: BTreeMap<String, Value>,
        /// Stream of everything that the parameters leave open.
        seed: Seed,
        /// Version of the family; grows when the physics of its objects change.
        version: u32,
    },
    /// An object that was read from files.
    Imported {
        /// Hash of those files.
        hash: String,
    },
}

impl AssetRef {
    /// An object of the catalogue.
    pub fn builtin(uid: &str, version: u32) -> Self {
        Self::Builtin { uid: uid.into(), version }
    }
}

impl std::fmt::Display for AssetRef {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Builtin { uid, version } => write!(f, "built-in {uid} (version {version})"),
            Self::Generated { family, seed, version, .. } => write!(f, "{family} of seed {seed} (version {version})"),
            Self::Imported { hash } => write!(f, "imported {hash}"),
        }
    }
}

/// What a scene calls its `copy`-th instance of an asset, from 1: `001`, `001#2`, …
///
/// ```
/// use genmanip_core::asset::instance_id;
/// assert_eq!([instance_id("001", 1), instance_id("001", 2)], ["001", "001#2"]);
/// ```
pub fn instance_id(uid: &str, copy: usize) -> String {
    if copy <= 1 { uid.to_owned() } else { format!("{uid}#{copy}") }
}

/// Ids of instances that are listed by the uids of their assets.
///
/// ```
/// use genmanip_core::asset::instance_ids;
/// assert_eq!(instance_ids(["7", "001", "7", "7"]), ["7", "001", "7#2", "7#3"]);
/// ```
pub fn instance_ids<'a>(uids: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut seen: BTreeMap<&str, usize> = BTreeMap::new();
    let mut number = |uid| {
        let copy = seen.entry(uid).or_default();
        *copy += 1;
        instance_id(uid, *copy)
    };
    uids.into_iter().map(&mut number).collect()
}

/// Uid of the asset that an id names, whichever copy it is.
///
/// ```
/// use genmanip_core::asset::uid_of;
/// assert_eq!([uid_of("001"), uid_of("001#2")], ["001", "001"]);
/// ```
pub fn uid_of(id: &str) -> &str {
    id.split_once('#').map_or(id, |(uid, _)| uid)
}
