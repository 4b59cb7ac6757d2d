//! Requests that are not answered.

/// A request that gets no answer.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// It is not what is described.
    Malformed(String),
    /// It is, but nothing can be computed from it.
    Unsuited(String),
}
