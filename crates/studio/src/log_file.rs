//! An append-only file of JSON lines: a line is synced before it is acknowledged, and a torn last line is cut off.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use genmanip_core::json;
use genmanip_core::limits::Limit;
use genmanip_data::{DataError, files};
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents::{read_bytes, unwritable};
use serde::Serialize;
use serde_json::Value;

/// Error of a log; the file and the state in memory are unchanged.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// A line cannot be read.
    #[error("line {line} of the log: {message}: {}", path.display())]
    Damaged {
        /// Path of the log.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// Description of the fault.
        message: String,
    },
    /// The log was changed by another program.
    #[error("{} was changed by another program", path.display())]
    ChangedOutside {
        /// Path of the log.
        path: PathBuf,
    },
    /// Another program has the log open.
    #[error("{} is being written by another program", path.display())]
    Busy {
        /// Path of the log.
        path: PathBuf,
    },
    /// An earlier failure to write may have made file and memory differ; read the log again.
    #[error("writing stopped after an error: {}", path.display())]
    Stopped {
        /// Path of the log.
        path: PathBuf,
    },
    /// The log cannot be read or written.
    #[error(transparent)]
    File(#[from] WorkspaceError),
}

impl From<LogError> for WorkspaceError {
    fn from(error: LogError) -> Self {
        let hint = match &error {
            LogError::Damaged { .. } => "keep a copy of the log; remove it to start a new one",
            LogError::Busy { .. } | LogError::ChangedOutside { .. } => "end the other program, or try again",
            LogError::Stopped { .. } | LogError::File(_) => "try again; what was acknowledged is in the log",
        };
        match error {
            LogError::File(error) => error,
            error => Self::input(error.to_string()).with_hint(hint),
        }
    }
}

/// File of a log: read at first, and opened for appending by [`LogFile::open`].
#[derive(Debug)]
pub struct LogFile {
    path: PathBuf,
    /// Length of the complete lines, bytes.
    whole: u64,
    /// Length of the file, an incomplete last line included, bytes.
    found: u64,
    /// The locked file; `None` until it is opened for appending.
    file: Option<File>,
}

impl LogFile {
    /// A log without a file yet.
    pub fn new(path: PathBuf) -> Self {
        Self { path, whole: 0, found: 0, file: None }
    }

    /// Reads a log and its lines; an incomplete last line (a torn write) is ignored.
    ///
    /// # Errors
    /// [`LogError::File`] and [`LogError::Damaged`].
    pub fn read(path: PathBuf, limit: Limit) -> Result<(Self, Vec<Value>), LogError> {
        let bytes = read_bytes(&path, limit)?;
        let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
        let mut lines = Vec::new();
        for (index, line) in bytes[..whole].split_inclusive(|&byte| byte == b'\n').enumerate() {
            let parsed = std::str::from_utf8(line).map_err(|error| error.to_string());
            let parsed = parsed.and_then(|text| json::parse(text).map_err(|error| error.to_string()));
            let damaged = |message| LogError::Damaged { path: path.clone(), line: index + 1, message };
            lines.push(parsed.map_err(damaged)?);
        }
        Ok((Self { path, whole: whole as u64, found: bytes.len() as u64, file: None }, lines))
    }

    /// Path of the log.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Creates the log with its first line; an existing file is never replaced.
    ///
    /// # Errors
    /// [`LogError::ChangedOutside`] if the file exists by now, and [`LogError::File`].
    pub fn create(&mut self, header: &impl Serialize) -> Result<(), LogError> {
        let bytes = line_of(header);
        let created = files::create(&self.path, &bytes).map_err(|error| unwritable(&self.path, error))?;
        if !created {
            return Err(LogError::ChangedOutside { path: self.path.clone() });
        }
        // Sync the folder as well, so that its new entry survives a power failure.
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

    /// True if the length of the file differs from the one when it was last read or written.
    pub fn has_changed(&self) -> bool {
        std::fs::metadata(&self.path).map_or(0, |metadata| metadata.len()) != self.found
    }

    /// Opens and locks the log for appending, and truncates an incomplete last line.
    ///
    /// # Errors
    /// [`LogError::Busy`] if another program has it open; [`LogError::ChangedOutside`] if it was changed since it was
    /// read; [`LogError::File`].
    pub fn open(&mut self) -> Result<(), LogError> {
        if self.file.is_some() {
            return Ok(());
        }
        let path = &self.path;
        let failed = |error: std::io::Error| unwritable(path, DataError::io("write", path)(error));
        if !files::is_file_no_follow(path) {
            return Err(LogError::ChangedOutside { path: path.clone() });
        }
        let file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(LogError::Busy { path: path.clone() }),
            Err(TryLockError::Error(error)) => return Err(failed(error).into()),
        }
        if file.metadata().map_err(failed)?.len() != self.found {
            return Err(LogError::ChangedOutside { path: path.clone() });
        }
        if self.found > self.whole {
            file.set_len(self.whole).and_then(|()| file.sync_data()).map_err(failed)?;
            self.found = self.whole;
        }
        self.file = Some(file);
        Ok(())
    }

    /// Closes and unlocks the log.
    pub fn close(&mut self) {
        self.file = None;
    }

    /// Appends a line and syncs it to the disk; if that fails, the log is restored.
    ///
    /// # Errors
    /// [`LogError::File`]; [`LogError::Stopped`] if the log is not open or could not be restored.
    pub fn append(&mut self, line: &impl Serialize) -> Result<(), LogError> {
        let bytes = line_of(line);
        let (path, whole) = (self.path.clone(), self.whole);
        let Some(file) = &mut self.file else { return Err(LogError::Stopped { path }) };
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

    /// Truncates the log to its first `length` bytes.
    ///
    /// # Errors
    /// [`LogError::Stopped`].
    pub fn cut(&mut self, length: u64) -> Result<(), LogError> {
        let cut = self.file.as_ref().is_some_and(|file| file.set_len(length).and_then(|()| file.sync_data()).is_ok());
        if !cut {
            return Err(LogError::Stopped { path: self.path.clone() });
        }
        (self.whole, self.found) = (length, length);
        Ok(())
    }

    /// Length of the complete lines, bytes.
    pub fn length(&self) -> u64 {
        self.whole
    }
}

fn line_of(line: &impl Serialize) -> Vec<u8> {
    // Serialising cannot fail, since all maps have text keys.
    let mut bytes = serde_json::to_vec(line).unwrap_or_default();
    bytes.push(b'\n');
    bytes
}
