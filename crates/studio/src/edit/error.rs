//! Errors of edits.

use std::path::PathBuf;

use genmanip_workspace::WorkspaceError;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::log_file::LogError;

/// Reason why an edit is not applied; scenario, log and the state in memory are unchanged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EditError {
    /// The operation does not fit the scenario.
    #[error("{place}: {message}")]
    Invalid {
        /// Place in the operation or scenario, e.g. `args.uid`.
        place: String,
        /// Description of the expected and the found value.
        message: String,
        /// Suggested fix; may be empty.
        hint: String,
    },
    /// Another author changed the same field since the command's base revision.
    #[error("`{}` was changed in revision {} by another author", .0.field, .0.revision)]
    Conflict(Box<Conflict>),
    /// The author has no command to undo or redo.
    #[error("{author} has nothing to {action}")]
    Nothing {
        /// Name of the author.
        author: String,
        /// `undo` or `redo`.
        action: &'static str,
    },
    /// The scenario's file or its log was changed by another program.
    #[error("{} was changed by another program", path.display())]
    ChangedOutside {
        /// The changed file.
        path: PathBuf,
    },
    /// Another program is editing the scenario.
    #[error("{} is being edited by another program", path.display())]
    Busy {
        /// The scenario's file.
        path: PathBuf,
    },
    /// The scenario belongs to a frozen suite or a run.
    #[error("{} is read-only: {reason}", path.display())]
    ReadOnly {
        /// The scenario's file.
        path: PathBuf,
        /// Reason why it is read-only, for people.
        reason: String,
    },
    /// A line of the log cannot be read or does not follow from the lines before it.
    #[error("line {line} of the log: {message}: {}", path.display())]
    Log {
        /// Path of the log.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// Description of the fault.
        message: String,
    },
    /// An earlier failure to write may have made files and memory differ; open the scenario again.
    #[error("editing stopped after an error: {}", path.display())]
    Stopped {
        /// The scenario's file.
        path: PathBuf,
    },
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] WorkspaceError),
}

/// A field that both the command and a later revision of another author change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Conflict {
    /// Field, e.g. `objects/001/pose`.
    pub field: String,
    /// Value that the command gives the field; null for a removal.
    pub mine: Value,
    /// Present value of the field; null if it is gone.
    pub theirs: Value,
    /// Last revision that changed the field.
    pub revision: u64,
}

impl EditError {
    /// An [`EditError::Invalid`].
    pub(crate) fn invalid(place: impl Into<String>, message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Invalid { place: place.into(), message: message.into(), hint: hint.into() }
    }

    /// Suggested fix for the user; empty if there is none.
    pub fn hint(&self) -> String {
        match self {
            Self::Invalid { hint, .. } => hint.clone(),
            Self::Conflict(_) => "keep their value, or give the command again on the present revision".into(),
            Self::Nothing { .. } => "undo and redo concern an author's own commands; see `--history`".into(),
            Self::ChangedOutside { .. } => {
                "keep a copy of the file; put the old content back, or remove its .edits.jsonl to start a new log"
                    .into()
            }
            Self::Busy { .. } => "end the other program, or make the change there".into(),
            Self::ReadOnly { .. } => "make a copy of the scenario and edit that".into(),
            Self::Log { .. } => "keep a copy of the log; remove it to start a new one from the scenario's file".into(),
            Self::Stopped { .. } => "open the scenario again; acknowledged changes are in its log".into(),
            Self::File(error) => error.hint().unwrap_or_default().to_owned(),
        }
    }
}

impl From<LogError> for EditError {
    fn from(error: LogError) -> Self {
        match error {
            LogError::Damaged { path, line, message } => Self::Log { path, line, message },
            LogError::ChangedOutside { path } => Self::ChangedOutside { path },
            LogError::Busy { path } => Self::Busy { path },
            LogError::Stopped { path } => Self::Stopped { path },
            LogError::File(error) => Self::File(error),
        }
    }
}
