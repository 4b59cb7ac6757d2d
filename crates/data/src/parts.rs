//! Whether an episode is still what it was when it was last looked at, told from the file system alone.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

use genmanip_core::EpisodeResult;
use serde::{Deserialize, Serialize};

/// An attempt that was found sound, with what there is of it on the disk.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspected {
    /// How it went.
    pub result: EpisodeResult,
    /// Whether its frames were kept.
    pub recorded: bool,
    /// Whether it has a scenario.
    pub has_scenario: bool,
    /// What it consists of; `None` while something unfinished lies among it.
    pub parts: Option<Parts>,
}

/// The files of an attempt with their sizes, and its groups.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Parts {
    /// Bytes of each file, by its path in the folder of the attempt.
    pub(crate) files: BTreeMap<String, u64>,
    /// Folders of its groups.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) groups: Vec<String>,
}

impl Parts {
    /// Whether all of it lies in `folder` with these sizes and nothing there was written, added or taken away at or
    /// after `since`.
    pub(crate) fn are_unchanged(&self, folder: &Path, since: SystemTime) -> bool {
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
