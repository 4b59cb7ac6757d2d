//! Requests: bodies received within bounds, computations on threads of their own.

use std::sync::Arc;
use std::time::Duration;

use axum::body::to_bytes;
use axum::extract::Request;
use axum::response::{IntoResponse, Response};
use serde::de::DeserializeOwned;

use super::answer::{Refusal, not_found};
use super::studio::Studio;

/// Largest body of a request, bytes: many times the largest command.
pub const MAX_BODY: usize = 1 << 20;
/// Most that is read of a body: closed before its end, the connection would be reset and the answer lost.
const MAX_READ: usize = 4 * MAX_BODY;
/// Time-out for receiving a body.
const RECEIVE: Duration = Duration::from_secs(30);

/// Receives a JSON body.
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

/// Runs a computation on its own thread when one is free; a panic costs one answer, not the server.
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
