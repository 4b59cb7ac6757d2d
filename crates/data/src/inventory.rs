//! Detects changes of an episode since its last inspection, from file metadata alone.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

use genmanip_core::EpisodeResult;
use serde::{Deserialize, Serialize};

/// Valid attempt with its files on disk.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspected {
    /// Result in the attempt's `episode.json`.
    pub result: EpisodeResult,
    /// True if frames of the attempt were stored.
    pub recorded: bool,
    /// True if the attempt has a scenario.
    pub has_scenario: bool,
    /// Files of the attempt; `None` while unfinished files are among them.
    pub inventory: Option<FileInventory>,
}

/// Files of an attempt with their sizes, and its groups of files.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileInventory {
    /// Size of each file in bytes, by path relative to the attempt's folder.
    pub files: BTreeMap<String, u64>,
    /// Names of the attempt's group folders.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<String>,
}

impl FileInventory {
    /// True if all files lie in `folder` with these sizes and nothing was written, added or removed at or after
    /// `since`.
    pub fn are_unchanged(&self, folder: &Path, since: SystemTime) -> bool {
        let is_older = |about: &fs::Metadata| about.modified().is_ok_and(|modified| modified < since);
        let is_folder = |path: &Path| fs::symlink_metadata(path).is_ok_and(|about| about.is_dir() && is_older(&about));
        is_folder(folder)
            && self.groups.iter().all(|name| is_folder(&folder.join(name)))
            && self.files.iter().all(|(name, &bytes)| {
                fs::symlink_metadata(folder.join(name))
                    .is_ok_and(|about| about.is_file() && about.len() == bytes && is_older(&about))
            })
    }
}
