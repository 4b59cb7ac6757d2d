//! Client of the bridge: an arm that follows the commands of a policy, over any [`Connection`].

use std::collections::{BTreeMap, VecDeque};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::guard::Command;
use super::message::{CameraImage, ImageHead, Motion, PROTOCOL, Recovery, Reply, Request, State, Welcome};
use super::server::Clock;

/// Scheme of a bridge's address.
pub const SCHEME: &str = "tcp://";
/// Share of the maximum speed in slow mode.
pub const SLOW: f64 = 0.1;
/// Time for a connection to be established.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Largest line of a reply, bytes.
const MAX_LINE: u64 = 1 << 20;
/// Number of past states that are kept, for the pose of a moving camera.
const PAST_STATES: usize = 1000;
/// Largest image, pixels per side.
const MAX_SIDE_PX: u32 = 8192;

/// Reason why the bridge cannot be used any more.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BridgeError {
    /// The address has another form.
    #[error("`{0}` is no address of a bridge; expected {SCHEME}HOST:PORT, such as {SCHEME}127.0.0.1:4757")]
    Address(String),
    /// Nothing answers at the address, or the connection is lost.
    #[error("the bridge at {address} cannot be reached: {reason}")]
    Connection {
        /// Address of the bridge.
        address: String,
        /// Message of the system.
        reason: String,
    },
    /// No answer came in time.
    #[error("the bridge gave no answer to `{request}` within {patience_s} s")]
    Silent {
        /// Name of the request.
        request: &'static str,
        /// Time waited, s.
        patience_s: f64,
    },
    /// A request was refused.
    #[error("the bridge refused `{request}` ({word}): {message}")]
    Refused {
        /// Name of the request.
        request: String,
        /// Reason as a word.
        word: String,
        /// Reason as a sentence.
        message: String,
    },
    /// The arm reports errors that recovery did not clear, or too often.
    #[error("the arm stopped by itself {stops} times; at last it reported {}", .errors.join(", "))]
    Arm {
        /// Number of stops.
        stops: usize,
        /// Error words of the arm.
        errors: Vec<String>,
    },
    /// The dead-man's switch was released.
    #[error("stopped by a person")]
    Person,
}

/// Connection to a bridge, with the clock on which its client waits.
pub trait Connection: Send {
    /// Time on the client's clock, s.
    fn now_s(&self) -> f64;

    /// Sends a request.
    ///
    /// # Errors
    /// If the connection is lost.
    fn send(&mut self, request: &Request) -> Result<(), BridgeError>;

    /// Next reply; waits for it until `until_s` and returns `None` then.
    ///
    /// # Errors
    /// If the connection is lost.
    fn receive(&mut self, until_s: f64) -> Result<Option<Reply>, BridgeError>;

    /// Latest image of a camera of the bridge; its size may be another than wanted.
    ///
    /// # Errors
    /// For an unknown camera, or if the connection is lost.
    fn image(&mut self, camera: &str, size: Option<[u32; 2]>) -> Result<CameraImage, BridgeError>;
}

/// Settings of a client.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClientSettings {
    /// Validity of each command, s: the arm brakes when no other has come by then.
    pub valid_for_s: f64,
    /// Time in which the reference moves to the positions of a command, s: longer than a control period, so that late
    /// commands make no jerks; the arm lags behind by it.
    pub over_s: f64,
    /// Share of the maximum speed.
    pub speed: f64,
    /// Box that the tool must not leave: two opposite corners, m, in the robot's base frame; `None` for none.
    pub workspace_m: Option<[[f64; 3]; 2]>,
    /// States per second.
    pub state_rate_hz: f64,
    /// Time for an answer, and for the arm to come to rest or recover, s.
    pub patience_s: f64,
    /// Number of times that the arm may stop by itself before the client gives up.
    pub most_stops: usize,
}

impl Default for ClientSettings {
    fn default() -> Self {
        Self {
            // Chosen by hand: 15 control periods at 60 Hz, and the usual jitter of a network.
            valid_for_s: 0.25,
            over_s: 0.05,
            speed: 1.0,
            workspace_m: None,
            state_rate_hz: 250.0,
            patience_s: 5.0,
            most_stops: 3,
        }
    }
}

/// Counts of what happened between client and bridge.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Tally {
    /// Number of commands sent.
    pub commands: usize,
    /// Number of starts, the first included.
    pub starts: usize,
    /// Refused requests by word.
    pub refused: BTreeMap<String, usize>,
    /// Number of times that the arm stopped by itself.
    pub arm_stops: usize,
    /// Error words that the arm reported.
    pub errors: BTreeMap<String, usize>,
}

/// Arm behind a bridge.
pub struct ArmClient<C> {
    connection: C,
    settings: ClientSettings,
    welcome: Welcome,
    state: State,
    lease: Option<u64>,
    sequence: u64,
    /// Measured joint positions of the last moments, with their times on the bridge's clock.
    past: VecDeque<(f64, Vec<f64>)>,
    /// Time of the last start on the bridge's clock, s; `None` while the arm stands.
    started_s: Option<f64>,
    /// True while a person holds the dead-man's switch.
    dead_man: Arc<AtomicBool>,
    tally: Tally,
}

impl<C: Connection> ArmClient<C> {
    /// Connects to a bridge and waits for the first state; the arm stays still, and nobody else is locked out.
    ///
    /// # Errors
    /// If the bridge does not answer, or speaks another protocol.
    pub fn connect(
        mut connection: C,
        settings: ClientSettings,
        dead_man: Arc<AtomicBool>,
    ) -> Result<Self, BridgeError> {
        connection.send(&Request::Hello { protocol: PROTOCOL.into(), state_rate_hz: settings.state_rate_hz })?;
        let until_s = connection.now_s() + settings.patience_s;
        let (mut welcome, mut state) = (None, None);
        while welcome.is_none() || state.is_none() {
            match connection.receive(until_s)? {
                Some(Reply::Welcome(facts)) => welcome = Some(facts),
                Some(Reply::State(first)) => state = Some(first),
                Some(Reply::Refused { request, word, message, .. }) => {
                    return Err(BridgeError::Refused { request, word, message });
                }
                Some(_) => {}
                None => return Err(BridgeError::Silent { request: "hello", patience_s: settings.patience_s }),
            }
        }
        let (Some(welcome), Some(state)) = (welcome, state) else { unreachable!("both are there") };
        let (lease, started_s, tally) = (None, None, Tally::default());
        let past = VecDeque::new();
        Ok(Self { connection, settings, welcome, state, lease, sequence: 0, past, started_s, dead_man, tally })
    }

    /// Facts about the robot.
    pub fn welcome(&self) -> &Welcome {
        &self.welcome
    }

    /// Settings of the client.
    pub fn settings(&self) -> &ClientSettings {
        &self.settings
    }

    /// Latest state that has arrived.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Measured joint positions nearest to a time on the bridge's clock, rad or m.
    pub fn positions_at(&self, time_s: f64) -> &[f64] {
        let off = |entry: &&(f64, Vec<f64>)| (entry.0 - time_s).abs();
        let nearest = self.past.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        nearest.map_or(&self.state.positions, |(_, positions)| positions)
    }

    /// Counts so far.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Connection to the bridge.
    pub fn connection(&self) -> &C {
        &self.connection
    }

    /// Connection to the bridge, to be changed.
    pub fn connection_mut(&mut self) -> &mut C {
        &mut self.connection
    }

    /// Time on the client's clock, s.
    pub fn now_s(&self) -> f64 {
        self.connection.now_s()
    }

    /// Latest image of a camera of the bridge.
    ///
    /// # Errors
    /// As [`Connection::image`].
    pub fn image(&mut self, camera: &str, size: Option<[u32; 2]>) -> Result<CameraImage, BridgeError> {
        self.connection.image(camera, size)
    }

    /// Sends target joint positions and the target width of the gripper; starts the arm first if it stands.
    ///
    /// # Errors
    /// If a person or the arm itself stopped it for good, or the connection is lost. Refused commands are counted.
    pub fn command(&mut self, positions: &[f64], width_m: f64) -> Result<(), BridgeError> {
        self.wait(self.connection.now_s())?;
        if !self.dead_man.load(Ordering::Relaxed) {
            self.release()?;
            return Err(BridgeError::Person);
        }
        if self.started_s.is_none() {
            self.start()?;
        }
        let Some(lease) = self.lease else { return Ok(()) };
        self.sequence += 1;
        self.tally.commands += 1;
        self.connection.send(&Request::Command(Command {
            lease,
            sequence: self.sequence,
            valid_for_s: self.settings.valid_for_s.min(self.welcome.longest_validity_s),
            dead_man: true,
            positions: positions.to_vec(),
            over_s: self.settings.over_s,
            width_m: Some(width_m),
        }))
    }

    /// Processes what arrives until `until_s` on the client's clock.
    ///
    /// # Errors
    /// If the connection is lost.
    pub fn wait(&mut self, until_s: f64) -> Result<(), BridgeError> {
        while let Some(reply) = self.connection.receive(until_s)? {
            self.absorb(reply);
        }
        Ok(())
    }

    /// Stops the arm and returns the lease; waits until the arm stands.
    ///
    /// # Errors
    /// If the connection is lost.
    pub fn release(&mut self) -> Result<(), BridgeError> {
        let Some(lease) = self.lease.take() else { return Ok(()) };
        self.started_s = None;
        self.connection.send(&Request::Release { lease, keep: false })?;
        let until_s = self.connection.now_s() + self.settings.patience_s;
        let before_s = self.state.time_s;
        while !(self.state.motion == Motion::Standing && self.state.time_s > before_s) {
            match self.connection.receive(until_s)? {
                Some(reply) => self.absorb(reply),
                None => return Err(BridgeError::Silent { request: "release", patience_s: self.settings.patience_s }),
            }
        }
        Ok(())
    }

    /// Starts the arm, once it stands and its errors are cleared.
    fn start(&mut self) -> Result<(), BridgeError> {
        let until_s = self.connection.now_s() + self.settings.patience_s;
        loop {
            let has_failed =
                self.state.recovery == Recovery::GivenUp || self.tally.arm_stops > self.settings.most_stops;
            let patient = self.connection.now_s() < until_s;
            if has_failed || !self.state.errors.is_empty() && !patient {
                let errors = self.tally.errors.keys().cloned().collect();
                return Err(BridgeError::Arm { stops: self.tally.arm_stops, errors });
            }
            if self.state.motion != Motion::Braking && self.state.errors.is_empty() {
                break;
            }
            match self.connection.receive(until_s)? {
                Some(reply) => self.absorb(reply),
                None if self.state.errors.is_empty() => {
                    return Err(BridgeError::Silent { request: "state", patience_s: self.settings.patience_s });
                }
                None => {}
            }
        }
        loop {
            let Some(lease) = self.lease else {
                let Reply::Lease { lease } = self.ask(&Request::Acquire {}, until_s)? else { continue };
                (self.lease, self.sequence) = (Some(lease), 0);
                continue;
            };
            let request = Request::Start {
                lease,
                dead_man: true,
                speed: self.settings.speed.min(self.welcome.top_speed),
                workspace_m: self.settings.workspace_m,
            };
            match self.ask(&request, until_s) {
                Ok(Reply::Started { time_s }) => {
                    self.started_s = Some(time_s);
                    self.tally.starts += 1;
                    return Ok(());
                }
                Ok(_) => {}
                // The lease has ended while the policy was thinking: acquire another.
                Err(BridgeError::Refused { word, .. }) if word == "no_lease" => self.lease = None,
                // The state was older than a stop.
                Err(BridgeError::Refused { word, .. })
                    if (word == "moving" || word == "arm_errors") && self.connection.now_s() < until_s =>
                {
                    self.wait(self.connection.now_s() + 0.02)?;
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// Sends a request and waits for its answer.
    fn ask(&mut self, request: &Request, until_s: f64) -> Result<Reply, BridgeError> {
        self.connection.send(request)?;
        loop {
            match self.connection.receive(until_s)? {
                Some(Reply::Refused { request: name, word, message, .. }) if name == request.name() => {
                    return Err(BridgeError::Refused { request: name, word, message });
                }
                Some(reply @ (Reply::Lease { .. } | Reply::Started { .. })) => return Ok(reply),
                Some(reply) => self.absorb(reply),
                None => {
                    return Err(BridgeError::Silent { request: request.name(), patience_s: self.settings.patience_s });
                }
            }
        }
    }

    fn absorb(&mut self, reply: Reply) {
        match reply {
            Reply::State(state) if state.time_s > self.state.time_s => {
                if !state.errors.is_empty() && self.state.errors.is_empty() {
                    self.tally.arm_stops += 1;
                    for error in &state.errors {
                        *self.tally.errors.entry(error.clone()).or_default() += 1;
                    }
                }
                if state.motion != Motion::Following && self.started_s.is_some_and(|at_s| state.time_s > at_s) {
                    self.started_s = None;
                }
                self.past.push_back((state.measured_s, state.positions.clone()));
                if self.past.len() > PAST_STATES {
                    self.past.pop_front();
                }
                self.state = state;
            }
            Reply::Refused { word, .. } => {
                if word == "no_lease" {
                    (self.lease, self.started_s) = (None, None);
                }
                *self.tally.refused.entry(word).or_default() += 1;
            }
            _ => {}
        }
    }
}

impl<C: std::fmt::Debug> std::fmt::Debug for ArmClient<C> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ArmClient").field("connection", &self.connection).finish_non_exhaustive()
    }
}

/// TCP connection to a bridge, on the wall clock.
#[derive(Debug)]
pub struct TcpConnection {
    address: String,
    stream: TcpStream,
    arrived: Receiver<Arrived>,
    /// Replies that arrived while an image was awaited.
    set_aside: VecDeque<Reply>,
    clock: Clock,
}

#[derive(Debug)]
enum Arrived {
    Reply(Reply),
    Image(CameraImage),
    Lost(String),
}

impl TcpConnection {
    /// Connects to `tcp://HOST:PORT`.
    ///
    /// # Errors
    /// For another form of address, or if nothing answers.
    pub fn open(url: &str) -> Result<Self, BridgeError> {
        let address = url.strip_prefix(SCHEME).ok_or_else(|| BridgeError::Address(url.into()))?;
        let lost = |reason: std::io::Error| BridgeError::Connection { address: url.into(), reason: reason.to_string() };
        let mut candidates = address.to_socket_addrs().map_err(|_| BridgeError::Address(url.into()))?;
        let target = candidates.next().ok_or_else(|| BridgeError::Address(url.into()))?;
        let stream = TcpStream::connect_timeout(&target, CONNECT_TIMEOUT).map_err(lost)?;
        stream.set_nodelay(true).map_err(lost)?;
        stream.set_write_timeout(Some(CONNECT_TIMEOUT)).map_err(lost)?;
        let (sender, arrived) = channel();
        let reading = stream.try_clone().map_err(lost)?;
        thread::spawn(move || {
            let why = read_all(reading, &sender);
            // The client may have gone.
            let _ = sender.send(Arrived::Lost(why));
        });
        Ok(Self { address: url.into(), stream, arrived, set_aside: VecDeque::new(), clock: Clock::new() })
    }

    /// Next arrival; `None` at `until_s`.
    fn next(&mut self, until_s: f64) -> Result<Option<Arrived>, BridgeError> {
        let left_s = (until_s - self.clock.now_s()).max(0.0);
        match self.arrived.recv_timeout(Duration::try_from_secs_f64(left_s).unwrap_or(CONNECT_TIMEOUT)) {
            Ok(Arrived::Lost(reason)) => Err(BridgeError::Connection { address: self.address.clone(), reason }),
            Ok(arrived) => Ok(Some(arrived)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => {
                Err(BridgeError::Connection { address: self.address.clone(), reason: "it was closed".into() })
            }
        }
    }
}

impl Connection for TcpConnection {
    fn now_s(&self) -> f64 {
        self.clock.now_s()
    }

    fn send(&mut self, request: &Request) -> Result<(), BridgeError> {
        let written = serde_json::to_vec(request).map_err(std::io::Error::from).and_then(|mut line| {
            line.push(b'\n');
            self.stream.write_all(&line)
        });
        written.map_err(|error| BridgeError::Connection { address: self.address.clone(), reason: error.to_string() })
    }

    fn receive(&mut self, until_s: f64) -> Result<Option<Reply>, BridgeError> {
        if let Some(reply) = self.set_aside.pop_front() {
            return Ok(Some(reply));
        }
        loop {
            match self.next(until_s)? {
                Some(Arrived::Reply(reply)) => return Ok(Some(reply)),
                // An image that came too late.
                Some(_) => {}
                None => return Ok(None),
            }
        }
    }

    fn image(&mut self, camera: &str, size: Option<[u32; 2]>) -> Result<CameraImage, BridgeError> {
        let patience_s = CONNECT_TIMEOUT.as_secs_f64();
        self.send(&Request::Image { camera: camera.into(), size })?;
        let until_s = self.clock.now_s() + patience_s;
        loop {
            match self.next(until_s)? {
                Some(Arrived::Image(image)) if image.head.camera == camera => return Ok(image),
                Some(Arrived::Reply(Reply::Refused { request, word, message, .. })) if request == "?" => {
                    return Err(BridgeError::Refused { request: "image".into(), word, message });
                }
                Some(Arrived::Reply(reply)) => self.set_aside.push_back(reply),
                Some(_) => {}
                None => return Err(BridgeError::Silent { request: "image", patience_s }),
            }
        }
    }
}

impl Drop for TcpConnection {
    fn drop(&mut self) {
        // The reader's thread ends with the connection.
        let _ = self.stream.shutdown(std::net::Shutdown::Both);
    }
}

/// Reads replies until the connection closes; returns the reason.
fn read_all(stream: TcpStream, sender: &Sender<Arrived>) -> String {
    let mut reader = BufReader::new(stream);
    loop {
        match read(&mut reader) {
            Ok(arrived) => {
                if sender.send(arrived).is_err() {
                    return "nobody listens".into();
                }
            }
            Err(why) => return why,
        }
    }
}

fn read(reader: &mut impl BufRead) -> Result<Arrived, String> {
    let mut line = Vec::new();
    reader.by_ref().take(MAX_LINE).read_until(b'\n', &mut line).map_err(|error| error.to_string())?;
    if !line.ends_with(b"\n") {
        return Err("it was closed".into());
    }
    let reply = serde_json::from_slice(&line).map_err(|error| format!("it sent no message of {PROTOCOL}: {error}"))?;
    let Reply::Image(head) = reply else { return Ok(Arrived::Reply(reply)) };
    if head.width > MAX_SIDE_PX || head.height > MAX_SIDE_PX {
        return Err(format!("it sent an image of {} x {} pixels", head.width, head.height));
    }
    let (mut rgb, mut depth) = (vec![0; head.color_bytes()], vec![0; head.depth_bytes()]);
    let read = reader.read_exact(&mut rgb).and_then(|()| reader.read_exact(&mut depth));
    read.map_err(|error| error.to_string())?;
    let depth_m = depth.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    Ok(Arrived::Image(CameraImage { head, rgb, depth_m }))
}

impl ImageHead {
    fn color_bytes(&self) -> usize {
        3 * self.width as usize * self.height as usize
    }

    fn depth_bytes(&self) -> usize {
        if self.has_depth { 4 * self.width as usize * self.height as usize } else { 0 }
    }
}
