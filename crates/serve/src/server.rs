//! HTTP around an offer.

use std::future::IntoFuture;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::extract::{Path, Query, Request, State};
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::json;
use tokio::runtime::{self, Runtime};
use tokio::sync::{Semaphore, oneshot};

use crate::jobs::{Ended, Jobs, MAX_OPEN, MAX_WAIT_S};
use crate::offer::Work;
use crate::refusal::Refusal;
use crate::{Offer, openapi};

/// How long a request may take to arrive; 64 MiB over a slow local network need less.
const ARRIVAL: Duration = Duration::from_secs(60);

/// How a service is offered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServeSettings {
    /// Where to listen; port 0 takes a free one. Nobody is asked who they are, so keep to this machine.
    pub address: SocketAddr,
    /// Largest request that is read, bytes.
    pub max_request_bytes: usize,
    /// Requests that are computed at once; others wait.
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

/// Why nothing is offered.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The address cannot be had.
    #[error("cannot listen at {address}: {message}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        message: String,
    },
}

/// A service that is offered until it is dropped.
pub struct Server {
    address: SocketAddr,
    /// Tells the service to take no further request.
    stop: Option<oneshot::Sender<()>>,
    serving: Option<std::thread::JoinHandle<()>>,
}

/// What every request is answered with.
struct Shared {
    offer: Offer,
    max_request_bytes: usize,
    at_once: Semaphore,
    jobs: Jobs,
}

impl Server {
    /// Listens and answers on threads of its own.
    ///
    /// # Errors
    /// When the address cannot be had.
    pub fn start(offer: Offer, settings: &ServeSettings) -> Result<Self, ServeError> {
        let listen =
            |error: std::io::Error| ServeError::Listen { address: settings.address, message: error.to_string() };
        let socket = TcpListener::bind(settings.address).map_err(listen)?;
        socket.set_nonblocking(true).map_err(listen)?;
        let address = socket.local_addr().map_err(listen)?;
        // One thread for connections; what is computed has threads of its own, no more than `workers` at once.
        let runtime: Runtime =
            runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().map_err(listen)?;
        let socket = {
            let _inside = runtime.enter();
            tokio::net::TcpListener::from_std(socket).map_err(listen)?
        };
        let workers = settings.workers.max(1);
        let shared = Arc::new(Shared {
            offer,
            max_request_bytes: settings.max_request_bytes,
            at_once: Semaphore::new(workers),
            jobs: Jobs::default(),
        });
        let (stop, stopped) = oneshot::channel::<()>();
        let service = axum::serve(socket, router(shared)).with_graceful_shutdown(async {
            let _ = stopped.await;
        });
        let serving = std::thread::spawn(move || {
            // Only a listener that is gone ends it with an error, and then there is nobody to tell.
            let _ = runtime.block_on(service.into_future());
        });
        Ok(Self { address, stop: Some(stop), serving: Some(serving) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Waits for as long as it answers.
    pub fn wait(mut self) {
        if let Some(serving) = self.serving.take() {
            let _ = serving.join();
        }
    }
}

impl Drop for Server {
    /// Finishes what is being answered.
    fn drop(&mut self) {
        if let Some(stop) = self.stop.take() {
            let _ = stop.send(());
        }
        if let Some(serving) = self.serving.take() {
            let _ = serving.join();
        }
    }
}

fn router(shared: Arc<Shared>) -> Router {
    let (path, name) = (shared.offer.path(), shared.offer.name());
    let health = move || async move { Json(json!({"service": name, "version": env!("CARGO_PKG_VERSION")})) };
    let description = openapi(&shared.offer);
    let described = move || async move { Json(description) };
    let wrong_method = |request: Request| async move {
        refused(StatusCode::METHOD_NOT_ALLOWED, format!("{} is not asked like this; see /openapi.json", request.uri()))
    };
    let nothing_here = move || async move {
        refused(StatusCode::NOT_FOUND, format!("there is only {path}, /health and /openapi.json"))
    };
    let asked = match &shared.offer {
        Offer::Agent(_) => Router::new()
            .route(path, post(begin_job))
            .route(&format!("{path}/jobs/{{job}}"), get(see_job))
            .route(&format!("{path}/jobs/{{job}}/pictures/{{name}}"), get(see_picture)),
        Offer::Segment(_) | Offer::Grasp(_) | Offer::Env(_) => Router::new().route(path, post(answer)),
    };
    asked
        .route("/health", get(health))
        .route("/openapi.json", get(described))
        .method_not_allowed_fallback(wrong_method)
        .fallback(nothing_here)
        .with_state(shared)
}

/// Computes the answer while the connection waits.
async fn answer(State(shared): State<Arc<Shared>>, request: Request) -> Response {
    let body = match arrived(request, shared.max_request_bytes).await {
        Ok(body) => body,
        Err(response) => return response,
    };
    let computing = Arc::clone(&shared);
    match computed(&shared, move || computing.offer.answer(&body)).await {
        Ok(Ok(bytes)) => ([(CONTENT_TYPE, shared.offer.media_type())], bytes).into_response(),
        Ok(Err(refusal)) => refusal.into_response(),
        Err(message) => refused(StatusCode::INTERNAL_SERVER_ERROR, message),
    }
}

/// Checks the question, begins a job with it and says where to ask about it.
async fn begin_job(State(shared): State<Arc<Shared>>, request: Request) -> Response {
    let body = match arrived(request, shared.max_request_bytes).await {
        Ok(body) => body,
        Err(response) => return response,
    };
    let work: Work = match shared.offer.work(&body) {
        Ok(work) => work,
        Err(refusal) => return refusal.into_response(),
    };
    let Some(number) = shared.jobs.begin() else {
        let message = format!("{MAX_OPEN} jobs are open; ask again when one of them has ended");
        return refused(StatusCode::SERVICE_UNAVAILABLE, message);
    };
    let state = format!("{}/jobs/{number}", shared.offer.path());
    tokio::spawn(async move {
        let starting = Arc::clone(&shared);
        let ended = computed(&shared, move || {
            starting.jobs.running(number);
            work()
        });
        let ended = ended.await.unwrap_or_else(|error| Ended { error: Some(error), ..Ended::default() });
        shared.jobs.end(number, ended);
    });
    (StatusCode::ACCEPTED, Json(json!({"job": number.to_string(), "state_at": state}))).into_response()
}

/// How long to wait for the end of a job.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Patience {
    #[serde(default)]
    wait_s: f64,
}

async fn see_job(
    State(shared): State<Arc<Shared>>,
    Path(job): Path<String>,
    patience: Result<Query<Patience>, axum::extract::rejection::QueryRejection>,
) -> Response {
    let wait_s = match patience {
        Ok(Query(Patience { wait_s })) if (0.0..=MAX_WAIT_S).contains(&wait_s) => wait_s,
        _ => return refused(StatusCode::BAD_REQUEST, format!("expected at most wait_s, 0 to {MAX_WAIT_S}")),
    };
    let seen = match job.parse() {
        Ok(number) => shared.jobs.view(number, Duration::from_secs_f64(wait_s)).await,
        Err(_) => None,
    };
    seen.map_or_else(|| refused(StatusCode::NOT_FOUND, unknown_job(&job)), |view| Json(view).into_response())
}

async fn see_picture(State(shared): State<Arc<Shared>>, Path((job, name)): Path<(String, String)>) -> Response {
    let png = job.parse().ok().and_then(|number| shared.jobs.picture(number, &name));
    match png {
        Some(png) => ([(CONTENT_TYPE, "image/png")], png.as_ref().clone()).into_response(),
        None => refused(StatusCode::NOT_FOUND, format!("no such picture, or {}", unknown_job(&job))),
    }
}

fn unknown_job(job: &str) -> String {
    let job: String = job.chars().take(20).collect();
    format!("no job {job}: it was never begun, or {} later ones have ended since", crate::jobs::MAX_ENDED)
}

/// The body, once all of it is there.
async fn arrived(request: Request, limit: usize) -> Result<Vec<u8>, Response> {
    let too_large = || refused(StatusCode::PAYLOAD_TOO_LARGE, format!("larger than {limit} bytes"));
    let announced = |headers: &HeaderMap| headers.get(CONTENT_LENGTH)?.to_str().ok()?.parse::<usize>().ok();
    if announced(request.headers()).is_some_and(|length| length > limit) {
        return Err(too_large());
    }
    let body: Body = request.into_body();
    match tokio::time::timeout(ARRIVAL, to_bytes(body, limit)).await {
        Ok(Ok(bytes)) => Ok(bytes.into()),
        Ok(Err(error)) => match error.to_string().contains("length limit") {
            true => Err(too_large()),
            false => Err(refused(StatusCode::BAD_REQUEST, format!("the request ended early: {error}"))),
        },
        Err(_) => Err(refused(StatusCode::REQUEST_TIMEOUT, format!("it did not arrive within {ARRIVAL:?}"))),
    }
}

/// Computes on a thread of its own when it is its turn; a defect costs one answer, not the server.
async fn computed<T: Send + 'static>(shared: &Shared, work: impl FnOnce() -> T + Send + 'static) -> Result<T, String> {
    let _turn = shared.at_once.acquire().await.map_err(|_| "the server is ending".to_owned())?;
    let done = tokio::task::spawn_blocking(work).await;
    done.map_err(|_| "the computation failed, which is a defect".to_owned())
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        match self {
            Self::Malformed(message) => refused(StatusCode::BAD_REQUEST, message),
            Self::Unsuited(message) => refused(StatusCode::UNPROCESSABLE_ENTITY, message),
        }
    }
}

fn refused(status: StatusCode, message: String) -> Response {
    (status, Json(json!({"error": {"message": message}}))).into_response()
}
