//! Server of a policy with openpi's protocol: WebSocket connections, each alternating observations and action chunks.

use std::fmt;
use std::io::{self, Read};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use genmanip_core::{EpisodeStart, Policy, PolicySpec, Seed};
use genmanip_remote_policies::{decode, served, wire};
use rmpv::Value;
use tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tungstenite::http::StatusCode;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::protocol::{CloseFrame, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket, accept_hdr_with_config};

use crate::browser_guard;
use crate::server::{ServeError, ServeSettings};

/// Maximum number of open connections; further ones are closed.
const MAX_CONNECTIONS: usize = 64;
/// Timeout of the handshake and of sending a response.
const HANDSHAKE: Duration = Duration::from_secs(10);
/// Maximum number of bytes read and discarded after a refused request.
const MAX_READ_PAST: u64 = 64 << 20;
/// Idle time after which a connection is closed.
const IDLE: Duration = Duration::from_secs(600);

/// Policy to serve; every connection gets a policy of its own.
#[derive(Clone)]
pub struct PolicyEndpoint {
    /// Name of the robot.
    pub robot: String,
    /// Number of joints of the robot's arm.
    pub arm_dof: usize,
    /// Observations and actions of the policy; no simulator ground truth.
    pub spec: PolicySpec,
    /// Factory of policies whose actions depend only on instruction and observation, since the protocol has no
    /// episodes.
    pub make: Arc<dyn Fn() -> Box<dyn Policy> + Send + Sync>,
}

impl fmt::Debug for PolicyEndpoint {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("PolicyEndpoint").field("robot", &self.robot).field("spec", &self.spec).finish_non_exhaustive()
    }
}

/// A running policy server. It stops accepting connections on drop; open ones last until the program ends.
pub struct PolicyServer {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    serving: Option<std::thread::JoinHandle<()>>,
}

/// State shared by all connections.
struct Shared {
    endpoint: PolicyEndpoint,
    max_request_bytes: usize,
    listens_on_loopback: bool,
    workers: Workers,
}

impl PolicyServer {
    /// Starts the server on threads of its own.
    ///
    /// # Errors
    /// Fails if the address is unavailable.
    pub fn start(endpoint: PolicyEndpoint, settings: &ServeSettings) -> Result<Self, ServeError> {
        let listen = |error: io::Error| ServeError::Listen { address: settings.address, message: error.to_string() };
        let listener = TcpListener::bind(settings.address).map_err(listen)?;
        let address = listener.local_addr().map_err(listen)?;
        let stop = Arc::new(AtomicBool::new(false));
        let shared = Arc::new(Shared {
            endpoint,
            max_request_bytes: settings.max_request_bytes,
            listens_on_loopback: address.ip().is_loopback(),
            workers: Workers { free: Mutex::new(settings.workers.max(1)), freed: Condvar::new() },
        });
        let stopped = Arc::clone(&stop);
        let serving = std::thread::spawn(move || {
            for stream in listener.incoming() {
                if stopped.load(Ordering::Relaxed) {
                    return;
                }
                // One reference is held by this loop itself.
                if let (Ok(stream), 1..=MAX_CONNECTIONS) = (stream, Arc::strong_count(&shared)) {
                    let shared = Arc::clone(&shared);
                    let thread = std::thread::Builder::new().name("serving".into());
                    drop(thread.spawn(move || shared.serve(stream)));
                }
            }
        });
        Ok(Self { address, stop, serving: Some(serving) })
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

impl Drop for PolicyServer {
    /// Stops accepting connections.
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // A connection wakes the listener, which then sees the flag.
        let _ = TcpStream::connect_timeout(&self.address, HANDSHAKE);
        if let Some(serving) = self.serving.take() {
            let _ = serving.join();
        }
    }
}

impl Shared {
    /// Serves a connection until it ends; `None` if the client disconnects. Requests of web pages of other sites are
    /// refused.
    #[allow(clippy::result_large_err)] // the signature of the handshake is tungstenite's
    fn serve(&self, stream: TcpStream) -> Option<()> {
        stream.set_nodelay(true).ok()?;
        stream.set_read_timeout(Some(HANDSHAKE)).ok()?;
        stream.set_write_timeout(Some(HANDSHAKE)).ok()?;
        let guard = |request: &Request, response: Response| {
            let reason = browser_guard::refusal(request.headers(), self.listens_on_loopback);
            reason.map_or(Ok(response), |reason| {
                let mut refused = ErrorResponse::new(Some(reason));
                *refused.status_mut() = StatusCode::FORBIDDEN;
                Err(refused)
            })
        };
        let limit = Some(self.max_request_bytes);
        let limits = WebSocketConfig::default().max_message_size(limit).max_frame_size(limit);
        let mut socket = accept_hdr_with_config(stream, guard, Some(limits)).ok()?;
        socket.get_ref().set_read_timeout(Some(IDLE)).ok()?;
        if let Err(message) = self.converse(&mut socket) {
            // openpi's server reports a failure in the same way: its text, then the end of the connection.
            socket.send(Message::text(message)).ok()?;
            let reason = "the error is in the message before".into();
            socket.close(Some(CloseFrame { code: CloseCode::Error, reason })).ok()?;
            // Read and discard until the client has closed its side as well: closing earlier would reset the
            // connection, and the message would be lost.
            while socket.read().is_ok() {}
            let stream = socket.get_ref();
            stream.set_read_timeout(Some(HANDSHAKE)).ok()?;
            io::copy(&mut stream.take(MAX_READ_PAST), &mut io::sink()).ok()?;
        }
        Some(())
    }

    /// Answers observations until the client disconnects.
    fn converse(&self, socket: &mut WebSocket<TcpStream>) -> Result<(), String> {
        let PolicyEndpoint { robot, spec, arm_dof, make } = &self.endpoint;
        let mut policy = make();
        let send = |socket: &mut WebSocket<TcpStream>, value: &Value| {
            // A failure to send means that the client has disconnected.
            socket.send(Message::binary(wire::encoded(value))).is_ok()
        };
        if !send(socket, &served::metadata(robot, spec)) {
            return Ok(());
        }
        let mut instruction = None;
        loop {
            let message = match socket.read() {
                Ok(Message::Binary(message)) => message,
                Ok(Message::Text(_)) => return Err("expected a binary message: an observation as MessagePack".into()),
                Ok(Message::Ping(_) | Message::Pong(_) | Message::Frame(_)) => continue,
                Err(Error::Capacity(error)) => return Err(format!("the request is too large: {error}")),
                Ok(Message::Close(_)) | Err(_) => return Ok(()),
            };
            let request = decode(&message)?;
            let (prompt, observation) = served::read_question(&request, spec, *arm_dof)?;
            let chunk = self.workers.compute(|| {
                let started = Instant::now();
                if instruction.as_ref() != Some(&prompt) {
                    let (cameras, seed) = (Vec::new(), Seed::new(0));
                    policy.reset(&EpisodeStart { instruction: prompt.clone(), seed, cameras, scenario: None })?;
                    instruction = Some(prompt);
                }
                policy.act(&observation).map(|chunk| (chunk, started.elapsed().as_secs_f64()))
            });
            let (chunk, seconds) = chunk.map_err(|error| error.to_string())?;
            if !send(socket, &served::answer(&chunk, spec.action.length(*arm_dof), seconds)) {
                return Ok(());
            }
        }
    }
}

/// Counting semaphore that bounds the number of concurrent computations.
struct Workers {
    free: Mutex<usize>,
    freed: Condvar,
}

impl Workers {
    /// Runs a computation as soon as a worker is free.
    fn compute<T>(&self, work: impl FnOnce() -> T) -> T {
        let free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        let mut free = self.freed.wait_while(free, |free| *free == 0).unwrap_or_else(PoisonError::into_inner);
        *free -= 1;
        drop(free);
        let _turn = Turn(self);
        work()
    }
}

/// A worker in use, released on drop (also after a panic).
struct Turn<'a>(&'a Workers);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        *self.0.free.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        self.0.freed.notify_one();
    }
}
