//! The log of reviews and certificates, `reviews.jsonl`: append-only, synced before a line is acknowledged.
//!
//! Several programs may append to one log: each opens it for one line, reads what the others wrote, and checks its own
//! line against that.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use genmanip_benchmark::suite_format::Certificate;
use genmanip_core::limits::REVIEWS;
use genmanip_workspace::WorkspaceError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::reviewed::{Decision, Review};
use super::standing::{Standing, current, standing};
use crate::log_file::{LogError, LogFile};

/// Schema of the log.
pub const SCHEMA: &str = "genmanip.reviews/1";
/// Attempts to open a log that another program is writing, and the pause between them.
const ATTEMPTS: usize = 100;
const PAUSE: Duration = Duration::from_millis(20);

/// First line of the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ReviewHeader {
    /// `genmanip.reviews/1`.
    pub schema: String,
}

/// A line after the first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ReviewLine {
    /// A review.
    Review(Box<Review>),
    /// Trials of the expert.
    Trials(ExpertTrials),
    /// The reviews before are those of an older file, which was read once.
    Imported(ImportedReviews),
}

/// Trials of the expert on one content; a certificate if all are verified.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExpertTrials {
    /// Id of the scenario.
    pub scenario: String,
    /// SHA-256 of what was tried: scenario, assets and engine.
    pub content_sha256: String,
    /// Episodes, each with its own random stream.
    pub episodes: usize,
    /// Verified episodes.
    pub verified: usize,
    /// Shortest tool path among these, m; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shortest_path_m: Option<f64>,
    /// Shortest simulated duration among these, s; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shortest_s: Option<f64>,
    /// Simulated time that a policy gets, s.
    pub horizon_s: f64,
    /// Time, RFC 3339; given by the caller.
    pub at: String,
}

/// A `review.json` of a suite that was read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportedReviews {
    /// Source, e.g. `suite genmanip-200-rc`.
    pub imported: String,
    /// Number of its reviews of scenarios that had not changed since.
    pub reviews: usize,
}

/// Reason why a review is not kept.
#[derive(Debug, thiserror::Error)]
pub enum ReviewError {
    /// It does not fit what was said before, or is incomplete.
    #[error("{0}")]
    Invalid(String),
    /// The scenario was edited since the reviewer saw it.
    #[error("the scenario was edited since it was shown")]
    Voided,
    /// The log cannot be read or written.
    #[error(transparent)]
    Log(#[from] LogError),
}

impl From<ReviewError> for WorkspaceError {
    fn from(error: ReviewError) -> Self {
        match error {
            ReviewError::Log(error) => error.into(),
            error => Self::input(error.to_string()),
        }
    }
}

/// The log, as last read.
#[derive(Debug)]
pub struct ReviewLog {
    file: LogFile,
    reviews: Vec<Review>,
    /// Last trials by content.
    trials: BTreeMap<String, ExpertTrials>,
    imported: BTreeSet<String>,
    /// Reviews of older files, which are written with the next line.
    pending: Vec<(ImportedReviews, Vec<Review>)>,
}

impl ReviewLog {
    /// Path of the log in a folder.
    pub fn path_of(folder: &Path) -> PathBuf {
        folder.join("reviews.jsonl")
    }

    /// Reads the log of a folder, which may not exist yet; writes nothing.
    ///
    /// # Errors
    /// [`LogError`] if it cannot be read.
    pub fn read(folder: &Path) -> Result<Self, LogError> {
        let file = LogFile::new(Self::path_of(folder));
        let mut log =
            Self { file, reviews: Vec::new(), trials: BTreeMap::new(), imported: BTreeSet::new(), pending: Vec::new() };
        log.refresh()?;
        Ok(log)
    }

    /// Reads what other programs appended since.
    ///
    /// # Errors
    /// As [`ReviewLog::read`].
    pub fn refresh(&mut self) -> Result<(), LogError> {
        let path = self.file.path().to_owned();
        if !self.file.has_changed() {
            return Ok(());
        }
        if !path.exists() {
            self.file = LogFile::new(path);
            self.forget();
            return Ok(());
        }
        let (file, lines) = LogFile::read(path, REVIEWS)?;
        self.file = file;
        self.forget();
        for (index, line) in lines.into_iter().enumerate() {
            self.keep(index, line)?;
        }
        Ok(())
    }

    fn forget(&mut self) {
        self.reviews.clear();
        self.trials.clear();
        self.imported.clear();
    }

    fn keep(&mut self, index: usize, line: Value) -> Result<(), LogError> {
        let path = || self.file.path().to_owned();
        let damaged = |message: String| LogError::Damaged { path: path(), line: index + 1, message };
        let refused = |error: serde_json::Error| damaged(error.to_string());
        if index == 0 {
            let header: ReviewHeader = serde_json::from_value(line).map_err(refused)?;
            let message = || format!("expected schema {SCHEMA:?}, got {:?}", header.schema);
            return if header.schema == SCHEMA { Ok(()) } else { Err(damaged(message())) };
        }
        // Not by the untagged enum, whose errors do not say what is missing.
        if line.get("imported").is_some() {
            let imported: ImportedReviews = serde_json::from_value(line).map_err(refused)?;
            self.imported.insert(imported.imported);
        } else if line.get("episodes").is_some() {
            let trials: ExpertTrials = serde_json::from_value(line).map_err(refused)?;
            self.trials.insert(trials.content_sha256.clone(), trials);
        } else {
            self.reviews.push(serde_json::from_value(line).map_err(refused)?);
        }
        Ok(())
    }

    /// All reviews in their order, those of older files first.
    pub fn reviews(&self) -> Vec<Review> {
        self.pending.iter().flat_map(|(_, reviews)| reviews).chain(&self.reviews).cloned().collect()
    }

    /// Last trials of the expert on a content.
    pub fn trials(&self, content_sha256: &str) -> Option<&ExpertTrials> {
        self.trials.get(content_sha256)
    }

    /// True if the reviews of an older file are in the log, or wait to be.
    pub fn has_imported(&self, source: &str) -> bool {
        self.imported.contains(source) || self.pending.iter().any(|(known, _)| known.imported == source)
    }

    /// Takes the reviews of an older file in; they are written with the next line.
    pub fn import(&mut self, source: &str, reviews: Vec<Review>) {
        if !self.has_imported(source) {
            self.pending.push((ImportedReviews { imported: source.into(), reviews: reviews.len() }, reviews));
        }
    }

    /// Appends a review of the present content; one that was sent before changes nothing.
    ///
    /// # Errors
    /// [`ReviewError`]; the log is then as before.
    pub fn add(&mut self, review: Review, present_sha256: &str) -> Result<(), ReviewError> {
        if let Some(fault) = review.fault() {
            return Err(ReviewError::Invalid(fault));
        }
        // Before a log is begun, and again when no other program can append.
        self.refresh()?;
        if !self.is_new(&review, present_sha256)? {
            return Ok(());
        }
        self.with_file(|log| {
            if log.is_new(&review, present_sha256)? {
                log.file.append(&review)?;
                log.reviews.push(review);
            }
            Ok(())
        })
    }

    /// True if a review can follow the others; false if it was sent before.
    fn is_new(&self, review: &Review, present_sha256: &str) -> Result<bool, ReviewError> {
        let known = self.reviews();
        let id = review.client_operation_id.as_str();
        let is_same = |other: &Review| other.client_operation_id == id && other.reviewer.name == review.reviewer.name;
        if !id.is_empty() && known.iter().any(is_same) {
            return Ok(false);
        }
        if review.content_sha256 != present_sha256 {
            return Err(ReviewError::Voided);
        }
        match misfit(review, &current(&known, &review.scenario, present_sha256)) {
            Some(misfit) => Err(ReviewError::Invalid(misfit)),
            None => Ok(true),
        }
    }

    /// Appends trials of the expert.
    ///
    /// # Errors
    /// [`ReviewError::Log`]; the log is then as before.
    pub fn add_trials(&mut self, trials: ExpertTrials) -> Result<(), ReviewError> {
        self.with_file(|log| {
            log.file.append(&trials)?;
            log.trials.insert(trials.content_sha256.clone(), trials);
            Ok(())
        })
    }

    /// Works on the log while no other program can.
    fn with_file(&mut self, work: impl FnOnce(&mut Self) -> Result<(), ReviewError>) -> Result<(), ReviewError> {
        self.open()?;
        let written = self.write_pending().map_err(ReviewError::from).and_then(|()| work(self));
        self.file.close();
        written
    }

    /// Opens the log, with what other programs wrote meanwhile.
    fn open(&mut self) -> Result<(), LogError> {
        let mut attempt = 1;
        loop {
            self.refresh()?;
            if !self.file.exists() {
                let folder = self.file.path().parent().unwrap_or(Path::new("."));
                let not_made = |error| WorkspaceError::file("write", folder, error).with_hint("name another --out");
                std::fs::create_dir_all(folder).map_err(not_made)?;
                match self.file.create(&ReviewHeader { schema: SCHEMA.into() }) {
                    Ok(()) | Err(LogError::ChangedOutside { .. }) => {}
                    Err(error) => return Err(error),
                }
            }
            match self.file.open() {
                Ok(()) => return Ok(()),
                Err(LogError::Busy { .. } | LogError::ChangedOutside { .. }) if attempt < ATTEMPTS => sleep(PAUSE),
                Err(error) => return Err(error),
            }
            attempt += 1;
        }
    }

    fn write_pending(&mut self) -> Result<(), LogError> {
        while let Some((head, reviews)) = self.pending.first().cloned() {
            // Another program may have read the same file.
            if !self.imported.contains(&head.imported) {
                for review in reviews {
                    self.file.append(&review)?;
                    self.reviews.push(review);
                }
                // Last, so that a killed program reads the file again.
                self.file.append(&head)?;
                self.imported.insert(head.imported);
            }
            self.pending.remove(0);
        }
        Ok(())
    }
}

impl ExpertTrials {
    /// The certificate, if the expert solved the content every time.
    pub fn certificate(&self) -> Option<Certificate> {
        let Self { episodes, verified, .. } = *self;
        let (shortest_path_m, shortest_s) = (self.shortest_path_m?, self.shortest_s?);
        (verified > 0 && verified == episodes).then_some(Certificate {
            episodes,
            verified,
            shortest_path_m,
            shortest_s,
        })
    }
}

/// Reason why a review cannot follow the current ones of its content.
fn misfit(review: &Review, current: &[&Review]) -> Option<String> {
    let name = &review.reviewer.name;
    let own = current.iter().find(|known| known.reviewer.name == *name);
    if review.decision == Decision::TakeBack {
        return own.is_none().then(|| format!("{name} has nothing to take back"));
    }
    if !review.adjudicates {
        let has_adjudicated = own.is_some_and(|own| own.adjudicates);
        return has_adjudicated.then(|| format!("{name} has adjudicated this scenario; take that back first"));
    }
    if own.is_some_and(|own| !own.adjudicates) {
        return Some(format!("{name} is one of the two reviewers; somebody else adjudicates"));
    }
    let independent: Vec<&Review> = current.iter().copied().filter(|known| !known.adjudicates).collect();
    (standing(&independent, true) != Standing::Adjudication)
        .then(|| "only two reviews that differ are adjudicated".to_owned())
}
