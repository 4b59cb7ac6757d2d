//! Comparison of the contents of two suites.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::suite_format::{FrozenFile, SuiteEntry};
use serde::Serialize;

use super::open;
use genmanip_workspace::WorkspaceError;

/// Differences of two suites.
#[derive(Clone, Debug, Serialize)]
pub struct Difference {
    /// True if both have the same scenarios, so that results are comparable.
    pub same_scenarios: bool,
    /// Ids of scenarios only in the first suite.
    pub only_first: Vec<String>,
    /// Ids of scenarios only in the second suite.
    pub only_second: Vec<String>,
    /// Ids of scenarios in both suites that differ, with the names of the differing parts.
    pub changed: BTreeMap<String, Vec<String>>,
    /// Names of the files of frozen objects that only one suite has, or that differ.
    pub changed_assets: Vec<String>,
}

/// Compares the `suite.json` of two suites.
///
/// # Errors
/// If one of the two cannot be read.
pub fn diff(first: &Path, second: &Path) -> Result<Difference, WorkspaceError> {
    let (first, second) = (open(first)?, open(second)?);
    let by_id = |entries: &[SuiteEntry]| -> BTreeMap<String, SuiteEntry> {
        entries.iter().map(|entry| (entry.id.clone(), entry.clone())).collect()
    };
    let (ours, theirs) = (by_id(&first.scenarios), by_id(&second.scenarios));
    let missing = |from: &BTreeMap<String, SuiteEntry>, other: &BTreeMap<String, SuiteEntry>| {
        from.keys().filter(|id| !other.contains_key(*id)).cloned().collect()
    };
    let frozen = |files: &[FrozenFile]| -> BTreeSet<(String, String)> {
        files.iter().map(|frozen| (frozen.file.clone(), frozen.sha256.clone())).collect()
    };
    let (our_assets, their_assets) = (frozen(&first.assets), frozen(&second.assets));
    let changed_assets: BTreeSet<String> =
        our_assets.symmetric_difference(&their_assets).map(|(file, _)| file.clone()).collect();
    let both = ours.iter().filter_map(|(id, entry)| Some((id.clone(), changes(entry, theirs.get(id)?))));
    Ok(Difference {
        same_scenarios: first.suite_hash == second.suite_hash,
        only_first: missing(&ours, &theirs),
        only_second: missing(&theirs, &ours),
        changed: both.filter(|(_, changes)| !changes.is_empty()).collect(),
        changed_assets: changed_assets.into_iter().collect(),
    })
}

fn changes(ours: &SuiteEntry, theirs: &SuiteEntry) -> Vec<String> {
    let fields = [
        ("scenario", ours.sha256 != theirs.sha256),
        ("kind", ours.kind != theirs.kind),
        ("source", ours.source != theirs.source),
        ("traits", ours.traits != theirs.traits),
        ("horizon", ours.horizon_s != theirs.horizon_s),
        ("certificate", ours.certificate != theirs.certificate),
        ("pictures", ours.pictures != theirs.pictures),
    ];
    fields.into_iter().filter(|(_, differs)| *differs).map(|(name, _)| name.to_owned()).collect()
}

/// Text summary.
pub fn describe(difference: &Difference) -> String {
    let mut text = match difference.same_scenarios {
        true => "the scenarios are the same: results can be compared\n".to_owned(),
        false => "the scenarios differ: results cannot be compared\n".to_owned(),
    };
    for (sign, ids) in [('-', &difference.only_first), ('+', &difference.only_second)] {
        text.extend(ids.iter().map(|id| format!("{sign} {id}\n")));
    }
    text.extend(difference.changed_assets.iter().map(|file| format!("~ {file}\n")));
    text.extend(difference.changed.iter().map(|(id, what)| format!("~ {id}: {}\n", what.join(", "))));
    text
}
