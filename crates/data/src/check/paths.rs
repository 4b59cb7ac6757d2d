//! Which files a data set has, and which it should have.

use std::collections::BTreeSet;
use std::path::Path;

use super::book::{Book, Version};
use super::findings::Findings;
use crate::{DataError, files};

/// Deepest folder that is looked into: `extras/record/EPISODE/GROUP` and one more.
const DEEPEST: usize = 6;

/// All files of a folder by their paths in it, with `/`; links are listed and not followed.
pub(super) fn list(root: &Path) -> Result<BTreeSet<String>, DataError> {
    let mut listed = BTreeSet::new();
    let mut folders = vec![(String::new(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        for name in files::names(&root.join(&folder))? {
            let path = if folder.is_empty() { name } else { format!("{folder}/{name}") };
            if files::is_own_folder(&root.join(&path)) && depth < DEEPEST {
                folders.push((path, depth + 1));
            } else {
                listed.insert(path);
            }
        }
    }
    Ok(listed)
}

/// Missing and foreign files; what lies in `extras` is the record's affair.
pub(super) fn check(book: &Book, listed: &BTreeSet<String>, findings: &mut Findings) {
    let mut expected: BTreeSet<String> = ["meta/info.json", "meta/stats.json"].map(String::from).into();
    expected.extend(book.meta_files.iter().cloned());
    for episode in &book.episodes {
        expected.insert(episode.data.clone());
        expected.extend(episode.videos.iter().map(|video| video.file.clone()));
    }
    if book.is_own {
        let own = ["README.md", "meta/genmanip.json", "meta/lerobot_settings.json"];
        expected.extend(own.map(String::from));
        if book.info.version == Version::V21 {
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
        // Of a data set of others we do not know what else it keeps beside its tables.
        !is_known && (book.is_own || path.starts_with("data/") || path.starts_with("videos/"))
    });
    for path in foreign {
        findings.add("files", path, "", "nothing: no episode names it", "a file");
    }
}
