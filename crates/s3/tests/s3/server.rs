//! An in-memory S3 server with fault injection.
//!
//! It verifies the payload hash, not the signature itself, which is covered by Amazon's examples and by tests on a
//! real server.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use sha2::{Digest, Sha256};

#[derive(Default)]
struct State {
    kept: Mutex<Kept>,
    calls: AtomicUsize,
    failed: AtomicUsize,
    unsigned: AtomicUsize,
    /// Every n-th call fails; 0: none.
    every: AtomicUsize,
    from: AtomicUsize,
    refuses: AtomicBool,
    /// Status reported for an upload that was already completed; 0: completion responses are not lost.
    loses_completions: AtomicUsize,
}

#[derive(Default)]
struct Kept {
    objects: BTreeMap<String, Object>,
    uploads: BTreeMap<String, (Object, BTreeMap<usize, Vec<u8>>)>,
    begun: usize,
}

#[derive(Clone, Default)]
struct Object {
    bytes: Vec<u8>,
    sha256: Option<String>,
}

/// A server on a free port, for as long as the test runs.
pub struct Server {
    state: Arc<State>,
    port: u16,
}

struct Call {
    method: String,
    key: String,
    query: BTreeMap<String, String>,
    headers: BTreeMap<String, String>,
    body: Vec<u8>,
}

struct Answer {
    status: u16,
    headers: Vec<(&'static str, String)>,
    body: Vec<u8>,
}

impl Server {
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let state = Arc::new(State { from: AtomicUsize::new(usize::MAX), ..State::default() });
        let kept = Arc::clone(&state);
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let state = Arc::clone(&kept);
                std::thread::spawn(move || serve(stream, &state));
            }
        });
        Self { state, port }
    }

    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    /// Every n-th call fails, alternating between refused before and response lost after processing.
    pub fn fail_every(&self, calls: usize) {
        self.state.every.store(calls, Ordering::Relaxed);
    }

    pub fn fail_from(&self, call: usize) {
        self.state.from.store(call, Ordering::Relaxed);
    }

    pub fn refuse_all(&self) {
        self.state.refuses.store(true, Ordering::Relaxed);
    }

    /// Loses the response to each completion of an upload; the next one returns `status`.
    pub fn lose_completions(&self, status: usize) {
        self.state.loses_completions.store(status, Ordering::Relaxed);
    }

    pub fn put(&self, key: &str, bytes: &[u8]) {
        let object = Object { bytes: bytes.into(), sha256: None };
        self.state.kept.lock().unwrap().objects.insert(key.into(), object);
    }

    pub fn failed(&self) -> usize {
        self.state.failed.load(Ordering::Relaxed)
    }

    pub fn unsigned(&self) -> usize {
        self.state.unsigned.load(Ordering::Relaxed)
    }
}

fn serve(mut stream: TcpStream, state: &State) {
    let Some(call) = read(&stream) else { return };
    let number = state.calls.fetch_add(1, Ordering::Relaxed) + 1;
    let every = state.every.load(Ordering::Relaxed);
    let fails = every > 0 && number.is_multiple_of(every);
    let is_lost = fails && (number / every).is_multiple_of(2);
    let answer = if state.refuses.load(Ordering::Relaxed) {
        error(403, "AccessDenied", "not you")
    } else if (fails && !is_lost) || number >= state.from.load(Ordering::Relaxed) {
        error(503, "SlowDown", "please")
    } else {
        state.answer(&call)
    };
    state.failed.fetch_add(usize::from(fails), Ordering::Relaxed);
    let is_completed = call.method == "POST" && call.query.contains_key("uploadId") && answer.status == 200;
    if is_lost || is_completed && state.loses_completions.load(Ordering::Relaxed) > 0 {
        return;
    }
    let mut head = format!("HTTP/1.1 {} x\r\nconnection: close\r\n", answer.status);
    for (name, value) in &answer.headers {
        head += &format!("{name}: {value}\r\n");
    }
    if call.method != "HEAD" {
        head += &format!("content-length: {}\r\n", answer.body.len());
    }
    let _ = stream.write_all(format!("{head}\r\n").as_bytes());
    if call.method != "HEAD" {
        let _ = stream.write_all(&answer.body);
    }
}

impl State {
    fn answer(&self, call: &Call) -> Answer {
        let Call { method, key, query, headers, body } = call;
        let digits = |bytes: &[u8]| Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        let signed = headers.get("authorization").is_some_and(|signed| signed.starts_with("AWS4-HMAC-SHA256 "));
        if !signed || headers.get("x-amz-content-sha256") != Some(&digits(body)) {
            self.unsigned.fetch_add(1, Ordering::Relaxed);
            return error(403, "SignatureDoesNotMatch", "not as signed");
        }
        let mut kept = self.kept.lock().unwrap();
        let upload = query.get("uploadId");
        let object = |bytes| Object { bytes, sha256: headers.get("x-amz-meta-sha256").cloned() };
        match (method.as_str(), upload) {
            ("HEAD", _) => match kept.objects.get(key) {
                Some(Object { bytes, sha256 }) => {
                    let mut headers = vec![("content-length", bytes.len().to_string())];
                    headers.extend(sha256.clone().map(|sha256| ("x-amz-meta-sha256", sha256)));
                    Answer { status: 200, headers, body: Vec::new() }
                }
                None => Answer { status: 404, headers: Vec::new(), body: Vec::new() },
            },
            ("GET", _) => match kept.objects.get(key) {
                Some(object) => fine(object.bytes.clone()),
                None => error(404, "NoSuchKey", "it is not there"),
            },
            ("PUT", None) => {
                kept.objects.insert(key.clone(), object(body.clone()));
                fine(Vec::new())
            }
            ("POST", None) if query.contains_key("uploads") => {
                kept.begun += 1;
                let id = format!("up&load-{}", kept.begun);
                let text = format!("<X><UploadId>{}</UploadId></X>", id.replace('&', "&amp;"));
                kept.uploads.insert(id, (object(Vec::new()), BTreeMap::new()));
                fine(text.into_bytes())
            }
            ("PUT", Some(id)) => match (kept.uploads.get_mut(id), query["partNumber"].parse()) {
                (Some((_, parts)), Ok(number)) => {
                    parts.insert(number, body.clone());
                    Answer { headers: vec![("etag", format!("\"{number}\""))], ..fine(Vec::new()) }
                }
                _ => error(404, "NoSuchUpload", "it is not there"),
            },
            ("POST", Some(id)) => match kept.uploads.remove(id) {
                Some((mut object, parts)) => {
                    let named = String::from_utf8_lossy(body).matches("<Part>").count();
                    assert_eq!(named, parts.len(), "listed parts and uploaded parts");
                    object.bytes = parts.into_values().flatten().collect();
                    kept.objects.insert(key.clone(), object);
                    fine(b"<CompleteMultipartUploadResult/>".to_vec())
                }
                None if self.loses_completions.load(Ordering::Relaxed) == 403 => error(403, "AccessDenied", "not you"),
                None => error(404, "NoSuchUpload", "it is not there"),
            },
            ("DELETE", Some(id)) => {
                kept.uploads.remove(id);
                fine(Vec::new())
            }
            _ => error(400, "InvalidRequest", "what is that"),
        }
    }
}

fn fine(body: Vec<u8>) -> Answer {
    Answer { status: 200, headers: Vec::new(), body }
}

fn error(status: u16, code: &str, message: &str) -> Answer {
    let text = format!("<?xml version=\"1.0\"?><Error><Code>{code}</Code><Message>{message}</Message></Error>");
    Answer { status, headers: Vec::new(), body: text.into_bytes() }
}

fn read(stream: &TcpStream) -> Option<Call> {
    let mut reader = BufReader::new(stream);
    let mut line = || {
        let mut line = String::new();
        reader.read_line(&mut line).ok().filter(|count| *count > 0)?;
        Some(line.trim_end().to_owned())
    };
    let first = line()?;
    let mut words = first.split(' ');
    let (method, target) = (words.next()?.to_owned(), words.next()?);
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let mut headers = BTreeMap::new();
    while let Some(header) = line().filter(|header| !header.is_empty()) {
        let (name, value) = header.split_once(':')?;
        headers.insert(name.to_ascii_lowercase(), value.trim().to_owned());
    }
    let mut body = vec![0; headers.get("content-length").map_or(Some(0), |length| length.parse().ok())?];
    reader.read_exact(&mut body).ok()?;
    let query = query.split('&').filter(|part| !part.is_empty()).map(|part| {
        let (name, value) = part.split_once('=').unwrap_or((part, ""));
        (decoded(name), decoded(value))
    });
    let key = decoded(path.strip_prefix("/my-bucket/")?);
    Some(Call { method, key, query: query.collect(), headers, body })
}

fn decoded(text: &str) -> String {
    let (mut bytes, mut rest) = (Vec::new(), text.as_bytes());
    while let Some((&first, after)) = rest.split_first() {
        let digits = after.get(..2).filter(|_| first == b'%').and_then(|digits| std::str::from_utf8(digits).ok());
        match digits.and_then(|digits| u8::from_str_radix(digits, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &after[2..];
            }
            None => {
                bytes.push(first);
                rest = after;
            }
        }
    }
    String::from_utf8(bytes).unwrap()
}
