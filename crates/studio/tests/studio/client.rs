//! A studio on loopback with clients as browsers are: HTTP and a WebSocket per tab.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use genmanip_core::{Document, InstanceId, Scenario};
use genmanip_serve::Server;
use genmanip_studio::collections::Collection;
use genmanip_studio::review::ReviewInputs;
use genmanip_studio::run::OfferedPolicies;
use genmanip_studio::server::{StudioSettings, Token, start};
use genmanip_workspace::NoProgress;
use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// A studio with one scenario of its own.
pub struct Studio {
    pub server: Server,
    pub folder: TempDir,
    /// Key and file of the scenario.
    pub key: String,
    pub file: PathBuf,
}

/// An answer over HTTP.
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

/// A tab.
pub struct Tab {
    socket: WebSocket<TcpStream>,
    pub author: String,
}

impl Studio {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (key, file) = place_scenario(&folder.path().join("scenes"));
        let server = serve(folder.path(), &[folder.path().join("scenes")], None);
        Self { server, folder, key, file }
    }

    /// The same folder in a new server, with these inputs of the review.
    pub fn reviewing(self, inputs: ReviewInputs) -> Self {
        let Self { server, folder, key, file } = self;
        drop(server);
        let server = serve_with(folder.path(), &[folder.path().join("scenes")], None, inputs);
        Self { server, folder, key, file }
    }

    /// The same folder in a new server.
    pub fn restarted(self) -> Self {
        self.reviewing(ReviewInputs::default())
    }

    pub fn get(&self, path: &str) -> Answer {
        request(self.server.address(), "GET", path, &[], &[])
    }

    pub fn post(&self, path: &str, body: &Value) -> Answer {
        let head = [("content-type", "application/json")];
        request(self.server.address(), "POST", path, &head, body.to_string().as_bytes())
    }

    pub fn scenario_path(&self, what: &str) -> String {
        format!("/api/scenarios/{}{what}", self.key)
    }

    pub fn scenario(&self) -> Scenario {
        Scenario::from_bytes(&std::fs::read(&self.file).unwrap()).unwrap()
    }

    /// Id and pose of an object.
    pub fn object(&self, index: usize) -> (InstanceId, Value) {
        let placed = &self.scenario().objects[index];
        (placed.id.clone(), serde_json::to_value(placed.pose).unwrap())
    }

    /// Command that shifts an object along y.
    pub fn shift(&self, index: usize, by_m: f64, base: u64, id: &str, author: &str) -> Value {
        let (object, mut pose) = self.object(index);
        pose["position_m"][1] = json!(pose["position_m"][1].as_f64().unwrap() + by_m);
        json!({
            "op": "place", "args": { "objects": [{ "id": object, "pose": pose }] }, "base_revision": base,
            "client_operation_id": id, "author": author, "at": "2026-01-01T00:00:00Z",
        })
    }

    pub fn tab(&self, author: &str) -> Tab {
        let mut tab = Tab::connect(self.server.address(), author, None).unwrap();
        tab.send(&json!({ "type": "open", "scenario": self.key, "author": author }));
        assert_eq!(tab.next("scene")["key"], json!(self.key));
        tab
    }
}

/// Starts a studio of paths, whose copies go to `folder/out`.
pub fn serve(folder: &Path, paths: &[PathBuf], token: Option<Token>) -> Server {
    serve_with(folder, paths, token, ReviewInputs::default())
}

fn serve_with(folder: &Path, paths: &[PathBuf], token: Option<Token>, review: ReviewInputs) -> Server {
    let out = folder.join("out");
    let collection = Collection::open(paths, &out, &NoProgress).unwrap();
    let address = ([127, 0, 0, 1], 0).into();
    let policies = OfferedPolicies::new(&["do_nothing:seconds=1".into()]).unwrap();
    let questions = Some(folder.join("questions"));
    let author = "owner".into();
    start(collection, StudioSettings { address, out, author, token, policies, questions, review }).unwrap()
}

/// Copies a scenario of the shipped suite into a folder; returns its key and file.
pub fn place_scenario(folder: &Path) -> (String, PathBuf) {
    let from = suite_scenario();
    std::fs::create_dir_all(folder).unwrap();
    let to = folder.join(from.file_name().unwrap());
    std::fs::copy(&from, &to).unwrap();
    (from.file_stem().unwrap().to_string_lossy().into_owned(), to)
}

/// First scenario of the shipped suite.
pub fn suite_scenario() -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../suites/genmanip-200-rc/scenarios");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files.remove(0)
}

/// Sends a request and reads the whole answer.
pub fn request(address: SocketAddr, method: &str, path: &str, head: &[(&str, &str)], body: &[u8]) -> Answer {
    let mut stream = TcpStream::connect(address).unwrap();
    // The expert's trials of a scenario take seconds, on a busy machine minutes.
    stream.set_read_timeout(Some(Duration::from_secs(300))).unwrap();
    let host =
        if head.iter().any(|(name, _)| *name == "host") { String::new() } else { format!("host: {address}\r\n") };
    let fields: String = head.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
    let length = body.len();
    let text =
        format!("{method} {path} HTTP/1.1\r\n{host}{fields}content-length: {length}\r\nconnection: close\r\n\r\n");
    stream.write_all(text.as_bytes()).unwrap();
    // A request that is refused early may not be read to its end.
    let _ = stream.write_all(body);
    let mut bytes = Vec::new();
    let _ = stream.read_to_end(&mut bytes);
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
    let head = String::from_utf8(bytes[..end].to_vec()).unwrap().to_lowercase();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    Answer { status, head, body: bytes[end + 4..].to_vec() }
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|error| panic!("{error}: {}", self.text()))
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }
}

impl Tab {
    /// Connects; `Err` with the status of a refused handshake.
    pub fn connect(address: SocketAddr, author: &str, origin: Option<&str>) -> Result<Self, u16> {
        Self::connect_to("/api/socket", address, author, origin)
    }

    /// As [`Tab::connect`], to another route.
    pub fn connect_to(path: &str, address: SocketAddr, author: &str, origin: Option<&str>) -> Result<Self, u16> {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut request = format!("ws://{address}{path}").into_client_request().unwrap();
        if let Some(origin) = origin {
            request.headers_mut().insert("origin", origin.parse().unwrap());
        }
        match tungstenite::client(request, stream) {
            Ok((socket, _)) => Ok(Self { socket, author: author.into() }),
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => {
                Err(answer.status().as_u16())
            }
            Err(error) => panic!("{error}"),
        }
    }

    pub fn send(&mut self, message: &Value) {
        self.send_raw(Message::text(message.to_string())).unwrap();
    }

    pub fn send_raw(&mut self, message: Message) -> Result<(), tungstenite::Error> {
        self.socket.send(message)
    }

    pub fn command(&mut self, command: &Value) {
        self.send(&json!({ "type": "command", "command": command }));
    }

    /// Next message of a type; others are read past.
    pub fn next(&mut self, kind: &str) -> Value {
        self.find(|message| message["type"] == json!(kind))
    }

    /// Next message for which a test holds.
    pub fn find(&mut self, is_meant: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(60) {
            if let Message::Text(text) = self.socket.read().unwrap() {
                let message: Value = serde_json::from_str(text.as_str()).unwrap();
                if is_meant(&message) {
                    return message;
                }
            }
        }
        panic!("{} waited for a minute", self.author)
    }

    /// Next message as it is.
    pub fn read(&mut self) -> Message {
        self.socket.read().unwrap()
    }

    /// True if the server has closed the connection.
    pub fn is_closed(&mut self) -> bool {
        loop {
            match self.socket.read() {
                Ok(Message::Close(_)) | Err(_) => return true,
                Ok(_) => {}
            }
        }
    }
}
