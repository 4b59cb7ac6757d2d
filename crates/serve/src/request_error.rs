//! Errors of requests to an endpoint.

/// Reason why an endpoint cannot process a request.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum RequestError {
    /// The request does not match the API description.
    #[error("{0}")]
    Malformed(String),
    /// The request is valid but cannot be processed.
    #[error("{0}")]
    Unsuited(String),
}
