//! WebSocket connection to a policy server: one request, one response.

use std::io::ErrorKind;
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use rmpv::Value;
use tungstenite::client::{IntoClientRequest, client_with_config};
use tungstenite::http::HeaderValue;
use tungstenite::http::header::AUTHORIZATION;
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, HandshakeError, Message, WebSocket};

/// Maximum response size, bytes: an action chunk has a few kilobytes, a traceback somewhat more.
const MAX_ANSWER_BYTES: usize = 4 << 20;
/// Maximum nesting depth of a response. Bounds the recursion for invalid responses.
const MAX_DEPTH: usize = 32;
/// Maximum reported length of a server's traceback (characters); its end contains the error.
const MAX_TRACEBACK_CHARS: usize = 400;

/// Timeouts and reconnects of a connection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timeouts {
    /// Timeout of connecting.
    pub connect: Duration,
    /// Timeout of a response; long enough for a server that compiles its model on the first request.
    pub answer: Duration,
    /// Maximum number of reconnects after a connection is lost before the response.
    pub reconnects: u32,
    /// Pause before each reconnect.
    pub pause: Duration,
}

impl Default for Timeouts {
    fn default() -> Self {
        Self {
            connect: Duration::from_secs(10),
            answer: Duration::from_secs(120),
            reconnects: 3,
            pause: Duration::from_secs(2),
        }
    }
}

/// Error of a policy server.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RemoteError {
    /// The server is unreachable, or closed the connection before it responded.
    #[error("the policy server {url}: {reason}")]
    Unreachable {
        /// URL of the server.
        url: String,
        /// Message of the operating system.
        reason: String,
    },
    /// The server did not respond in time.
    #[error("the policy server {url} did not answer within {seconds} s")]
    TimedOut {
        /// URL of the server.
        url: String,
        /// Timeout that was exceeded (s).
        seconds: u64,
    },
    /// The server failed with a traceback.
    #[error("the policy server {url} failed: {traceback}")]
    Failed {
        /// URL of the server.
        url: String,
        /// End of the traceback.
        traceback: String,
    },
    /// The response is not a valid message.
    #[error("invalid response from the policy server {url}: {what}")]
    Answer {
        /// URL of the server.
        url: String,
        /// Description of what is invalid in the response.
        what: String,
    },
}

/// Decodes a binary message.
///
/// # Errors
/// If it is not MessagePack, or nested too deeply.
pub fn decode(mut message: &[u8]) -> Result<Value, String> {
    let read = rmpv::decode::read_value_with_max_depth(&mut message, MAX_DEPTH);
    read.map_err(|error| format!("invalid MessagePack: {error}"))
}

/// An open connection to a policy server.
pub(crate) struct Connection {
    url: String,
    timeouts: Timeouts,
    socket: WebSocket<TcpStream>,
}

impl Connection {
    /// Connects and receives the server's metadata.
    pub(crate) fn open(url: &str, api_key: Option<&str>, timeouts: Timeouts) -> Result<(Self, Value), RemoteError> {
        let mut connection = Self::connect(url, api_key, timeouts)?;
        let metadata = connection.receive()?;
        Ok((connection, metadata))
    }

    /// Connects without waiting for the server's metadata.
    pub(crate) fn connect(url: &str, api_key: Option<&str>, timeouts: Timeouts) -> Result<Self, RemoteError> {
        let unreachable = |reason: String| RemoteError::Unreachable { url: url.to_owned(), reason };
        let mut request = url.into_client_request().map_err(|error| unreachable(error.to_string()))?;
        if let Some(key) = api_key {
            let value = HeaderValue::from_str(&format!("Api-Key {key}"));
            request.headers_mut().insert(AUTHORIZATION, value.map_err(|_| unreachable("no such API key".into()))?);
        }
        let (host, port) = (request.uri().host().unwrap_or_default(), request.uri().port_u16().unwrap_or(80));
        let addresses = (host.trim_matches(['[', ']']), port).to_socket_addrs();
        let addresses = addresses.map_err(|error| unreachable(error.to_string()))?;
        let mut last = "no such host".to_owned();
        let stream = addresses.into_iter().find_map(|address| {
            TcpStream::connect_timeout(&address, timeouts.connect).map_err(|error| last = error.to_string()).ok()
        });
        let stream = stream.ok_or_else(|| unreachable(last))?;
        // Disable Nagle's algorithm; apply timeouts.
        let prepared = stream
            .set_nodelay(true)
            .and_then(|()| stream.set_read_timeout(Some(timeouts.answer)))
            .and_then(|()| stream.set_write_timeout(Some(timeouts.answer)));
        prepared.map_err(|error| unreachable(error.to_string()))?;
        let limits =
            WebSocketConfig::default().max_message_size(Some(MAX_ANSWER_BYTES)).max_frame_size(Some(MAX_ANSWER_BYTES));
        let (socket, _) = client_with_config(request, stream, Some(limits)).map_err(|error| match error {
            HandshakeError::Failure(error) => unreachable(error.to_string()),
            HandshakeError::Interrupted(_) => unreachable("no response to the handshake".into()),
        })?;
        Ok(Self { url: url.to_owned(), timeouts, socket })
    }

    /// Sends a message without a response.
    pub(crate) fn send(&mut self, message: &[u8]) -> Result<(), RemoteError> {
        self.socket.send(Message::binary(message.to_vec())).map_err(|error| self.lost(error))
    }

    /// Sends a request and waits for the response.
    pub(crate) fn request(&mut self, question: &[u8]) -> Result<Value, RemoteError> {
        self.send(question)?;
        self.receive()
    }

    fn receive(&mut self) -> Result<Value, RemoteError> {
        loop {
            let message = self.socket.read().map_err(|error| self.lost(error))?;
            match message {
                Message::Binary(bytes) => {
                    return decode(&bytes).map_err(|what| self.wrong(what));
                }
                Message::Text(traceback) => return Err(self.failed(&traceback)),
                Message::Close(frame) => {
                    let reason = frame.map_or_else(String::new, |frame| format!(": {} {}", frame.code, frame.reason));
                    let reason = format!("it closed the connection{reason}");
                    return Err(RemoteError::Unreachable { url: self.url.clone(), reason });
                }
                Message::Ping(_) | Message::Pong(_) | Message::Frame(_) => {}
            }
        }
    }

    /// Error from a text message: openpi's servers send their traceback as text, which ends with the cause.
    fn failed(&self, traceback: &str) -> RemoteError {
        let count = traceback.chars().count();
        let end: String = traceback.trim().chars().skip(count.saturating_sub(MAX_TRACEBACK_CHARS)).collect();
        RemoteError::Failed { url: self.url.clone(), traceback: end }
    }

    pub(crate) fn wrong(&self, what: String) -> RemoteError {
        RemoteError::Answer { url: self.url.clone(), what }
    }

    fn lost(&self, error: Error) -> RemoteError {
        let url = self.url.clone();
        match error {
            Error::Io(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                RemoteError::TimedOut { url, seconds: self.timeouts.answer.as_secs() }
            }
            Error::Capacity(error) => RemoteError::Answer { url, what: format!("too large: {error}") },
            error => RemoteError::Unreachable { url, reason: error.to_string() },
        }
    }
}
