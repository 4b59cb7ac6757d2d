//! HTTP server of the studio: the web page, the API, and one WebSocket per browser tab.

mod access;
mod answer;
mod api;
mod catalogue;
mod jobs;
mod making;
mod page;
mod questions;
mod requests;
mod review_desk;
mod reviews;
mod room;
mod runs;
mod settings;
mod socket;
mod studio;
mod teleop;

use std::sync::Arc;

use axum::extract::Request;
use axum::http::StatusCode;
use axum::http::header::{CONTENT_TYPE, HeaderValue, SET_COOKIE, X_CONTENT_TYPE_OPTIONS};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::{Json, Router};
use genmanip_serve::{ServeError, Server, browser_guard};
use serde_json::json;

pub use access::Token;
pub use settings::StudioSettings;

use crate::collections::Collection;
use studio::Studio;

/// Starts the server for a collection of scenarios on its own threads; it stops when the result is dropped.
///
/// # Errors
/// When the address is unavailable.
pub fn start(collection: Collection, settings: StudioSettings) -> Result<Server, ServeError> {
    let address = settings.address;
    let studio = Arc::new(Studio::new(collection, settings));
    Server::of(address, |address| router(studio, address.ip().is_loopback()))
}

fn router(studio: Arc<Studio>, listens_on_loopback: bool) -> Router {
    let guarded = Arc::clone(&studio);
    api::routes()
        .merge(reviews::routes())
        .merge(making::routes())
        .merge(runs::routes())
        .merge(questions::routes())
        .route("/api/socket", axum::routing::get(socket::connect))
        .route("/api/teleop", axum::routing::get(teleop::connect))
        .fallback(page::file)
        .layer(middleware::from_fn(move |request: Request, next: Next| {
            let studio = Arc::clone(&guarded);
            async move { guard(&studio, listens_on_loopback, request, next).await }
        }))
        .with_state(studio)
}

/// Middleware: refuses requests from other sites and requests without the token, and sets security and cache headers of
/// the response.
async fn guard(studio: &Studio, listens_on_loopback: bool, request: Request, next: Next) -> Response {
    let refused = |status: StatusCode, message: &str, hint: &str| {
        (status, Json(json!({ "error": { "message": message, "hint": hint } }))).into_response()
    };
    if let Some(reason) = browser_guard::refusal(request.headers(), listens_on_loopback) {
        return refused(StatusCode::FORBIDDEN, &reason, "");
    }
    let mut cookie = None;
    if let Some(token) = &studio.token {
        if !token.is_held(request.headers(), request.uri()) {
            let hint = "open the whole address that `genmanip studio` printed, with ?token=…";
            return refused(StatusCode::UNAUTHORIZED, "this studio demands its token", hint);
        }
        cookie = token.is_in_address(request.uri()).then(|| token.cookie());
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    if headers.get(CONTENT_TYPE).is_some_and(|kind| kind == "application/json") {
        headers.insert(axum::http::header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
    if let Some(cookie) = cookie.and_then(|cookie| HeaderValue::from_str(&cookie).ok()) {
        headers.insert(SET_COOKIE, cookie);
    }
    response
}
