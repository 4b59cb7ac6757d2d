//! What can be wrong with a file that should be a document.

/// Why a text is not the document it should be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DocumentError {
    /// Not JSON at all.
    #[error("not JSON: {message}")]
    NotJson {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What the parser says, position included.
        message: String,
        /// What most likely is wrong.
        hint: &'static str,
    },
    /// Another kind or version of document.
    #[error("expected schema \"{expected}\", got {got}")]
    WrongSchema {
        /// The schema that can be read.
        expected: String,
        /// What the file says.
        got: String,
    },
    /// A value that does not fit.
    #[error("at {path}: {message}")]
    Invalid {
        /// JSON path, e.g. `$.objects[2].pose`.
        path: String,
        /// What was expected.
        message: String,
    },
}
