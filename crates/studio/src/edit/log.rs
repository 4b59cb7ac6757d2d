//! The log of a scenario's edits: `NAME.edits.jsonl`, append-only, synced before a line is acknowledged.

use std::path::{Path, PathBuf};

use genmanip_core::limits::EDITS;
use genmanip_core::{Document, Scenario, hexadecimal};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::error::EditError;
use super::operation::Operation;
use crate::log_file::{LogError, LogFile};

/// Schema of the log.
pub const SCHEMA: &str = "genmanip.edits/1";

/// First line of a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Header {
    /// [`SCHEMA`].
    pub schema: String,
    /// Scenario that this one was copied from; null for an original.
    pub parent: Option<Parent>,
    /// SHA-256 of the scenario's file at revision 0.
    pub sha256: String,
    /// The scenario at revision 0, a `genmanip.scenario/2`.
    pub scenario: Value,
}

/// The scenario that a copy was made from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Parent {
    /// Path of its file, as given when the copy was made.
    pub path: String,
    /// SHA-256 of that file.
    pub sha256: String,
}

/// Line of one applied command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CommandLine {
    /// Revision that the command made, from 1.
    pub revision: u64,
    /// The operation with every optional choice filled in, such as the id of a new object, so that a replay is exact.
    #[serde(flatten)]
    pub operation: Operation,
    /// Author, time and id.
    #[serde(flatten)]
    pub stamp: Stamp,
    /// Revision that the author had seen when giving the command.
    pub base_revision: u64,
    /// Revision of the command that this one undoes; absent for other commands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub undoes: Option<u64>,
    /// Revision of the undone command that this one applies again; absent for other commands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub redoes: Option<u64>,
    /// SHA-256 of the scenario's file after this command.
    pub sha256: String,
}

/// Line that names a revision.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Snapshot {
    /// Name of the snapshot.
    pub snapshot: String,
    /// The revision that it names.
    pub revision: u64,
    /// Author, time and id.
    #[serde(flatten)]
    pub stamp: Stamp,
}

/// Author, time and id of a command or snapshot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Stamp {
    /// Id that the client chose; a repeated id has no further effect.
    pub client_operation_id: String,
    /// Name of the author.
    pub author: String,
    /// Time as an RFC 3339 text, given by the caller.
    pub at: String,
}

/// Any line after the header.
#[derive(Clone, Debug, PartialEq)]
pub enum Line {
    /// A command that was applied.
    Command(Box<CommandLine>),
    /// A named revision.
    Snapshot(Snapshot),
}

/// Log file of a scenario's edits.
#[derive(Debug)]
pub struct EditLog(LogFile);

impl EditLog {
    /// Path of the log of a scenario's file: `NAME.edits.jsonl` beside `NAME.json`.
    pub fn path_of(scenario: &Path) -> PathBuf {
        scenario.with_extension("edits.jsonl")
    }

    /// A log without a file yet.
    pub fn new(path: PathBuf) -> Self {
        Self(LogFile::new(path))
    }

    /// Reads a log; an incomplete last line (a torn write) is ignored.
    ///
    /// # Errors
    /// [`EditError::File`] and [`EditError::Log`].
    pub fn read(path: PathBuf) -> Result<(Self, Header, Vec<Line>), EditError> {
        let (file, values) = LogFile::read(path, EDITS)?;
        let damaged = |line: usize, message: String| EditError::Log { path: file.path().to_owned(), line, message };
        let mut lines = Vec::new();
        let mut header = None;
        for (index, value) in values.into_iter().enumerate() {
            let refused = |error: serde_json::Error| damaged(index + 1, error.to_string());
            if index == 0 {
                let read: Header = serde_json::from_value(value).map_err(refused)?;
                if read.schema != SCHEMA {
                    return Err(damaged(1, format!("expected schema {SCHEMA:?}, got {:?}", read.schema)));
                }
                header = Some(read);
            } else if value.get("snapshot").is_some() {
                lines.push(Line::Snapshot(serde_json::from_value(value).map_err(refused)?));
            } else {
                lines.push(Line::Command(serde_json::from_value(value).map_err(refused)?));
            }
        }
        let header = header.ok_or_else(|| damaged(1, "expected the first line, got none".into()))?;
        Ok((Self(file), header, lines))
    }

    /// Path of the log.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Creates the log with its header; an existing file is never replaced.
    ///
    /// # Errors
    /// [`EditError::ChangedOutside`] if the file exists by now, and [`EditError::File`].
    pub fn create(&mut self, header: &Header) -> Result<(), EditError> {
        Ok(self.0.create(header)?)
    }

    /// True if the log has a header.
    pub fn exists(&self) -> bool {
        self.0.exists()
    }

    /// Opens and locks the log for appending, and truncates an incomplete last line.
    ///
    /// # Errors
    /// [`EditError::Busy`] if another program has it open; [`EditError::ChangedOutside`] if it was changed since it was
    /// read; [`EditError::File`].
    pub fn open(&mut self, scenario: &Path) -> Result<(), EditError> {
        self.0.open().map_err(|error| match error {
            LogError::Busy { .. } => EditError::Busy { path: scenario.to_owned() },
            error => error.into(),
        })
    }

    /// Appends a line and syncs it to the disk; if that fails, the log is restored.
    ///
    /// # Errors
    /// [`EditError::File`]; [`EditError::Stopped`] if the log is not open or could not be restored.
    pub fn append(&mut self, line: &impl Serialize) -> Result<(), EditError> {
        Ok(self.0.append(line)?)
    }

    /// Truncates the log to its first `length` bytes.
    ///
    /// # Errors
    /// [`EditError::Stopped`] if the log is not open or cannot be truncated.
    pub fn cut(&mut self, length: u64) -> Result<(), EditError> {
        Ok(self.0.cut(length)?)
    }

    /// Length of all complete lines, bytes.
    pub fn length(&self) -> u64 {
        self.0.length()
    }
}

impl Header {
    /// The scenario at revision 0.
    ///
    /// # Errors
    /// If it is not a valid scenario; the message names the place.
    pub fn scenario(&self) -> Result<Scenario, String> {
        Scenario::from_value(self.scenario.clone()).map_err(|error| error.to_string())
    }
}

/// SHA-256 of a file's bytes, hexadecimal.
pub(super) fn sha256(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

/// Checks that author, time and id are neither empty nor too long, and have no control characters.
///
/// # Errors
/// [`EditError::Invalid`].
pub(super) fn check_stamp(stamp: &Stamp) -> Result<(), EditError> {
    let parts = [
        ("author", &stamp.author, 64),
        ("client_operation_id", &stamp.client_operation_id, 128),
        ("at", &stamp.at, 40),
    ];
    for (place, text, most) in parts {
        let length = text.chars().count();
        if length == 0 || length > most || text.chars().any(char::is_control) {
            let message = format!("expected 1 to {most} characters, none of them a control character, got {length}");
            return Err(EditError::invalid(place, message, ""));
        }
    }
    Ok(())
}
