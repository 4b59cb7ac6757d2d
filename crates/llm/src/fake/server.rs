//! A server on a free loopback port that supports all dialects, with scripted normal and faulty behaviour.

use std::collections::BTreeMap;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::{Value, json};

/// Maximum request size that the fake server accepts (bytes).
const MAX_REQUEST_BYTES: usize = 64 << 20; // twice what the default settings let a client send
/// Timeout of reading from and writing to a socket.
const SOCKET_TIMEOUT: Duration = Duration::from_secs(10);

/// Scripted behaviour of the server for one request.
#[derive(Clone, Debug, PartialEq)]
pub enum Behaviour {
    /// A normal reply with this text, in the dialect of the requested path.
    Answer(String),
    /// A status with headers and a body.
    Status(u16, Vec<(String, String)>, String),
    /// Status 200 with a content type and a body.
    Body(String, String),
    /// Wait, then behave as the second field says.
    Slow(Duration, Box<Behaviour>),
    /// Announce more bytes than are sent (the given text), then close the connection.
    CutOff(String),
    /// Send this many bytes with status 200.
    Flood {
        /// Number of bytes to send.
        bytes: u64,
        /// True to send `Content-Length`.
        announced: bool,
    },
    /// Send JSON text byte by byte, without completing it.
    Drip {
        /// Number of bytes to send.
        bytes: usize,
        /// Pause before each byte.
        every: Duration,
    },
    /// Close the connection without a response.
    HangUp,
}

/// A request that the fake server received.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenRequest {
    /// Index of the request, from 0.
    pub index: usize,
    /// Method and path, e.g. `POST /v1/chat/completions`.
    pub target: String,
    /// Headers, names in lower case.
    pub headers: BTreeMap<String, String>,
    /// Body of the request; null if it is not JSON.
    pub body: Value,
}

/// A fake server on a loopback port; it stops when dropped.
pub struct FakeServer {
    address: SocketAddr,
    shared: Arc<Shared>,
    listener: Option<JoinHandle<()>>,
}

struct Shared {
    behaviour: Box<dyn Fn(&SeenRequest) -> Behaviour + Send + Sync>,
    seen: Mutex<Vec<SeenRequest>>,
    /// Number of requests received so far.
    count: AtomicUsize,
    records: bool,
    bytes_sent: AtomicU64,
    stopped: AtomicBool,
}

/// Starts a server for concurrent questions in unknown order. Of the given pairs of text and answer, the first whose
/// text the question contains determines the answer; without a match, the answer is empty.
///
/// # Errors
/// Fails if there is no free port.
pub fn answering<'a>(answers: impl IntoIterator<Item = (&'a str, Value)>) -> io::Result<FakeServer> {
    let answers: Vec<(String, String)> =
        answers.into_iter().map(|(words, answer)| (words.to_owned(), answer.to_string())).collect();
    FakeServer::start(move |request| {
        let question = request.body.to_string();
        let answer = answers.iter().find(|(words, _)| question.contains(words));
        Behaviour::Answer(answer.map(|(_, answer)| answer.clone()).unwrap_or_default())
    })
}

/// Body of a normal chat completion in OpenAI's dialect.
pub fn completion(text: &str) -> String {
    json!({
        "id": "fake", "object": "chat.completion", "created": 0, "model": "fake-server",
        "choices": [{"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": text}}],
        "usage": {"prompt_tokens": 100, "completion_tokens": 10, "total_tokens": 110},
    })
    .to_string()
}

/// Body of a normal message in Anthropic's dialect.
pub fn message(text: &str) -> String {
    json!({
        "id": "fake", "type": "message", "role": "assistant", "model": "fake-server",
        "content": [{"type": "text", "text": text}], "stop_reason": "end_turn", "stop_sequence": null,
        "usage": {"input_tokens": 100, "output_tokens": 10},
    })
    .to_string()
}

impl FakeServer {
    /// Starts a server with one behaviour per request, in order; afterwards it answers 410.
    ///
    /// # Errors
    /// Fails if there is no free loopback port.
    pub fn scripted(script: impl IntoIterator<Item = Behaviour>) -> io::Result<Self> {
        let script: Vec<Behaviour> = script.into_iter().collect();
        let ended = Behaviour::Status(410, Vec::new(), "the script has ended".into());
        Self::start(move |request| script.get(request.index).unwrap_or(&ended).clone())
    }

    /// Starts a server whose behaviour depends on the request.
    ///
    /// # Errors
    /// Fails if there is no free loopback port.
    pub fn start(behaviour: impl Fn(&SeenRequest) -> Behaviour + Send + Sync + 'static) -> io::Result<Self> {
        Self::listen(true, behaviour)
    }

    /// Like [`FakeServer::start`] but without recording requests, for many large requests: [`FakeServer::seen`] stays
    /// empty.
    ///
    /// # Errors
    /// Fails if there is no free loopback port.
    pub fn forgetful(behaviour: impl Fn(&SeenRequest) -> Behaviour + Send + Sync + 'static) -> io::Result<Self> {
        Self::listen(false, behaviour)
    }

    fn listen(
        records: bool,
        behaviour: impl Fn(&SeenRequest) -> Behaviour + Send + Sync + 'static,
    ) -> io::Result<Self> {
        let listener = TcpListener::bind(("127.0.0.1", 0))?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared {
            behaviour: Box::new(behaviour),
            seen: Mutex::default(),
            count: AtomicUsize::new(0),
            records,
            bytes_sent: AtomicU64::new(0),
            stopped: AtomicBool::new(false),
        });
        let accepting = Arc::clone(&shared);
        let listener = std::thread::spawn(move || {
            for stream in listener.incoming() {
                if accepting.stopped.load(Ordering::SeqCst) {
                    break;
                }
                let serving = Arc::clone(&accepting);
                if let Ok(stream) = stream {
                    // Some tests close the connection early.
                    std::thread::spawn(move || drop(serve(stream, &serving)));
                }
            }
        });
        Ok(Self { address, shared, listener: Some(listener) })
    }

    /// Base URL for the settings.
    pub fn base_url(&self) -> String {
        format!("http://{}/v1", self.address)
    }

    /// Requests received so far, in order of arrival.
    pub fn seen(&self) -> Vec<SeenRequest> {
        self.shared.seen.lock().map(|seen| seen.clone()).unwrap_or_default()
    }

    /// Number of body bytes passed to the operating system so far.
    pub fn bytes_sent(&self) -> u64 {
        self.shared.bytes_sent.load(Ordering::SeqCst)
    }
}

impl Drop for FakeServer {
    fn drop(&mut self) {
        self.shared.stopped.store(true, Ordering::SeqCst);
        let _ = TcpStream::connect(self.address); // wakes the listener
        if let Some(listener) = self.listener.take() {
            let _ = listener.join();
        }
    }
}

fn serve(stream: TcpStream, shared: &Shared) -> io::Result<()> {
    stream.set_read_timeout(Some(SOCKET_TIMEOUT))?;
    stream.set_write_timeout(Some(SOCKET_TIMEOUT))?;
    let mut request = read_request(&mut BufReader::new(&stream))?;
    if let Ok(mut seen) = shared.seen.lock() {
        request.index = shared.count.fetch_add(1, Ordering::SeqCst);
        if shared.records {
            seen.push(request.clone());
        }
    }
    behave((shared.behaviour)(&request), &request, stream, shared)
}

fn read_request(reader: &mut impl BufRead) -> io::Result<SeenRequest> {
    let mut line = String::new();
    reader.read_line(&mut line)?;
    let target = line.rsplit_once(' ').map(|(target, _)| target.to_owned()).unwrap_or_default();
    let mut headers = BTreeMap::new();
    loop {
        line.clear();
        if reader.read_line(&mut line)? == 0 || line.trim().is_empty() {
            break;
        }
        if let Some((name, value)) = line.split_once(':') {
            headers.insert(name.trim().to_lowercase(), value.trim().to_owned());
        }
    }
    let length = headers.get("content-length").and_then(|length| length.parse().ok()).unwrap_or(0);
    let mut body = vec![0; std::cmp::min(length, MAX_REQUEST_BYTES)];
    reader.read_exact(&mut body)?;
    Ok(SeenRequest { index: 0, target, headers, body: serde_json::from_slice(&body).unwrap_or_default() })
}

fn behave(behaviour: Behaviour, request: &SeenRequest, mut stream: TcpStream, shared: &Shared) -> io::Result<()> {
    let json = "application/json";
    match behaviour {
        Behaviour::Answer(text) => {
            let body = if request.target.ends_with("/messages") { message(&text) } else { completion(&text) };
            respond(&mut stream, shared, 200, &[("content-type", json)], &body)
        }
        Behaviour::Body(content_type, body) => {
            respond(&mut stream, shared, 200, &[("content-type", content_type.as_str())], &body)
        }
        Behaviour::Status(status, headers, body) => {
            let headers: Vec<(&str, &str)> =
                headers.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect();
            respond(&mut stream, shared, status, &headers, &body)
        }
        Behaviour::Slow(wait, then) => {
            std::thread::sleep(wait);
            behave(*then, request, stream, shared)
        }
        Behaviour::CutOff(body) => {
            let more = body.len() + 1000;
            write!(stream, "HTTP/1.1 200 OK\r\ncontent-type: {json}\r\ncontent-length: {more}\r\n\r\n{body}")
        }
        Behaviour::Flood { bytes, announced } => {
            let length = if announced { format!("content-length: {bytes}\r\n") } else { String::new() };
            write!(stream, "HTTP/1.1 200 OK\r\ncontent-type: {json}\r\n{length}connection: close\r\n\r\n")?;
            let mut flood = io::repeat(b' ').take(bytes);
            let mut chunk = [0; 1 << 16];
            loop {
                let count = flood.read(&mut chunk)?;
                if count == 0 {
                    return Ok(());
                }
                stream.write_all(&chunk[..count])?;
                shared.bytes_sent.fetch_add(count as u64, Ordering::SeqCst);
            }
        }
        Behaviour::Drip { bytes, every } => {
            write!(stream, "HTTP/1.1 200 OK\r\ncontent-type: {json}\r\nconnection: close\r\n\r\n")?;
            for _ in 0..bytes {
                std::thread::sleep(every);
                stream.write_all(b" ")?;
                shared.bytes_sent.fetch_add(1, Ordering::SeqCst);
            }
            Ok(())
        }
        Behaviour::HangUp => Ok(()),
    }
}

fn respond(
    stream: &mut TcpStream,
    shared: &Shared,
    status: u16,
    headers: &[(&str, &str)],
    body: &str,
) -> io::Result<()> {
    write!(stream, "HTTP/1.1 {status} Scripted\r\ncontent-length: {}\r\nconnection: close\r\n", body.len())?;
    for (name, value) in headers {
        write!(stream, "{name}: {value}\r\n")?;
    }
    write!(stream, "\r\n{body}")?;
    shared.bytes_sent.fetch_add(body.len() as u64, Ordering::SeqCst);
    stream.flush()
}
