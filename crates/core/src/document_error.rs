//! Errors of reading versioned documents.

/// Reason why a text is not the expected document.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DocumentError {
    /// The text is not valid JSON.
    #[error("not JSON: {message}")]
    NotJson {
        /// Line of the error, from 1.
        line: usize,
        /// Column of the error, from 1.
        column: usize,
        /// The parser's message, including the position.
        message: String,
        /// Likely cause or fix.
        hint: &'static str,
    },
    /// Unsupported schema name or version.
    #[error("expected schema \"{expected}\", got {got}")]
    WrongSchema {
        /// Name and version of the schema that this program reads.
        expected: String,
        /// Name and version in the file.
        got: String,
    },
    /// A value that has the wrong type or violates a constraint.
    #[error("at {path}: {message}")]
    Invalid {
        /// JSON path, e.g. `$.objects[2].pose`.
        path: String,
        /// Description of the violation.
        message: String,
    },
}
