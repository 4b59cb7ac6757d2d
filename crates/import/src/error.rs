//! Import errors.

/// Reason why a file cannot be imported, with a hint.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {message}")]
pub struct ImportError {
    /// Path of the file relative to the root of the import.
    pub file: String,
    /// Expected and actual contents, with their position.
    pub message: String,
    /// Suggested fix; empty if there is none.
    pub hint: String,
}

impl ImportError {
    /// An error in a file.
    pub fn new(file: impl Into<String>, message: impl Into<String>) -> Self {
        Self { file: file.into(), message: message.into(), hint: String::new() }
    }

    /// Adds a suggested fix.
    #[must_use]
    pub fn hint(self, hint: impl Into<String>) -> Self {
        Self { hint: hint.into(), ..self }
    }
}
