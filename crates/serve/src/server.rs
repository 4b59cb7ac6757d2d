//! HTTP around an offer: a few threads that each take one request after the other.

use std::io::{Cursor, Read};
use std::net::SocketAddr;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::thread::JoinHandle;

use serde_json::{Value, json};
use tiny_http::{Header, Method, Request, Response};

use crate::offer::Refusal;
use crate::{Offer, openapi};

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
    http: Arc<tiny_http::Server>,
    workers: Vec<JoinHandle<()>>,
}

/// What is answered: status and JSON.
type Answer = (u16, Vec<u8>);

impl Server {
    /// Listens and answers on threads of its own.
    ///
    /// # Errors
    /// When the address cannot be had.
    pub fn start(offer: Offer, settings: &ServeSettings) -> Result<Self, ServeError> {
        let address = settings.address;
        let listen = |message: String| ServeError::Listen { address, message };
        let http = tiny_http::Server::http(address).map_err(|error| listen(error.to_string()))?;
        let address = http.server_addr().to_ip().ok_or_else(|| listen("no IP address".into()))?;
        let (http, offer, limit) = (Arc::new(http), Arc::new(offer), settings.max_request_bytes);
        let work = || {
            let (http, offer) = (Arc::clone(&http), Arc::clone(&offer));
            std::thread::spawn(move || {
                while let Ok(mut request) = http.recv() {
                    let answer = answer(&offer, &mut request, limit);
                    respond(request, answer);
                }
            })
        };
        let workers = (0..settings.workers.max(1)).map(|_| work()).collect();
        Ok(Self { address, http, workers })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Waits for as long as it answers.
    pub fn wait(mut self) {
        for worker in self.workers.drain(..) {
            let _ = worker.join();
        }
    }
}

impl Drop for Server {
    /// Finishes what is being answered.
    fn drop(&mut self) {
        for _ in &self.workers {
            self.http.unblock();
        }
        for worker in self.workers.drain(..) {
            let _ = worker.join();
        }
    }
}

fn answer(offer: &Offer, request: &mut Request, limit: usize) -> Answer {
    let path = request.url().split('?').next().unwrap_or_default().to_owned();
    match (request.method(), path.as_str()) {
        (Method::Get, "/health") => {
            written(200, &json!({"service": offer.name(), "version": env!("CARGO_PKG_VERSION")}))
        }
        (Method::Get, "/openapi.json") => written(200, &openapi(offer)),
        (Method::Post, path) if path == offer.path() => computed(offer, request, limit),
        (_, path) if ["/health", "/openapi.json", offer.path()].contains(&path) => {
            refused(405, &format!("{path} is not asked like this; see /openapi.json"))
        }
        _ => refused(404, &format!("there is only {}, /health and /openapi.json", offer.path())),
    }
}

fn computed(offer: &Offer, request: &mut Request, limit: usize) -> Answer {
    let too_large = || refused(413, &format!("larger than {limit} bytes"));
    if request.body_length().is_some_and(|length| length > limit) {
        return too_large();
    }
    let mut body = Vec::new();
    if let Err(error) = request.as_reader().take(limit as u64 + 1).read_to_end(&mut body) {
        return refused(400, &format!("the request ended early: {error}"));
    }
    if body.len() > limit {
        return too_large();
    }
    // A defect costs one answer, not the server.
    match std::panic::catch_unwind(AssertUnwindSafe(|| offer.answer(&body))) {
        Ok(Ok(bytes)) => (200, bytes),
        Ok(Err(Refusal::Malformed(message))) => refused(400, &message),
        Ok(Err(Refusal::Unsuited(message))) => refused(422, &message),
        Err(_) => refused(500, "the computation failed, which is a defect"),
    }
}

fn refused(status: u16, message: &str) -> Answer {
    written(status, &json!({"error": {"message": message}}))
}

fn written(status: u16, value: &Value) -> Answer {
    (status, value.to_string().into_bytes())
}

fn respond(request: Request, (status, body): Answer) {
    let length = Some(body.len());
    let headers = Header::from_bytes("content-type", "application/json").into_iter().collect();
    // Whoever asked may be gone, which is no fault of the server.
    let _ = request.respond(Response::new(status.into(), headers, Cursor::new(body), length, None));
}
