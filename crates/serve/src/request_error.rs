//! Errors of requests.

/// Error of a request.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum RequestError {
    /// The request does not match the API description.
    Malformed(String),
    /// The request is valid but cannot be processed.
    Unsuited(String),
}
