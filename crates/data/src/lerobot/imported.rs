//! Origin of an imported data set.

use genmanip_core::Document;
use serde::{Deserialize, Serialize};

/// File within an imported data set that holds [`Imported`].
pub const IMPORTED: &str = "meta/imported.json";
/// Column of the episodes table with the SHA-256 of the imported episode's source.
pub const SOURCE_HASH: &str = "source_sha256";

/// Source format and settings of an import.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Imported {
    /// Format of the source: `lerobot-v3.0`, `lerobot-v2.1` or `genmanip-0.9`.
    pub format: String,
    /// Rows per second.
    pub fps: u32,
    /// True if the sibling data set `<name>-depth` has depth images.
    pub depth: bool,
    /// True if `extras/record` holds the native record of the episodes.
    pub record: bool,
    /// Episodes per data and video file.
    pub episodes_per_file: usize,
    /// Episodes per file of the depth data set.
    pub episodes_per_depth_file: usize,
    /// Differences from the source: columns omitted or converted, images re-encoded.
    pub notes: Vec<String>,
}

impl Document for Imported {
    const SCHEMA: &'static str = "genmanip.imported/1";
}
