//! Server of the bridge: connections, clock and control loop around a [`Bridge`].

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, BufWriter, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::sync::{Arc, PoisonError, RwLock};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use genmanip_core::Seed;

use super::link::{Link, LinkSettings};
use super::machine::{Bridge, Orders, Reading};
use super::message::{CameraImage, PROTOCOL, Reply, Request, Welcome};

/// Longest line of a request, bytes.
const MAX_LINE: u64 = 64 << 10;
/// Largest number of connections.
const MAX_CONNECTIONS: usize = 8;
/// Replies that wait for a slow client before states are dropped.
const QUEUED: usize = 256;
/// Time in which a client must take a message, s; then its connection is closed.
const WRITE_TIMEOUT: Duration = Duration::from_secs(2);
/// Time for the arm to come to rest at the end of the server, s.
const FAREWELL_S: f64 = 2.0;

/// Connection to an arm.
pub trait Driver {
    /// Waits for the next control period; returns its measurements. While the arm moves, periods last `tick_s`.
    ///
    /// # Errors
    /// If the connection to the arm is lost for good.
    fn read(&mut self) -> Result<Reading, DriverError>;

    /// Sends the orders of the control period.
    ///
    /// # Errors
    /// If the connection to the arm is lost for good.
    fn write(&mut self, orders: &Orders) -> Result<(), DriverError>;
}

/// Loss of the connection to the arm.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct DriverError(pub String);

/// Cameras whose images a bridge sends.
pub trait ImageSource: Send + Sync {
    /// Names of the cameras.
    fn cameras(&self) -> Vec<String>;

    /// Latest image of a camera, of the wanted size if the camera can do that.
    ///
    /// # Errors
    /// Message about an unknown camera or a failure.
    fn image(&self, camera: &str, size: Option<[u32; 2]>) -> Result<CameraImage, String>;
}

/// A bridge without cameras.
#[derive(Clone, Copy, Debug)]
pub struct NoImages;

impl ImageSource for NoImages {
    fn cameras(&self) -> Vec<String> {
        Vec::new()
    }

    fn image(&self, camera: &str, _size: Option<[u32; 2]>) -> Result<CameraImage, String> {
        Err(format!("this bridge has no camera `{camera}`: it sends no images"))
    }
}

/// Clock of a bridge.
#[derive(Clone, Copy, Debug)]
pub struct Clock(Instant);

impl Clock {
    /// Clock that starts now.
    #[expect(clippy::new_without_default, reason = "the time of the call matters")]
    pub fn new() -> Self {
        Self(Instant::now())
    }

    /// Time since the start, s.
    pub fn now_s(&self) -> f64 {
        self.0.elapsed().as_secs_f64()
    }
}

/// Flaws of the connection that a rehearsal adds, from and to the client.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flaws {
    /// Flaws of each direction.
    pub link: LinkSettings,
    /// Seed of the delays and losses.
    pub seed: Seed,
}

impl Flaws {
    /// No flaws.
    pub fn none() -> Self {
        Self { link: LinkSettings::default(), seed: Seed::new(0) }
    }
}

/// Regularity of a control loop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoopReport {
    /// Number of control periods.
    pub ticks: usize,
    /// Number of periods that lasted more than twice as long as they should.
    pub late: usize,
    /// Longest period, s.
    pub longest_s: f64,
}

/// Event that the threads of a connection report to the control loop.
enum Event {
    Opened(u64, SyncSender<Outgoing>),
    Request(u64, Result<Request, String>),
    Closed(u64),
}

/// Camera and size of a wanted image.
type Wanted = (String, Option<[u32; 2]>);

enum Outgoing {
    Reply(Reply),
    Image(CameraImage),
}

struct Client {
    outgoing: SyncSender<Outgoing>,
    /// Time between states, s; `None` before the first message.
    state_every_s: Option<f64>,
    next_state_s: f64,
}

/// Runs the control loop until `stop` is set, then brakes; serves all clients of the listener meanwhile.
///
/// # Errors
/// If the listener fails, or the connection to the arm is lost for good.
pub fn serve(
    listener: TcpListener,
    mut bridge: Bridge,
    driver: &mut dyn Driver,
    images: Arc<dyn ImageSource>,
    flaws: Flaws,
    clock: Clock,
    stop: &AtomicBool,
) -> Result<LoopReport, DriverError> {
    let (events, incoming) = channel();
    let welcome = Arc::new(bridge.welcome(images.cameras()));
    listener.set_nonblocking(false).map_err(|error| DriverError(format!("the listener fails: {error}")))?;
    let count = Arc::new(RwLock::new(0_usize));
    thread::spawn(move || accept(&listener, &events, &images, &welcome, &count));
    let mut desk = Desk {
        incoming,
        clients: BTreeMap::new(),
        holder: None,
        requests: Link::new(flaws.link, flaws.seed.fork("requests")),
        replies: Link::new(flaws.link, flaws.seed.fork("replies")),
    };
    let tick_s = bridge.tick_s();
    let mut report = LoopReport::default();
    let (mut last_s, mut farewell_s) = (None, None);
    loop {
        let reading = driver.read()?;
        let now_s = clock.now_s();
        let period_s = last_s.replace(now_s).map_or(tick_s, |before: f64| now_s - before);
        report.ticks += 1;
        report.late += usize::from(period_s > 2.0 * tick_s);
        report.longest_s = report.longest_s.max(period_s);
        desk.serve(now_s, &mut bridge);
        let orders = bridge.tick(now_s, reading);
        driver.write(&orders)?;
        desk.send(now_s, &bridge);
        if stop.load(Ordering::Relaxed) {
            let until_s = *farewell_s.get_or_insert(now_s + FAREWELL_S);
            bridge.close(now_s);
            if bridge.is_at_rest() || now_s > until_s {
                return Ok(report);
            }
        }
    }
}

/// Clients of the control loop, and their messages under way.
struct Desk {
    incoming: Receiver<Event>,
    clients: BTreeMap<u64, Client>,
    /// Client that holds the lease, and its number.
    holder: Option<(u64, u64)>,
    requests: Link<(u64, Result<Request, String>)>,
    replies: Link<(u64, Reply)>,
}

impl Desk {
    /// Processes what has arrived.
    fn serve(&mut self, now_s: f64, bridge: &mut Bridge) {
        while let Ok(event) = self.incoming.try_recv() {
            match event {
                Event::Opened(id, outgoing) => {
                    self.clients.insert(id, Client { outgoing, state_every_s: None, next_state_s: 0.0 });
                }
                Event::Closed(id) => {
                    self.clients.remove(&id);
                    if let Some((_, lease)) = self.holder.take_if(|(holder, _)| *holder == id) {
                        bridge.disconnected(now_s, lease);
                    }
                }
                Event::Request(id, request) => {
                    let is_streamed = request.as_ref().is_ok_and(Request::is_streamed);
                    self.requests.send(now_s, (id, request), is_streamed);
                }
            }
        }
        while let Some((id, request)) = self.requests.receive(now_s) {
            let reply = match request {
                Ok(Request::Hello { state_rate_hz, .. }) => {
                    if let Some(client) = self.clients.get_mut(&id) {
                        client.state_every_s = Some(1.0 / state_rate_hz.clamp(1.0, 1000.0));
                    }
                    None
                }
                // A client that has gone gets no lease, which nobody would return.
                Ok(_) if !self.clients.contains_key(&id) => None,
                Ok(request) => bridge.handle(now_s, &request),
                Err(why) => Some(Reply::malformed(why)),
            };
            if let Some(Reply::Lease { lease }) = &reply {
                self.holder = Some((id, *lease));
            }
            if let Some(reply) = reply {
                self.replies.send(now_s, (id, reply), false);
            }
        }
    }

    /// Sends states that are due, and all replies that have arrived.
    fn send(&mut self, now_s: f64, bridge: &Bridge) {
        for (&id, client) in &mut self.clients {
            if let Some(every_s) = client.state_every_s.filter(|_| now_s >= client.next_state_s) {
                client.next_state_s = (client.next_state_s + every_s).max(now_s);
                self.replies.send(now_s, (id, Reply::State(bridge.state(now_s))), true);
            }
        }
        while let Some((id, reply)) = self.replies.receive(now_s) {
            let Some(client) = self.clients.get(&id) else { continue };
            let is_streamed = reply.is_streamed();
            if let Err(TrySendError::Full(_)) = client.outgoing.try_send(Outgoing::Reply(reply))
                && !is_streamed
            {
                // A client that takes no replies is as good as gone; its writer ends with the channel.
                self.clients.remove(&id);
            }
        }
    }
}

/// Accepts connections until the listener or the control loop ends.
fn accept(
    listener: &TcpListener,
    events: &Sender<Event>,
    images: &Arc<dyn ImageSource>,
    welcome: &Arc<Welcome>,
    count: &Arc<RwLock<usize>>,
) {
    for (id, stream) in listener.incoming().enumerate() {
        let Ok(stream) = stream else { continue };
        let mut open = count.write().unwrap_or_else(PoisonError::into_inner);
        if *open >= MAX_CONNECTIONS {
            continue;
        }
        *open += 1;
        drop(open);
        let (events, images, welcome, count) =
            (events.clone(), Arc::clone(images), Arc::clone(welcome), Arc::clone(count));
        thread::spawn(move || {
            let id = id as u64;
            let writer = converse(&stream, id, &events, &images, &welcome);
            // The control loop may have ended.
            let _ = events.send(Event::Closed(id));
            // The writer ends when nobody has anything to write any more.
            let _ = writer.map(JoinHandle::join);
            let _ = stream.shutdown(Shutdown::Both);
            *count.write().unwrap_or_else(PoisonError::into_inner) -= 1;
        });
    }
}

/// Reads the requests of a connection until it closes; returns the thread that writes the replies.
fn converse(
    stream: &TcpStream,
    id: u64,
    events: &Sender<Event>,
    images: &Arc<dyn ImageSource>,
    welcome: &Welcome,
) -> Option<JoinHandle<()>> {
    stream.set_nodelay(true).and_then(|()| stream.set_write_timeout(Some(WRITE_TIMEOUT))).ok()?;
    let (reading, writing) = (stream.try_clone().ok()?, stream.try_clone().ok()?);
    let (outgoing, replies) = sync_channel(QUEUED);
    let writer = thread::spawn(move || {
        write_all(&writing, &replies);
        let _ = writing.shutdown(Shutdown::Both);
    });
    let (asked, requests) = sync_channel(4);
    let (source, sender) = (Arc::clone(images), outgoing.clone());
    thread::spawn(move || photograph(&requests, source.as_ref(), &sender));
    let mut reader = BufReader::new(reading);
    let mut is_welcome = false;
    loop {
        let mut line = Vec::new();
        match reader.by_ref().take(MAX_LINE).read_until(b'\n', &mut line) {
            Ok(length) if length > 0 && line.ends_with(b"\n") => {}
            _ => break,
        }
        let request: Result<Request, String> =
            serde_json::from_slice(&line).map_err(|error| format!("the line is no request of {PROTOCOL}: {error}"));
        match &request {
            Ok(Request::Hello { protocol, .. }) => {
                if protocol != PROTOCOL {
                    let why = format!("this bridge speaks {PROTOCOL}; the client asked for {protocol:?}");
                    let _ = outgoing.try_send(Outgoing::Reply(Reply::malformed(why)));
                    break;
                }
                let _ = outgoing.try_send(Outgoing::Reply(Reply::Welcome(welcome.clone())));
                if !std::mem::replace(&mut is_welcome, true)
                    && events.send(Event::Opened(id, outgoing.clone())).is_err()
                {
                    break;
                }
            }
            _ if !is_welcome => {
                let why = format!("expected a first line {{\"type\": \"hello\", \"protocol\": \"{PROTOCOL}\", …}}");
                let _ = outgoing.try_send(Outgoing::Reply(Reply::malformed(why)));
                break;
            }
            Ok(Request::Image { camera, size }) => {
                if asked.try_send((camera.clone(), *size)).is_err() {
                    let why = "four images are already under way; wait for them".to_owned();
                    let _ = outgoing.try_send(Outgoing::Reply(Reply::malformed(why)));
                }
                continue;
            }
            _ => {}
        }
        if events.send(Event::Request(id, request)).is_err() {
            break;
        }
    }
    Some(writer)
}

/// Answers the requests for images of a connection.
fn photograph(requests: &Receiver<Wanted>, source: &dyn ImageSource, outgoing: &SyncSender<Outgoing>) {
    for (camera, size) in requests {
        let answer = match source.image(&camera, size) {
            Ok(image) => Outgoing::Image(image),
            Err(why) => Outgoing::Reply(Reply::malformed(why)),
        };
        if outgoing.send(answer).is_err() {
            return;
        }
    }
}

/// Writes messages until the connection or the channel closes.
fn write_all(stream: &TcpStream, messages: &Receiver<Outgoing>) {
    let mut writer = BufWriter::new(stream);
    for message in messages {
        let written = match &message {
            Outgoing::Reply(reply) => write_line(&mut writer, reply),
            Outgoing::Image(image) => write_line(&mut writer, &Reply::Image(image.head.clone())).and_then(|()| {
                writer.write_all(&image.rgb)?;
                let depth: Vec<u8> = image.depth_m.iter().flat_map(|depth_m| depth_m.to_le_bytes()).collect();
                writer.write_all(&depth)
            }),
        };
        if written.and_then(|()| writer.flush()).is_err() {
            return;
        }
    }
}

fn write_line(writer: &mut impl Write, reply: &Reply) -> std::io::Result<()> {
    serde_json::to_writer(&mut *writer, reply)?;
    writer.write_all(b"\n")
}
