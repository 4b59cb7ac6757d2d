//! What could not be done, why, and what helps.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use genmanip_core::limits::Limit;
use genmanip_core::{DocumentError, names::near_misses};
use genmanip_data::DataError;
use genmanip_rollout::RolloutError;

/// The error behind an error.
pub type Cause = Box<dyn std::error::Error + Send + Sync>;

/// Why a request of a user or a program could not be met; [`RunError::hint`] says what helps.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// A file or folder cannot be read, listed or written.
    #[error("cannot {action} {}", path.display())]
    File {
        /// What was tried: `read`, `list` or `write`.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// What the system or the reader says.
        source: Cause,
        /// What helps.
        hint: Option<String>,
    },
    /// A file is larger than anything of its kind.
    #[error("{} is larger than {} may be: {}", path.display(), limit.what, limit.human_readable())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its kind and bound.
        limit: Limit,
    },
    /// A file is not the versioned document that was expected.
    #[error("{} is no valid {schema} file", path.display())]
    Document {
        /// The file.
        path: PathBuf,
        /// Schema that was expected.
        schema: &'static str,
        /// What it is instead.
        source: DocumentError,
    },
    /// A name that nobody knows.
    #[error("unknown {what} `{got}`")]
    UnknownName {
        /// What it should name, e.g. `policy`.
        what: &'static str,
        /// The plural of that.
        plural: &'static str,
        /// The name.
        got: String,
        /// Known names that look alike, best first.
        near: Vec<String>,
        /// All known names.
        known: Vec<String>,
    },
    /// What the user named is there, but it is not what is needed.
    #[error("{what}")]
    Input {
        /// What is wrong with what.
        what: String,
        /// Why, if another part of the program found it.
        source: Option<Cause>,
        /// What was expected, or what helps.
        hint: Option<String>,
    },
    /// The folder belongs to a run that was started otherwise.
    #[error("{} holds another run ({difference})", path.display())]
    AnotherRun {
        /// The folder.
        path: PathBuf,
        /// The first difference.
        difference: String,
    },
    /// Results or episodes of an evaluation that was started otherwise lie where this one would write.
    #[error("{} holds another evaluation ({difference})", path.display())]
    AnotherEvaluation {
        /// The folder.
        path: PathBuf,
        /// The first difference.
        difference: String,
    },
    /// There is no run in the folder.
    #[error("no run at {}", path.display())]
    NoRun {
        /// The folder.
        path: PathBuf,
    },
    /// A policy that runs elsewhere cannot be reached; what was to be done with it may be tried again.
    #[error("policy {policy} cannot be reached: {reason}")]
    Unreachable {
        /// The policy with its arguments.
        policy: String,
        /// What its end said.
        reason: String,
    },
    /// A stage failed where it should not have: a defect, or something outside that broke.
    #[error("{what}")]
    Broken {
        /// What was being done.
        what: String,
        /// What went wrong.
        source: Option<Cause>,
        /// What helps.
        hint: Option<String>,
    },
}

impl RunError {
    /// [`RunError::File`] without a hint; `action` is `read`, `list` or `write`.
    pub fn file(action: &'static str, path: &Path, source: impl Into<Cause>) -> Self {
        Self::File { action, path: path.to_owned(), source: source.into(), hint: None }
    }

    /// [`RunError::Input`] in one sentence.
    pub fn input(what: impl Into<String>) -> Self {
        Self::Input { what: what.into(), source: None, hint: None }
    }

    /// [`RunError::Broken`] with what went wrong.
    pub fn broken(what: impl Into<String>, error: impl Into<Cause>) -> Self {
        Self::Broken { what: what.into(), source: Some(error.into()), hint: None }
    }

    /// [`RunError::UnknownName`], with those of the known names that look like it.
    pub fn unknown(what: &'static str, plural: &'static str, got: &str, known: &[&str]) -> Self {
        let near = near_misses(got, known);
        Self::UnknownName { what, plural, got: got.into(), near, known: known.iter().map(|&k| k.into()).collect() }
    }

    /// What reading or writing a file came to; `action` is `read` or `write`.
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

    /// With the error behind it; kept only by the kinds that have room for one.
    #[must_use]
    pub fn because(mut self, error: impl Into<Cause>) -> Self {
        match &mut self {
            Self::Input { source, .. } | Self::Broken { source, .. } => *source = Some(error.into()),
            Self::File { source, .. } => *source = error.into(),
            _ => {}
        }
        self
    }

    /// With what helps; the other kinds know that by themselves.
    #[must_use]
    pub fn with_hint(mut self, help: impl Into<String>) -> Self {
        if let Self::File { hint, .. } | Self::Input { hint, .. } | Self::Broken { hint, .. } = &mut self {
            *hint = Some(help.into());
        }
        self
    }

    /// What was expected, or what helps.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::File { source, hint, .. } => of_full_disk(Some(source)).or_else(|| hint.clone()),
            Self::Input { source, hint, .. } | Self::Broken { source, hint, .. } => {
                of_full_disk(source.as_ref()).or_else(|| hint.clone())
            }
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
            Self::Unreachable { .. } => Some("see that it runs, then start again".into()),
            Self::NoRun { .. } => Some("make one with `genmanip collect TASKS --out FOLDER`".into()),
        }
    }
}

/// What helps where a full disk is behind an error.
fn of_full_disk(cause: Option<&Cause>) -> Option<String> {
    let first = cause.map(|cause| &**cause as &(dyn std::error::Error + 'static));
    let is_full = |error: &std::io::Error| matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded);
    std::iter::successors(first, |error| error.source())
        .any(|error| error.downcast_ref::<std::io::Error>().is_some_and(is_full))
        .then(|| "free some space on that disk and start again; what is finished is kept".into())
}

/// Why work on many episodes stopped before its end.
pub enum Stopped {
    /// A file, a service or a setting.
    Run(RunError),
    /// An episode.
    Episode(RolloutError),
}

impl From<RolloutError> for Stopped {
    fn from(error: RolloutError) -> Self {
        Self::Episode(error)
    }
}

impl From<RunError> for Stopped {
    fn from(error: RunError) -> Self {
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
        let given = "start again";
        for (error, expected) in [
            (RunError::broken("cannot draw", deep(ErrorKind::StorageFull)), "free some space"),
            (RunError::broken("cannot draw", deep(ErrorKind::StorageFull)).with_hint(given), "free some space"),
            (RunError::file("write", Path::new("run.json"), io(ErrorKind::QuotaExceeded)), "free some space"),
            (RunError::broken("cannot draw", deep(ErrorKind::PermissionDenied)).with_hint(given), given),
        ] {
            assert!(error.hint().unwrap().contains(expected), "{error}: {:?}", error.hint());
        }
        assert_eq!(RunError::broken("cannot draw", deep(ErrorKind::PermissionDenied)).hint(), None);
    }

    #[test]
    fn names_that_look_alike_are_offered() {
        let known = ["expert", "replay", "do_nothing"];
        let error = RunError::unknown("policy", "policies", "expret", &known);
        assert_eq!(error.to_string(), "unknown policy `expret`");
        let hint = "did you mean `expert`? policies are expert, replay, do_nothing";
        assert_eq!(error.hint().as_deref(), Some(hint));
    }
}
