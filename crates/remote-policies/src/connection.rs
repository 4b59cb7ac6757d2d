//! A websocket to a policy server: one question, one answer.

use std::io::ErrorKind;
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use rmpv::Value;
use tungstenite::client::{IntoClientRequest, client_with_config};
use tungstenite::http::HeaderValue;
use tungstenite::http::header::AUTHORIZATION;
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, HandshakeError, Message, WebSocket};

/// Largest answer that is read: a chunk of actions has a few kilobytes, a traceback some more.
const MAX_ANSWER_BYTES: usize = 4 << 20;
/// Deepest nesting of an answer.
const MAX_DEPTH: usize = 32;
/// The longest part of a server's traceback that is repeated, characters; its end says what went wrong.
const SHOWN: usize = 400;

/// How long is waited for a server.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patience {
    /// For a connection.
    pub connect: Duration,
    /// For an answer; the first one of a server may wait until its model is compiled.
    pub answer: Duration,
    /// How often a connection that is lost before the answer came is made again.
    pub reconnects: u32,
    /// Before that.
    pub pause: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            connect: Duration::from_secs(10),
            answer: Duration::from_secs(120),
            reconnects: 3,
            pause: Duration::from_secs(2),
        }
    }
}

/// Why a server gave no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RemoteError {
    /// It cannot be reached, or went away.
    #[error("the policy server {url}: {reason}")]
    Unreachable {
        /// Where it should be.
        url: String,
        /// What the system says.
        reason: String,
    },
    /// It did not answer in time.
    #[error("the policy server {url} did not answer within {seconds} s")]
    TimedOut {
        /// Where it is.
        url: String,
        /// How long was waited.
        seconds: u64,
    },
    /// It failed, and said how.
    #[error("the policy server {url} failed: {traceback}")]
    Failed {
        /// Where it is.
        url: String,
        /// The end of its traceback.
        traceback: String,
    },
    /// It answered something that is not the protocol.
    #[error("the policy server {url} answered {what}")]
    Answer {
        /// Where it is.
        url: String,
        /// What is wrong with the answer.
        what: String,
    },
}

/// A server that was reached.
pub(crate) struct Connection {
    url: String,
    patience: Patience,
    socket: WebSocket<TcpStream>,
}

impl Connection {
    /// Connects, and takes the metadata with which the server begins.
    pub(crate) fn open(url: &str, api_key: Option<&str>, patience: Patience) -> Result<(Self, Value), RemoteError> {
        let mut connection = Self::connect(url, api_key, patience)?;
        let metadata = connection.receive()?;
        Ok((connection, metadata))
    }

    /// Connects to a server that waits to be greeted.
    pub(crate) fn connect(url: &str, api_key: Option<&str>, patience: Patience) -> Result<Self, RemoteError> {
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
            TcpStream::connect_timeout(&address, patience.connect).map_err(|error| last = error.to_string()).ok()
        });
        let stream = stream.ok_or_else(|| unreachable(last))?;
        // Small questions go at once; whoever is silent for too long is given up.
        let prepared = stream
            .set_nodelay(true)
            .and_then(|()| stream.set_read_timeout(Some(patience.answer)))
            .and_then(|()| stream.set_write_timeout(Some(patience.answer)));
        prepared.map_err(|error| unreachable(error.to_string()))?;
        let limits =
            WebSocketConfig::default().max_message_size(Some(MAX_ANSWER_BYTES)).max_frame_size(Some(MAX_ANSWER_BYTES));
        let (socket, _) = client_with_config(request, stream, Some(limits)).map_err(|error| match error {
            HandshakeError::Failure(error) => unreachable(error.to_string()),
            HandshakeError::Interrupted(_) => unreachable("it does not answer".into()),
        })?;
        Ok(Self { url: url.to_owned(), patience, socket })
    }

    /// Says something that is not answered.
    pub(crate) fn tell(&mut self, message: &[u8]) -> Result<(), RemoteError> {
        self.socket.send(Message::binary(message.to_vec())).map_err(|error| self.lost(error))
    }

    /// Asks and waits for the answer.
    pub(crate) fn ask(&mut self, question: &[u8]) -> Result<Value, RemoteError> {
        self.tell(question)?;
        self.receive()
    }

    fn receive(&mut self) -> Result<Value, RemoteError> {
        loop {
            let message = self.socket.read().map_err(|error| self.lost(error))?;
            match message {
                Message::Binary(bytes) => {
                    let read = rmpv::decode::read_value_with_max_depth(&mut bytes.as_ref(), MAX_DEPTH);
                    return read.map_err(|error| self.wrong(format!("no MessagePack: {error}")));
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

    /// A text is the server's traceback, which ends with what went wrong.
    fn failed(&self, traceback: &str) -> RemoteError {
        let count = traceback.chars().count();
        let end: String = traceback.trim().chars().skip(count.saturating_sub(SHOWN)).collect();
        RemoteError::Failed { url: self.url.clone(), traceback: end }
    }

    pub(crate) fn wrong(&self, what: String) -> RemoteError {
        RemoteError::Answer { url: self.url.clone(), what }
    }

    fn lost(&self, error: Error) -> RemoteError {
        let url = self.url.clone();
        match error {
            Error::Io(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                RemoteError::TimedOut { url, seconds: self.patience.answer.as_secs() }
            }
            Error::Capacity(error) => RemoteError::Answer { url, what: format!("too much: {error}") },
            error => RemoteError::Unreachable { url, reason: error.to_string() },
        }
    }
}
