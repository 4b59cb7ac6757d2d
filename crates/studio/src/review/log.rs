//! Log of reviews and certificates, `reviews.jsonl`: append-only; each line is synced before it is acknowledged.
//!
//! Several programs may append to the same log: each opens it for one line, reads the lines of the others, and checks
//! its
//! own line against them.

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

/// Schema of the log's header.
pub const SCHEMA: &str = "genmanip.reviews/1";
/// Maximum number of attempts to open a log that another program is writing, and pause between them.
const ATTEMPTS: usize = 100;
const PAUSE: Duration = Duration::from_millis(20);

/// Header, the first line of the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ReviewHeader {
    /// [`SCHEMA`].
    pub schema: String,
}

/// Any line after the header.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ReviewLine {
    /// A review of a scenario.
    Review(Box<Review>),
    /// Trials of the expert on a scenario.
    Trials(ExpertTrials),
    /// Mark that the reviews before come from an older file, so that it is not read again.
    Imported(ImportedReviews),
}

/// Trials of the expert on one content; they are a certificate if all are verified.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExpertTrials {
    /// Id of the scenario.
    pub scenario: String,
    /// SHA-256 of the tried content: scenario, assets and engine.
    pub content_sha256: String,
    /// Number of episodes, each with its own random stream.
    pub episodes: usize,
    /// Number of verified episodes.
    pub verified: usize,
    /// Shortest tool path of a verified episode, m; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shortest_path_m: Option<f64>,
    /// Shortest simulated duration of a verified episode, s; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shortest_s: Option<f64>,
    /// Simulated time available to a policy, s.
    pub horizon_s: f64,
    /// Time as an RFC 3339 text, given by the caller.
    pub at: String,
}

/// Import of a suite's `review.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportedReviews {
    /// Source, e.g. `suite genmanip-200-rc`.
    pub imported: String,
    /// Number of imported reviews: those of scenarios that have not changed since.
    pub reviews: usize,
}

/// Reason why a review is not stored.
#[derive(Debug, thiserror::Error)]
pub enum ReviewError {
    /// The review is incomplete, or contradicts the earlier ones; the text says how.
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

/// Log of reviews and trials, with its content as last read.
#[derive(Debug)]
pub struct ReviewLog {
    file: LogFile,
    reviews: Vec<Review>,
    /// Latest trials by hash of the content.
    trials: BTreeMap<String, ExpertTrials>,
    imported: BTreeSet<String>,
    /// Reviews of older files, to be written before the next line.
    pending: Vec<(ImportedReviews, Vec<Review>)>,
}

impl ReviewLog {
    /// Path of the log in a folder.
    pub fn path_of(folder: &Path) -> PathBuf {
        folder.join("reviews.jsonl")
    }

    /// Reads the log in a folder; empty if the file does not exist. Writes nothing.
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

    /// Reads the lines that other programs appended since the last read.
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
        // Each variant is parsed by itself: errors of the untagged enum do not name the missing field.
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

    /// All reviews in order, those of older files first.
    pub fn reviews(&self) -> Vec<Review> {
        self.pending.iter().flat_map(|(_, reviews)| reviews).chain(&self.reviews).cloned().collect()
    }

    /// Latest trials of the expert on a content; `None` without any.
    pub fn trials(&self, content_sha256: &str) -> Option<&ExpertTrials> {
        self.trials.get(content_sha256)
    }

    /// True if the reviews of an older file are in the log, or are to be written with the next line.
    pub fn has_imported(&self, source: &str) -> bool {
        self.imported.contains(source) || self.pending.iter().any(|(known, _)| known.imported == source)
    }

    /// Adds the reviews of an older file; they are written before the next line.
    pub fn import(&mut self, source: &str, reviews: Vec<Review>) {
        if !self.has_imported(source) {
            self.pending.push((ImportedReviews { imported: source.into(), reviews: reviews.len() }, reviews));
        }
    }

    /// Appends a review of the present content; a repetition (same operation id) has no effect.
    ///
    /// # Errors
    /// [`ReviewError`]; the log is unchanged then.
    pub fn add(&mut self, review: Review, present_sha256: &str) -> Result<(), ReviewError> {
        if let Some(fault) = review.fault() {
            return Err(ReviewError::Invalid(fault));
        }
        // Checked here before a log is created, and again under the lock, when no other program can append.
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

    /// True if the review may be appended; false if it is a repetition.
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

    /// Appends trials of the expert to the log.
    ///
    /// # Errors
    /// [`ReviewError::Log`]; the log is unchanged then.
    pub fn add_trials(&mut self, trials: ExpertTrials) -> Result<(), ReviewError> {
        self.with_file(|log| {
            log.file.append(&trials)?;
            log.trials.insert(trials.content_sha256.clone(), trials);
            Ok(())
        })
    }

    /// Runs `work` on the locked log, after writing pending imports.
    fn with_file(&mut self, work: impl FnOnce(&mut Self) -> Result<(), ReviewError>) -> Result<(), ReviewError> {
        self.open()?;
        let written = self.write_pending().map_err(ReviewError::from).and_then(|()| work(self));
        self.file.close();
        written
    }

    /// Opens and locks the log, and reads the lines that other programs have appended.
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
            // Another program may have imported the same file meanwhile.
            if !self.imported.contains(&head.imported) {
                for review in reviews {
                    self.file.append(&review)?;
                    self.reviews.push(review);
                }
                // The mark comes last, so that after a kill in between the older file is read again.
                self.file.append(&head)?;
                self.imported.insert(head.imported);
            }
            self.pending.remove(0);
        }
        Ok(())
    }
}

impl ExpertTrials {
    /// Certificate for a suite; `None` unless the expert solved the content in every episode.
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

/// Reason why a review contradicts the current ones of its content; `None` if it does not.
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
