//! HTTP server of an endpoint.

use std::future::IntoFuture;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::extract::{Path, Query, Request, State};
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::{HeaderMap, StatusCode};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::json;
use tokio::runtime::{self, Runtime};
use tokio::sync::{Semaphore, oneshot};

use crate::browser_guard;
use crate::endpoint::Work;
use crate::jobs::{Ended, Jobs, MAX_OPEN, MAX_WAIT_S};
use crate::request_error::RequestError;
use crate::{Endpoint, openapi};

/// Timeout for receiving a request; 64 MiB arrive earlier even over a slow local network.
const RECEIVE_TIMEOUT: Duration = Duration::from_secs(60);

/// Address and limits of a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServeSettings {
    /// Listening address; port 0 picks a free one. Use a loopback address, since there is no authentication.
    pub address: SocketAddr,
    /// Maximum request size in bytes.
    pub max_request_bytes: usize,
    /// Maximum number of concurrent computations; further ones wait.
    pub workers: usize,
}

impl Default for ServeSettings {
    fn default() -> Self {
        Self {
            address: SocketAddr::from(([127, 0, 0, 1], 8091)),
            max_request_bytes: 64 << 20, // as the client sends at most
            workers: std::thread::available_parallelism().map_or(1, usize::from),
        }
    }
}

/// Error of starting the server.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The address is unavailable.
    #[error("cannot listen at {address}: {message}")]
    Listen {
        /// Requested address.
        address: SocketAddr,
        /// Message of the operating system.
        message: String,
    },
}

/// A running server, stopped on drop.
pub struct Server {
    address: SocketAddr,
    /// Signals graceful shutdown.
    stop: Option<oneshot::Sender<()>>,
    serving: Option<std::thread::JoinHandle<()>>,
}

/// State shared by the request handlers.
struct Shared {
    endpoint: Endpoint,
    max_request_bytes: usize,
    worker_permits: Semaphore,
    jobs: Jobs,
}

impl Server {
    /// Starts the server on threads of its own.
    ///
    /// # Errors
    /// Fails if the address is unavailable.
    pub fn start(endpoint: Endpoint, settings: &ServeSettings) -> Result<Self, ServeError> {
        let shared = Arc::new(Shared {
            endpoint,
            max_request_bytes: settings.max_request_bytes,
            worker_permits: Semaphore::new(settings.workers.max(1)),
            jobs: Jobs::default(),
        });
        Self::of(settings.address, |address| router(shared, address.ip().is_loopback()))
    }

    /// Starts a server with these routes on threads of its own. `routes` is called with the address that it listens on.
    ///
    /// # Errors
    /// Fails if the address is unavailable.
    pub fn of(address: SocketAddr, routes: impl FnOnce(SocketAddr) -> Router) -> Result<Self, ServeError> {
        let listen = |error: std::io::Error| ServeError::Listen { address, message: error.to_string() };
        let socket = TcpListener::bind(address).map_err(listen)?;
        socket.set_nonblocking(true).map_err(listen)?;
        let address = socket.local_addr().map_err(listen)?;
        // One thread serves all connections; computations run on blocking threads.
        let runtime: Runtime =
            runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().map_err(listen)?;
        let socket = {
            let _inside = runtime.enter();
            tokio::net::TcpListener::from_std(socket).map_err(listen)?
        };
        let (stop, stopped) = oneshot::channel::<()>();
        let service = axum::serve(socket, routes(address)).with_graceful_shutdown(async {
            let _ = stopped.await;
        });
        let serving = std::thread::spawn(move || {
            // Only a broken listener causes an error, which cannot be reported to anybody.
            let _ = runtime.block_on(service.into_future());
        });
        Ok(Self { address, stop: Some(stop), serving: Some(serving) })
    }

    /// Address that the server listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Blocks until the server stops.
    pub fn wait(mut self) {
        if let Some(serving) = self.serving.take() {
            let _ = serving.join();
        }
    }
}

impl Drop for Server {
    /// Finishes pending requests, then stops the server.
    fn drop(&mut self) {
        if let Some(stop) = self.stop.take() {
            let _ = stop.send(());
        }
        if let Some(serving) = self.serving.take() {
            let _ = serving.join();
        }
    }
}

fn router(shared: Arc<Shared>, listens_on_loopback: bool) -> Router {
    let (path, name) = (shared.endpoint.path(), shared.endpoint.name());
    let health = move || async move { Json(json!({"service": name, "version": env!("CARGO_PKG_VERSION")})) };
    let description = openapi(&shared.endpoint);
    let described = move || async move { Json(description) };
    let wrong_method = |request: Request| async move {
        error_response(StatusCode::METHOD_NOT_ALLOWED, format!("wrong method for {}; see /openapi.json", request.uri()))
    };
    let nothing_here = move || async move {
        error_response(StatusCode::NOT_FOUND, format!("unknown path; available: {path}, /health and /openapi.json"))
    };
    let asked = match &shared.endpoint {
        Endpoint::Agent(_) => Router::new()
            .route(path, post(begin_job))
            .route(&format!("{path}/jobs/{{job}}"), get(see_job))
            .route(&format!("{path}/jobs/{{job}}/pictures/{{name}}"), get(see_picture)),
        Endpoint::Segment(_) | Endpoint::Grasp(_) | Endpoint::Env(_) => Router::new().route(path, post(answer)),
    };
    asked
        .route("/health", get(health))
        .route("/openapi.json", get(described))
        .method_not_allowed_fallback(wrong_method)
        .fallback(nothing_here)
        .layer(middleware::from_fn(move |request: Request, next: Next| async move {
            match browser_guard::refusal(request.headers(), listens_on_loopback) {
                Some(reason) => error_response(StatusCode::FORBIDDEN, reason),
                None => next.run(request).await,
            }
        }))
        .with_state(shared)
}

/// Handles a synchronous request.
async fn answer(State(shared): State<Arc<Shared>>, request: Request) -> Response {
    let body = match receive_body(request, shared.max_request_bytes).await {
        Ok(body) => body,
        Err(response) => return response,
    };
    let computing = Arc::clone(&shared);
    match compute(&shared, move || computing.endpoint.answer(&body)).await {
        Ok(Ok(bytes)) => ([(CONTENT_TYPE, shared.endpoint.media_type())], bytes).into_response(),
        Ok(Err(request_error)) => request_error.into_response(),
        Err(message) => error_response(StatusCode::INTERNAL_SERVER_ERROR, message),
    }
}

/// Validates a request and starts its job; the response names the URL to poll.
async fn begin_job(State(shared): State<Arc<Shared>>, request: Request) -> Response {
    let body = match receive_body(request, shared.max_request_bytes).await {
        Ok(body) => body,
        Err(response) => return response,
    };
    let work: Work = match shared.endpoint.work(&body) {
        Ok(work) => work,
        Err(request_error) => return request_error.into_response(),
    };
    let Some(number) = shared.jobs.begin() else {
        let message = format!("{MAX_OPEN} jobs are open; retry when one of them has ended");
        return error_response(StatusCode::SERVICE_UNAVAILABLE, message);
    };
    let state = format!("{}/jobs/{number}", shared.endpoint.path());
    tokio::spawn(async move {
        let starting = Arc::clone(&shared);
        let ended = compute(&shared, move || {
            starting.jobs.running(number);
            work()
        });
        let ended = ended.await.unwrap_or_else(|error| Ended { error: Some(error), ..Ended::default() });
        shared.jobs.end(number, ended);
    });
    (StatusCode::ACCEPTED, Json(json!({"job": number.to_string(), "state_at": state}))).into_response()
}

/// Query of a poll.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WaitQuery {
    #[serde(default)]
    wait_s: f64,
}

async fn see_job(
    State(shared): State<Arc<Shared>>,
    Path(job): Path<String>,
    query: Result<Query<WaitQuery>, axum::extract::rejection::QueryRejection>,
) -> Response {
    let wait_s = match query {
        Ok(Query(WaitQuery { wait_s })) if (0.0..=MAX_WAIT_S).contains(&wait_s) => wait_s,
        _ => return error_response(StatusCode::BAD_REQUEST, format!("expected only wait_s, from 0 to {MAX_WAIT_S}")),
    };
    let seen = match job.parse() {
        Ok(number) => shared.jobs.view(number, Duration::from_secs_f64(wait_s)).await,
        Err(_) => None,
    };
    seen.map_or_else(|| error_response(StatusCode::NOT_FOUND, unknown_job(&job)), |view| Json(view).into_response())
}

async fn see_picture(State(shared): State<Arc<Shared>>, Path((job, name)): Path<(String, String)>) -> Response {
    let png = job.parse().ok().and_then(|number| shared.jobs.picture(number, &name));
    match png {
        Some(png) => ([(CONTENT_TYPE, "image/png")], png.as_ref().clone()).into_response(),
        None => error_response(StatusCode::NOT_FOUND, format!("no such image, or {}", unknown_job(&job))),
    }
}

fn unknown_job(job: &str) -> String {
    let job: String = job.chars().take(20).collect();
    format!("no job {job}: it is unknown, or {} later ones have ended since", crate::jobs::MAX_ENDED)
}

/// Receives the whole body of a request, up to `limit` bytes.
async fn receive_body(request: Request, limit: usize) -> Result<Vec<u8>, Response> {
    let too_large = || error_response(StatusCode::PAYLOAD_TOO_LARGE, format!("larger than {limit} bytes"));
    let announced = |headers: &HeaderMap| headers.get(CONTENT_LENGTH)?.to_str().ok()?.parse::<usize>().ok();
    if announced(request.headers()).is_some_and(|length| length > limit) {
        return Err(too_large());
    }
    let body: Body = request.into_body();
    match tokio::time::timeout(RECEIVE_TIMEOUT, to_bytes(body, limit)).await {
        Ok(Ok(bytes)) => Ok(bytes.into()),
        Ok(Err(error)) => match error.to_string().contains("length limit") {
            true => Err(too_large()),
            false => Err(error_response(StatusCode::BAD_REQUEST, format!("the request ended early: {error}"))),
        },
        Err(_) => {
            Err(error_response(StatusCode::REQUEST_TIMEOUT, format!("it was not received within {RECEIVE_TIMEOUT:?}")))
        }
    }
}

/// Runs a computation on a blocking thread as soon as a worker is free; a panic fails only this request.
async fn compute<T: Send + 'static>(shared: &Shared, work: impl FnOnce() -> T + Send + 'static) -> Result<T, String> {
    let _turn = shared.worker_permits.acquire().await.map_err(|_| "the server is shutting down".to_owned())?;
    let done = tokio::task::spawn_blocking(work).await;
    done.map_err(|_| "the computation panicked; please report this bug".to_owned())
}

impl IntoResponse for RequestError {
    fn into_response(self) -> Response {
        match self {
            Self::Malformed(message) => error_response(StatusCode::BAD_REQUEST, message),
            Self::Unsuited(message) => error_response(StatusCode::UNPROCESSABLE_ENTITY, message),
        }
    }
}

fn error_response(status: StatusCode, message: String) -> Response {
    (status, Json(json!({"error": {"message": message}}))).into_response()
}
