//! Why a file cannot be imported.

/// One clear error: which file, what is wrong there, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {message}")]
pub struct ImportError {
    /// The file, relative to the root of the import.
    pub file: String,
    /// What was expected and what was found, with its place.
    pub message: String,
    /// What to do about it; empty where nothing can be said.
    pub hint: String,
}

impl ImportError {
    /// Of a file.
    pub fn new(file: impl Into<String>, message: impl Into<String>) -> Self {
        Self { file: file.into(), message: message.into(), hint: String::new() }
    }

    /// With what to do about it.
    #[must_use]
    pub fn hint(self, hint: impl Into<String>) -> Self {
        Self { hint: hint.into(), ..self }
    }
}
