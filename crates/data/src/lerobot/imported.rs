//! What a data set says that was imported.

use genmanip_core::Document;
use serde::{Deserialize, Serialize};

/// Where a data set says what it was imported from.
pub(crate) const IMPORTED: &str = "meta/imported.json";
/// Column of the episodes table with the hash of what an episode was imported from.
pub(crate) const SOURCE_HASH: &str = "source_sha256";

/// What was imported, and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Imported {
    /// `lerobot-v3.0`, `lerobot-v2.1` or `genmanip-0.9`.
    pub format: String,
    /// Rows per second.
    pub fps: u32,
    /// Whether depth pictures lie in the sibling data set `<name>-depth`.
    pub depth: bool,
    /// Whether the native record of the episodes came along in `extras/record`.
    pub record: bool,
    /// Episodes per data and video file.
    pub episodes_per_file: usize,
    /// Episodes per file of the depth data set.
    pub episodes_per_depth_file: usize,
    /// What differs from the source: columns that were left out or take another form, pictures that were encoded.
    pub notes: Vec<String>,
}

impl Document for Imported {
    const SCHEMA: &'static str = "genmanip.imported/1";
}
