//! A broken rule.

/// One broken rule.
#[derive(Debug, PartialEq)]
pub struct Violation {
    /// Path from the root, with a line where there is one.
    pub place: String,
    pub what: String,
    pub hint: String,
}
