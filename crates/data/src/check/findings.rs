//! What is wrong, gathered without a flood.

use std::collections::BTreeMap;

use serde::Serialize;

/// One thing that is not as it should be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was checked: `files`, `info`, `features`, `tasks`, `episodes`, `rows`, `timestamps`, `values`,
    /// `statistics`, `state`, `action`, `contract`, `video`, `depth`, `record`, `card` or `leak`; `replay` where episodes
    /// were simulated again, which this crate does not do.
    pub check: &'static str,
    /// File in the data set.
    pub file: String,
    /// Where in it.
    pub place: String,
    /// What fits.
    pub expected: String,
    /// What is there.
    pub found: String,
}

/// Findings of one check in one file that are listed; of the others only the number is kept.
const LISTED_PER_FILE: usize = 8;
/// Findings that are listed at all.
const LISTED: usize = 1000;

/// Findings under way.
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

    /// [`Findings::add`] where two things differ.
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

    /// Takes over what is wrong with a data set in another folder.
    pub(crate) fn adopt(&mut self, folder: &str, findings: Vec<Finding>, further: usize) {
        self.listed.extend(
            findings.into_iter().map(|finding| Finding { file: format!("{folder}/{}", finding.file), ..finding }),
        );
        self.further += further;
    }

    /// Those listed, and the number of the others.
    pub(crate) fn into_parts(self) -> (Vec<Finding>, usize) {
        (self.listed, self.further)
    }
}
