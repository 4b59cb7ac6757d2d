//! HTTP requests: size and time limits of bodies, and computations outside the async threads.

use std::sync::Arc;
use std::time::Duration;

use axum::body::to_bytes;
use axum::extract::Request;
use axum::response::{IntoResponse, Response};
use serde::de::DeserializeOwned;

use super::answer::{Refusal, not_found};
use super::studio::Studio;

/// Maximum size of a request's body, bytes: many times the largest command.
pub const MAX_BODY: usize = 1 << 20;
/// Size up to which a body above [`MAX_BODY`] is still received, bytes. If the connection were closed earlier, it would
/// be reset and the client would not receive the response.
const MAX_READ: usize = 4 * MAX_BODY;
/// Timeout for receiving a body.
const RECEIVE: Duration = Duration::from_secs(30);

/// Receives a request's body and parses it as JSON.
///
/// # Errors
/// [`Refusal::Unsuited`] if it is too large, does not arrive within 30 s, or is not JSON of this type.
pub async fn body<T: DeserializeOwned>(request: Request) -> Result<T, Refusal> {
    let received = tokio::time::timeout(RECEIVE, to_bytes(request.into_body(), MAX_READ)).await;
    let too_large =
        || Refusal::unsuited(format!("the request was not received, or is larger than {MAX_BODY} bytes"), "");
    let bytes = received.map_err(|_| too_large())?.map_err(|_| too_large())?;
    if bytes.len() > MAX_BODY {
        return Err(too_large());
    }
    serde_json::from_slice(&bytes)
        .map_err(|error| Refusal::unsuited(format!("the request cannot be read: {error}"), ""))
}

/// Runs a computation on a blocking thread as soon as a permit is free; a panic fails only this request.
pub async fn work(
    studio: &Arc<Studio>,
    compute: impl FnOnce(&Studio) -> Result<Response, Refusal> + Send + 'static,
) -> Response {
    let Ok(_turn) = studio.permits.acquire().await else { return not_found("the server is shutting down") };
    let own = Arc::clone(studio);
    match tokio::task::spawn_blocking(move || compute(&own)).await {
        Ok(answer) => answer.unwrap_or_else(IntoResponse::into_response),
        Err(_) => Refusal::Stopped {
            message: "the computation panicked; please report this bug".into(),
            hint: "the scenario's log has every acknowledged edit".into(),
        }
        .into_response(),
    }
}
