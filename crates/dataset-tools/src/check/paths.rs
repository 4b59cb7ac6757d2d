//! Check for missing and foreign files.

use std::collections::BTreeSet;
use std::path::Path;

use super::findings::Findings;
use super::metadata::{Metadata, Version};
use genmanip_data::{DataError, files};

/// Maximum folder depth: `extras/record/EPISODE/GROUP` and one more.
const MAX_DEPTH: usize = 6;

/// Paths of all files relative to `root`, with `/`; links are listed but not followed.
pub(super) fn list(root: &Path) -> Result<BTreeSet<String>, DataError> {
    let mut listed = BTreeSet::new();
    let mut folders = vec![(String::new(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        for name in files::names(&root.join(&folder))? {
            let path = if folder.is_empty() { name } else { format!("{folder}/{name}") };
            if files::is_folder_no_follow(&root.join(&path)) && depth < MAX_DEPTH {
                folders.push((path, depth + 1));
            } else {
                listed.insert(path);
            }
        }
    }
    Ok(listed)
}

/// Reports missing and foreign files; files in `extras` are checked with the native record.
pub(super) fn check(metadata: &Metadata, listed: &BTreeSet<String>, findings: &mut Findings) {
    let mut expected: BTreeSet<String> = ["meta/info.json"].map(String::from).into();
    // LeRobot's own tools write v2.1 without statistics over all episodes.
    if metadata.is_own || metadata.info.version != Version::V21 {
        expected.insert("meta/stats.json".into());
    }
    expected.extend(metadata.meta_files.iter().cloned());
    for episode in &metadata.episodes {
        expected.insert(episode.data.clone());
        expected.extend(episode.videos.iter().map(|video| video.file.clone()));
    }
    if metadata.is_own {
        let own = ["README.md", "meta/genmanip.json", "meta/lerobot_settings.json"];
        expected.extend(own.map(String::from));
        if metadata.info.version == Version::V21 {
            expected.extend(["norm_stats.json", "meta/modality.json"].map(String::from));
        }
    }
    for missing in expected.difference(listed) {
        findings.add("files", missing, "", "a file", "nothing");
    }
    let optional =
        ["README.md", "croissant.json", "meta/action_contract.json", ".gitattributes", "LICENSE", "meta/stats.json"];
    let foreign = listed.difference(&expected).filter(|path| {
        let is_known = optional.contains(&path.as_str()) || path.starts_with("extras/");
        // Data sets of other programs may have further files beside their tables.
        !is_known && (metadata.is_own || path.starts_with("data/") || path.starts_with("videos/"))
    });
    for path in foreign {
        findings.add("files", path, "", "no such file, as no episode refers to it", "a file");
    }
}
