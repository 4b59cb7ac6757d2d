//! Human reviews of a suite's scenarios, stored in its folder.

use std::path::Path;

use crate::suite_format::{Review, ReviewFile, ReviewVerdict};
use genmanip_core::{Document, limits};

use super::open;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Reviews of a suite so far; empty if there is no review file.
///
/// # Errors
/// If the file is damaged.
pub fn reviews(folder: &Path) -> Result<ReviewFile, WorkspaceError> {
    let path = folder.join("review.json");
    if path.exists() { documents::read_document(&path, limits::SUITE) } else { Ok(ReviewFile::default()) }
}

/// Stores a person's review of a scenario; it replaces an earlier one by the same person.
///
/// # Errors
/// If the suite has no such scenario, or the file cannot be read or written.
pub fn review(
    folder: &Path,
    scenario: &str,
    reviewer: &str,
    verdict: ReviewVerdict,
    note: &str,
) -> Result<ReviewFile, WorkspaceError> {
    let suite = open(folder)?;
    let Some(entry) = suite.scenarios.iter().find(|entry| entry.id == scenario) else {
        return Err(WorkspaceError::input(format!("suite {} has no scenario `{scenario}`", suite.name))
            .with_hint(format!("`genmanip suite show {} --json` lists them", folder.display())));
    };
    let mut file = reviews(folder)?;
    file.add(Review {
        scenario: scenario.into(),
        reviewer: reviewer.into(),
        sha256: entry.sha256.clone(),
        verdict,
        note: note.into(),
    });
    documents::write_file(&folder.join("review.json"), file.to_json().as_bytes())?;
    Ok(file)
}

/// Number of reviews by verdict, as one line of text.
pub fn describe(file: &ReviewFile) -> String {
    let count = |verdict: ReviewVerdict| format!("{} {}", file.count(verdict), verdict.name());
    format!("{} reviews: {}\n", file.reviews.len(), ReviewVerdict::ALL.map(count).join(", "))
}
