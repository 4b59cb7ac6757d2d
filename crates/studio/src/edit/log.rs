//! The log of a scenario's edits: `NAME.edits.jsonl`, append-only, synced before a line is acknowledged.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use genmanip_core::limits::EDITS;
use genmanip_core::{Document, Scenario, hexadecimal, json};
use genmanip_data::{DataError, files};
use genmanip_workspace::documents::{read_bytes, unwritable};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::error::EditError;
use super::operation::Operation;

/// Schema of the log.
pub const SCHEMA: &str = "genmanip.edits/1";

/// First line of a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Header {
    /// `genmanip.edits/1`.
    pub schema: String,
    /// Scenario of which this one is a copy; null for an original.
    pub parent: Option<Parent>,
    /// SHA-256 of the scenario's file at revision 0.
    pub sha256: String,
    /// The scenario at revision 0, a `genmanip.scenario/2`.
    pub scenario: Value,
}

/// The scenario that was copied.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Parent {
    /// Its file.
    pub path: String,
    /// SHA-256 of that file.
    pub sha256: String,
}

/// Line of a command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CommandLine {
    /// Revision that the command made, from 1.
    pub revision: u64,
    /// The operation, with its open choices made.
    #[serde(flatten)]
    pub operation: Operation,
    /// Author, time and id.
    #[serde(flatten)]
    pub stamp: Stamp,
    /// Revision that the author saw.
    pub base_revision: u64,
    /// Revision of the command that this one takes back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub undoes: Option<u64>,
    /// Revision of the command that this one applies again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub redoes: Option<u64>,
    /// SHA-256 of the scenario's file after it.
    pub sha256: String,
}

/// Line of a named snapshot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Snapshot {
    /// Its name.
    pub snapshot: String,
    /// The revision that it names.
    pub revision: u64,
    /// Author, time and id.
    #[serde(flatten)]
    pub stamp: Stamp,
}

/// Author, time and id of a request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Stamp {
    /// Id that the client chose; a repeated id has no further effect.
    pub client_operation_id: String,
    /// Name of the author.
    pub author: String,
    /// Time, RFC 3339; given by the caller, since no clock is read.
    pub at: String,
}

/// A line after the first.
#[derive(Clone, Debug, PartialEq)]
pub enum Line {
    /// A command.
    Command(Box<CommandLine>),
    /// A snapshot.
    Snapshot(Snapshot),
}

/// The file of a log: as read, and open for appending once something is written.
#[derive(Debug)]
pub struct EditLog {
    path: PathBuf,
    /// Bytes of whole lines.
    whole: u64,
    /// Bytes of the file, with a torn last line.
    found: u64,
    /// The locked file; `None` until the first line is appended.
    file: Option<File>,
}

impl EditLog {
    /// Path of the log of a scenario's file: `NAME.edits.jsonl` beside `NAME.json`.
    pub fn path_of(scenario: &Path) -> PathBuf {
        scenario.with_extension("edits.jsonl")
    }

    /// A log that does not exist yet.
    pub fn new(path: PathBuf) -> Self {
        Self { path, whole: 0, found: 0, file: None }
    }

    /// Reads a log; a torn last line is left out.
    ///
    /// # Errors
    /// [`EditError::File`] and [`EditError::Log`].
    pub fn read(path: PathBuf) -> Result<(Self, Header, Vec<Line>), EditError> {
        let bytes = read_bytes(&path, EDITS)?;
        let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
        let damaged = |line: usize, message: String| EditError::Log { path: path.clone(), line, message };
        let mut lines = Vec::new();
        let mut header = None;
        for (index, line) in bytes[..whole].split_inclusive(|&byte| byte == b'\n').enumerate() {
            let parsed = std::str::from_utf8(line).map_err(|error| error.to_string());
            let parsed = parsed.and_then(|text| json::parse(text).map_err(|error| error.to_string()));
            let value = parsed.map_err(|message| damaged(index + 1, message))?;
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
        let log = Self { path, whole: whole as u64, found: bytes.len() as u64, file: None };
        Ok((log, header, lines))
    }

    /// The log's file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Creates the log with its first line; another program's log is never replaced.
    ///
    /// # Errors
    /// [`EditError::ChangedOutside`] if there is one now, and [`EditError::File`].
    pub fn create(&mut self, header: &Header) -> Result<(), EditError> {
        let bytes = line_of(header);
        let created = files::create(&self.path, &bytes).map_err(|error| unwritable(&self.path, error))?;
        if !created {
            return Err(EditError::ChangedOutside { path: self.path.clone() });
        }
        // The entry of the folder, too, must survive a power failure.
        if let Some(folder) = self.path.parent().and_then(|folder| File::open(folder).ok()) {
            let _ = folder.sync_all();
        }
        (self.whole, self.found) = (bytes.len() as u64, bytes.len() as u64);
        Ok(())
    }

    /// True if the log has a first line.
    pub fn exists(&self) -> bool {
        self.whole > 0
    }

    /// Opens and locks the log, and cuts a torn last line off.
    ///
    /// # Errors
    /// [`EditError::Busy`] if another program has it open; [`EditError::ChangedOutside`] if it was changed since it was
    /// read; [`EditError::File`].
    pub fn open(&mut self, scenario: &Path) -> Result<(), EditError> {
        if self.file.is_some() {
            return Ok(());
        }
        let path = &self.path;
        let failed = |error: std::io::Error| unwritable(path, DataError::io("write", path)(error));
        if !files::is_file_no_follow(path) {
            return Err(EditError::ChangedOutside { path: path.clone() });
        }
        let file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(EditError::Busy { path: scenario.to_owned() }),
            Err(TryLockError::Error(error)) => return Err(failed(error).into()),
        }
        if file.metadata().map_err(failed)?.len() != self.found {
            return Err(EditError::ChangedOutside { path: path.clone() });
        }
        if self.found > self.whole {
            file.set_len(self.whole).and_then(|()| file.sync_data()).map_err(failed)?;
            self.found = self.whole;
        }
        self.file = Some(file);
        Ok(())
    }

    /// Appends a line and syncs it; if that fails, the log is as before.
    ///
    /// # Errors
    /// [`EditError::File`]; [`EditError::Stopped`] if the log could not be restored.
    pub fn append(&mut self, line: &impl Serialize) -> Result<(), EditError> {
        let bytes = line_of(line);
        let (path, whole) = (self.path.clone(), self.whole);
        let Some(file) = &mut self.file else { return Err(EditError::Stopped { path }) };
        let appended =
            file.seek(SeekFrom::Start(whole)).and_then(|_| file.write_all(&bytes)).and_then(|()| file.sync_data());
        match appended {
            Ok(()) => {
                self.whole += bytes.len() as u64;
                self.found = self.whole;
                Ok(())
            }
            Err(error) => {
                self.cut(whole)?;
                Err(unwritable(&path, DataError::io("write", &path)(error)).into())
            }
        }
    }

    /// Cuts the log to its first `length` bytes.
    ///
    /// # Errors
    /// [`EditError::Stopped`].
    pub fn cut(&mut self, length: u64) -> Result<(), EditError> {
        let cut = self.file.as_ref().is_some_and(|file| file.set_len(length).and_then(|()| file.sync_data()).is_ok());
        if !cut {
            return Err(EditError::Stopped { path: self.path.clone() });
        }
        (self.whole, self.found) = (length, length);
        Ok(())
    }

    /// Bytes of the whole lines.
    pub fn length(&self) -> u64 {
        self.whole
    }
}

impl Header {
    /// The scenario at revision 0.
    ///
    /// # Errors
    /// The document's error.
    pub fn scenario(&self) -> Result<Scenario, String> {
        Scenario::from_value(self.scenario.clone()).map_err(|error| error.to_string())
    }
}

/// SHA-256 of a file's bytes, hexadecimal.
pub(super) fn sha256(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

fn line_of(line: &impl Serialize) -> Vec<u8> {
    // Maps have text keys, so that this cannot fail.
    let mut bytes = serde_json::to_vec(line).unwrap_or_default();
    bytes.push(b'\n');
    bytes
}

/// Checks author, time and id of a request.
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
