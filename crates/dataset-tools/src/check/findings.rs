//! Findings of a check, limited in number.

use std::collections::BTreeMap;

use serde::Serialize;

/// A deviation found by a check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Name of the check: `files`, `info`, `features`, `tasks`, `episodes`, `rows`, `timestamps`, `values`,
    /// `statistics`, `state`, `action`, `contract`, `video`, `depth`, `record`, `card` or `leak`; `replay` for
    /// re-simulated episodes, which is outside this crate.
    pub check: &'static str,
    /// Path of the file relative to the data set.
    pub file: String,
    /// Position in the file as text, e.g. `row 12, action`; empty for the whole file.
    pub place: String,
    /// Expected value as text.
    pub expected: String,
    /// Actual value as text.
    pub found: String,
}

/// Maximum findings listed per check and file; further ones are only counted.
const LISTED_PER_FILE: usize = 8;
/// Maximum findings listed in total. Chosen by hand.
const LISTED: usize = 1000;

/// Findings collected by all checks so far, with a count of those beyond the limits.
#[derive(Debug, Default)]
pub(crate) struct Findings {
    listed: Vec<Finding>,
    further: usize,
    counts: BTreeMap<(&'static str, String), usize>,
}

impl Findings {
    pub(crate) fn add(
        &mut self,
        check: &'static str,
        file: &str,
        place: impl Into<String>,
        expected: impl ToString,
        found: impl ToString,
    ) {
        let count = self.counts.entry((check, file.to_owned())).or_default();
        *count += 1;
        if *count > LISTED_PER_FILE || self.listed.len() >= LISTED {
            self.further += 1;
            return;
        }
        let (expected, found) = (expected.to_string(), found.to_string());
        self.listed.push(Finding { check, file: file.to_owned(), place: place.into(), expected, found });
    }

    /// Adds a finding if two values differ.
    pub(crate) fn require<T: PartialEq + std::fmt::Debug>(
        &mut self,
        check: &'static str,
        file: &str,
        place: &str,
        expected: &T,
        found: &T,
    ) {
        if expected != found {
            self.add(check, file, place, format!("{expected:?}"), format!("{found:?}"));
        }
    }

    /// Adds the findings of a nested data set in the subfolder `folder`, and its number of unlisted findings.
    pub(crate) fn adopt(&mut self, folder: &str, findings: Vec<Finding>, further: usize) {
        self.listed.extend(
            findings.into_iter().map(|finding| Finding { file: format!("{folder}/{}", finding.file), ..finding }),
        );
        self.further += further;
    }

    /// Listed findings, and the number of findings beyond the limits.
    pub(crate) fn into_parts(self) -> (Vec<Finding>, usize) {
        (self.listed, self.further)
    }
}
