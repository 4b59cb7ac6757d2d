//! Errors of requests, each with its causes and a hint.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use genmanip_core::limits::Limit;
use genmanip_core::{DocumentError, names::near_misses};
use genmanip_data::DataError;
use genmanip_rollout::RolloutError;

/// Underlying error of another error.
pub type Cause = Box<dyn std::error::Error + Send + Sync>;

/// Error of a request by a user or a program; [`WorkspaceError::hint`] says how to fix it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkspaceError {
    /// A file or folder cannot be read, listed or written.
    #[error("cannot {action} {}", path.display())]
    File {
        /// Attempted operation: `read`, `list` or `write`.
        action: &'static str,
        /// File or folder of the attempted operation.
        path: PathBuf,
        /// Error of the system or of the reader.
        source: Cause,
        /// Advice on how to fix the error; `None` if there is none.
        hint: Option<String>,
    },
    /// A file exceeds the size limit of its kind.
    #[error("{} is larger than {} may be: {}", path.display(), limit.what, limit.human_readable())]
    TooLarge {
        /// File that is too large.
        path: PathBuf,
        /// Kind of file and its size limit.
        limit: Limit,
    },
    /// A file is not a valid document of the expected schema.
    #[error("{} is no valid {schema} file", path.display())]
    Document {
        /// File that is not valid.
        path: PathBuf,
        /// Name of the expected schema.
        schema: &'static str,
        /// Parse or validation error.
        source: DocumentError,
    },
    /// A name that is not registered.
    #[error("unknown {what} `{got}`")]
    UnknownName {
        /// Kind of name, e.g. `policy`.
        what: &'static str,
        /// Plural of `what`.
        plural: &'static str,
        /// Name as given.
        got: String,
        /// Known names with similar spelling, best match first.
        near: Vec<String>,
        /// All known names.
        known: Vec<String>,
    },
    /// The user's input exists but is unsuitable.
    #[error("{what}")]
    Input {
        /// Description of what is unsuitable.
        what: String,
        /// Underlying error, if any.
        source: Option<Cause>,
        /// Expected input, or a suggested fix. `None` if there is none.
        hint: Option<String>,
    },
    /// The folder holds a run with other inputs, settings or seed.
    #[error("{} holds another run ({difference})", path.display())]
    AnotherRun {
        /// Folder of the run.
        path: PathBuf,
        /// First difference, see [`difference`](crate::difference).
        difference: String,
    },
    /// The folder holds results or episodes of an evaluation with other inputs or settings.
    #[error("{} holds another evaluation ({difference})", path.display())]
    AnotherEvaluation {
        /// Folder of the evaluation.
        path: PathBuf,
        /// First difference, see [`difference`](crate::difference).
        difference: String,
    },
    /// The folder holds no run.
    #[error("no run at {}", path.display())]
    NoRun {
        /// Folder that holds no run.
        path: PathBuf,
    },
    /// A remote policy does not answer, or answers wrongly, as the reason says; the request may be retried.
    #[error("policy {policy} is not available: {reason}")]
    Unreachable {
        /// Policy with its arguments, as the user named it.
        policy: String,
        /// Reason given by the client or the server.
        reason: String,
    },
    /// A mistake in a policy's program: its episode was not run, and can be once the mistake is corrected.
    #[error("{policy}: {what}")]
    Mistaken {
        /// Policy, and the episode that was not run.
        policy: String,
        /// Description of the mistake, with its place in the program.
        what: String,
        /// Advice on how to fix the mistake.
        hint: String,
    },
    /// Unexpected failure of a stage: a defect, or a fault of its environment.
    #[error("{what}")]
    Broken {
        /// Description of the operation that failed.
        what: String,
        /// Underlying error; `None` for a detected inconsistency.
        source: Option<Cause>,
        /// Suggested fix. `None` if there is none.
        hint: Option<String>,
    },
}

impl WorkspaceError {
    /// [`WorkspaceError::File`] without a hint; `action` is `read`, `list` or `write`.
    pub fn file(action: &'static str, path: &Path, source: impl Into<Cause>) -> Self {
        Self::File { action, path: path.to_owned(), source: source.into(), hint: None }
    }

    /// [`WorkspaceError::Input`] without source and hint.
    pub fn input(what: impl Into<String>) -> Self {
        Self::Input { what: what.into(), source: None, hint: None }
    }

    /// [`WorkspaceError::Broken`] with its underlying error.
    pub fn broken(what: impl Into<String>, error: impl Into<Cause>) -> Self {
        Self::Broken { what: what.into(), source: Some(error.into()), hint: None }
    }

    /// [`WorkspaceError::UnknownName`] with the known names of similar spelling.
    pub fn unknown(what: &'static str, plural: &'static str, got: &str, known: &[&str]) -> Self {
        let near = near_misses(got, known);
        Self::UnknownName { what, plural, got: got.into(), near, known: known.iter().map(|&k| k.into()).collect() }
    }

    /// [`WorkspaceError`] of a failed read or write of a file; `action` is `read` or `write`.
    pub fn of_file(action: &'static str, path: &Path, error: DataError) -> Self {
        match error {
            DataError::Io { source, .. } => Self::file(action, path, source),
            DataError::TooLarge { path, limit } => Self::TooLarge { path, limit },
            DataError::NotAFile { path, found } => {
                Self::input(format!("expected a file, found {found}: {}", path.display()))
                    .with_hint("links inside of runs, pipes, devices and folders are not read; name a file")
            }
            error => Self::broken(format!("cannot {action} {}", path.display()), error),
        }
    }

    /// Adds the underlying error; ignored by variants without a source.
    #[must_use]
    pub fn because(mut self, error: impl Into<Cause>) -> Self {
        match &mut self {
            Self::Input { source, .. } | Self::Broken { source, .. } => *source = Some(error.into()),
            Self::File { source, .. } => *source = error.into(),
            _ => {}
        }
        self
    }

    /// Adds a hint; ignored by variants that derive their own.
    #[must_use]
    pub fn with_hint(mut self, help: impl Into<String>) -> Self {
        if let Self::File { hint, .. } | Self::Input { hint, .. } | Self::Broken { hint, .. } = &mut self {
            *hint = Some(help.into());
        }
        self
    }

    /// Adds a hint if the sources suggest none.
    #[must_use]
    pub fn or_hint(self, help: impl Into<String>) -> Self {
        if self.hint().is_some() { self } else { self.with_hint(help) }
    }

    /// Suggested fix, see [`hint`].
    pub fn hint(&self) -> Option<String> {
        hint(self)
    }

    /// Hint that the error itself gives, without those of its sources.
    fn own_hint(&self) -> Option<String> {
        match self {
            Self::File { hint, .. } | Self::Input { hint, .. } | Self::Broken { hint, .. } => hint.clone(),
            Self::TooLarge { limit, .. } => Some(format!("expected {}; is this the right file?", limit.what)),
            Self::Document { schema, source, .. } => Some(match source {
                DocumentError::NotJson { hint, .. } => (*hint).into(),
                DocumentError::WrongSchema { .. } => {
                    format!("expected a JSON object that starts with \"schema\": \"{schema}\"")
                }
                DocumentError::Invalid { .. } => "the JSON Schemas in schemas/ describe every file".into(),
            }),
            Self::UnknownName { plural, near, known, .. } => {
                let near = near.iter().map(|name| format!("did you mean `{name}`? ")).collect::<String>();
                Some(format!("{near}{plural} are {}", known.join(", ")))
            }
            Self::AnotherRun { .. } => {
                Some("choose another --out folder, or repeat the command of that run to continue it".into())
            }
            Self::AnotherEvaluation { path, .. } => Some(format!(
                "move {} away, or repeat the command that it was begun with to continue it",
                path.display()
            )),
            Self::Unreachable { .. } => Some("check that it is running, then repeat the command".into()),
            Self::Mistaken { hint, .. } => Some(hint.clone()),
            Self::NoRun { .. } => Some("make one with `genmanip collect TASKS --out FOLDER`".into()),
        }
    }
}

/// Messages of an error and of its causes; a cause that the message before already contains is omitted.
pub fn messages(error: &dyn std::error::Error) -> Vec<String> {
    let mut messages = vec![error.to_string()];
    let causes = std::iter::successors(error.source(), |cause| cause.source());
    for cause in causes.map(ToString::to_string) {
        if messages.last().is_none_or(|last| !last.contains(&cause)) {
            messages.push(cause);
        }
    }
    messages
}

/// [`messages`] of an error in one line.
pub fn with_causes(error: &dyn std::error::Error) -> String {
    messages(error).join(": ")
}

/// Advice on how to fix an error: for a full disk if one is anywhere in the chain of sources, else the first hint of
/// the chain. `None` if there is none.
pub fn hint(error: &(dyn std::error::Error + 'static)) -> Option<String> {
    let chain = || std::iter::successors(Some(error), |error| error.source());
    let is_full = |error: &std::io::Error| matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded);
    if chain().any(|error| error.downcast_ref().is_some_and(is_full)) {
        return Some("free some space on that disk and start again; what is finished is kept".into());
    }
    chain().find_map(|error| {
        let of_data = || error.downcast_ref::<DataError>()?.hint();
        error.downcast_ref::<WorkspaceError>().and_then(WorkspaceError::own_hint).or_else(of_data)
    })
}

/// Error that stopped the processing of many episodes.
pub enum Stopped {
    /// Error of a file, a service or a setting.
    Run(WorkspaceError),
    /// Error of running an episode.
    Episode(RolloutError),
}

impl From<RolloutError> for Stopped {
    fn from(error: RolloutError) -> Self {
        Self::Episode(error)
    }
}

impl From<WorkspaceError> for Stopped {
    fn from(error: WorkspaceError) -> Self {
        Self::Run(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_however_deep_it_lies() {
        let io = |kind: ErrorKind| std::io::Error::from(kind);
        let deep = |kind| DataError::Io { action: "write", path: "rows.parquet".into(), source: io(kind) };
        let episode = |source: RolloutError| RolloutError::Episode { id: "a-000".into(), source: Box::new(source) };
        let policy = |error: WorkspaceError| RolloutError::Policy { policy: "agent".into(), source: error.into() };
        let full = || WorkspaceError::file("write", Path::new("transcript.json"), io(ErrorKind::StorageFull));
        let given = "start again";
        for (error, expected) in [
            (WorkspaceError::broken("cannot draw", deep(ErrorKind::StorageFull)), "free some space"),
            (WorkspaceError::broken("cannot draw", deep(ErrorKind::StorageFull)).with_hint(given), "free some space"),
            (WorkspaceError::file("write", Path::new("run.json"), io(ErrorKind::QuotaExceeded)), "free some space"),
            (
                WorkspaceError::broken("collecting stopped", episode(deep(ErrorKind::StorageFull).into())),
                "free some space",
            ),
            (WorkspaceError::broken("evaluating stopped", episode(policy(full()))).with_hint(given), "free some space"),
            (WorkspaceError::broken("cannot draw", deep(ErrorKind::PermissionDenied)).with_hint(given), given),
            (WorkspaceError::broken("cannot draw", deep(ErrorKind::PermissionDenied)).or_hint(given), "may write to"),
            (WorkspaceError::broken("cannot draw", deep(ErrorKind::Other)).or_hint(given), given),
        ] {
            assert!(error.hint().unwrap().contains(expected), "{error}: {:?}", error.hint());
        }
        assert_eq!(WorkspaceError::broken("cannot draw", deep(ErrorKind::Other)).hint(), None);
    }

    #[test]
    fn names_that_look_alike_are_offered() {
        let known = ["expert", "replay", "do_nothing"];
        let error = WorkspaceError::unknown("policy", "policies", "expret", &known);
        assert_eq!(error.to_string(), "unknown policy `expret`");
        let hint = "did you mean `expert`? policies are expert, replay, do_nothing";
        assert_eq!(error.hint().as_deref(), Some(hint));
    }
}
