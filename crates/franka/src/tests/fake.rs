//! Arm and hand on loopback that speak as much of Franka's protocol as the driver uses; the arm is its setpoint, one
//! millisecond late.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use franka::wire::gripper::GripperState;
use franka::wire::robot::RobotState;
use zerocopy::IntoBytes;
use zerocopy::little_endian::{F32, F64, U32, U64};

/// Values of the protocol: modes, and states of a move.
const IDLE: u8 = 1;
const MOVING: u8 = 2;
const REFLEX: u8 = 4;
const STARTED: u8 = 1;
const PREEMPTED: u8 = 2;
const NOT_POSSIBLE: u8 = 5;
const REFLEX_ABORTED: u8 = 8;
/// Number of the error `cartesian_reflex`.
const CARTESIAN_REFLEX: usize = 7;

/// Model of an arm with what the client reads of it.
fn urdf() -> String {
    let joint = |number: usize| {
        format!(
            "<joint name=\"joint{number}\"><limit lower=\"-3\" upper=\"3\" velocity=\"2.62\"/>\
             <position_based_velocity_limits deceleration_limit=\"6\" velocity_offset=\"0.3\"/></joint>"
        )
    };
    format!("<robot name=\"fake\">{}</robot>", (1..=7).map(joint).collect::<String>())
}

/// Behaviour of the fake, and what it has seen.
#[derive(Clone, Debug, Default)]
pub struct Facts {
    /// Positions that the arm's controller holds, rad.
    pub held: [f64; 7],
    /// Setpoints received, each with the number of the state that it answers, over all motions.
    pub setpoints: Vec<(u64, [f64; 7])>,
    /// Number of motions that ended as wanted.
    pub finished: usize,
    /// True to stop by a reflex at the next state.
    pub trip: bool,
    /// Number of states that are lost from now on.
    pub lose: u64,
    /// True while the arm waits for recovery.
    pub has_reflex: bool,
    /// Commands of the hand: number in the protocol and first number of its request, m.
    pub commands: Vec<(u16, f64)>,
    /// Opening of the hand, m.
    pub width_m: f64,
    /// Width of an object between the fingers, m: a command that meets it is not answered.
    pub object_m: f64,
}

/// Fake that runs until it is dropped.
pub struct Fake {
    /// HOST:PORT.
    pub address: String,
    facts: Arc<Mutex<Facts>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Fake {
    pub fn arm(held: [f64; 7]) -> Self {
        Self::run(Facts { held, ..Facts::default() }, Link::serve_arm)
    }

    pub fn hand(width_m: f64) -> Self {
        Self::run(Facts { width_m, ..Facts::default() }, Link::serve_hand)
    }

    pub fn facts(&self) -> MutexGuard<'_, Facts> {
        self.facts.lock().unwrap()
    }

    fn run(facts: Facts, serve: fn(&mut Link, &Mutex<Facts>)) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let (facts, stop) = (Arc::new(Mutex::new(facts)), Arc::new(AtomicBool::new(false)));
        let (shared, stopped) = (Arc::clone(&facts), Arc::clone(&stop));
        let thread = thread::spawn(move || {
            while !stopped.load(Ordering::Relaxed) {
                let Ok((stream, peer)) = listener.accept() else {
                    thread::sleep(Duration::from_millis(1));
                    continue;
                };
                let mut link = Link::new(stream, peer);
                while !stopped.load(Ordering::Relaxed) && link.is_open {
                    serve(&mut link, &shared);
                    thread::sleep(Duration::from_millis(1));
                }
            }
        });
        Self { address, facts, stop, thread: Some(thread) }
    }
}

impl Drop for Fake {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().map(JoinHandle::join);
    }
}

/// Connection to one client.
struct Link {
    stream: TcpStream,
    peer: SocketAddr,
    udp: UdpSocket,
    is_open: bool,
    received: Vec<u8>,
    /// Address for states; `None` before `Connect`.
    states: Option<SocketAddr>,
    number: u64,
    /// Number of the running move or of the hand's command.
    running: Option<(u16, u32)>,
}

impl Link {
    fn new(stream: TcpStream, peer: SocketAddr) -> Self {
        let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
        udp.set_nonblocking(true).unwrap();
        stream.set_nonblocking(true).unwrap();
        stream.set_nodelay(true).unwrap();
        Self { stream, peer, udp, is_open: true, received: Vec::new(), states: None, number: 0, running: None }
    }

    /// Next message: command, its number and its content; `head` is the length of the header.
    fn message(&mut self, head: usize) -> Option<(u16, u32, Vec<u8>)> {
        let mut chunk = [0; 1024];
        match self.stream.read(&mut chunk) {
            Ok(0) => self.is_open = false,
            Ok(count) => self.received.extend(&chunk[..count]),
            Err(error) => self.is_open &= error.kind() == ErrorKind::WouldBlock,
        }
        let word = |at: usize| Some(u32::from_le_bytes(*self.received.get(at..at + 4)?.as_array()?));
        let (id, size) = (word(head - 8)?, word(head - 4)? as usize);
        let command = u16::from_le_bytes([self.received[0], self.received[1]]);
        let content = self.received.get(head..size)?.to_vec();
        self.received.drain(..size);
        Some((command, id, content))
    }

    fn answer(&mut self, head: usize, command: u16, id: u32, content: &[u8]) {
        let mut message = u32::from(command).to_le_bytes()[..head - 8].to_vec();
        message.extend(id.to_le_bytes());
        message.extend(((head + content.len()) as u32).to_le_bytes());
        message.extend(content);
        self.is_open &= self.stream.write_all(&message).is_ok();
    }

    /// Notes where states go, from the content of `Connect`.
    fn connect(&mut self, content: &[u8]) {
        let port = u16::from_le_bytes([content[2], content[3]]);
        self.states = Some(SocketAddr::new(self.peer.ip(), port));
    }

    fn serve_arm(&mut self, facts: &Mutex<Facts>) {
        const HEAD: usize = 12;
        let mut facts = facts.lock().unwrap();
        while let Some((command, id, content)) = self.message(HEAD) {
            match command {
                0 => {
                    self.connect(&content);
                    self.answer(HEAD, command, id, &[0, 10, 0]);
                }
                1 if facts.has_reflex => self.answer(HEAD, command, id, &[NOT_POSSIBLE]),
                1 => {
                    self.running = Some((command, id));
                    self.answer(HEAD, command, id, &[STARTED]);
                }
                2 => {
                    self.answer(HEAD, command, id, &[0]);
                    if let Some((command, id)) = self.running.take() {
                        self.answer(HEAD, command, id, &[PREEMPTED]);
                    }
                }
                10 => {
                    facts.has_reflex = false;
                    self.answer(HEAD, command, id, &[0]);
                }
                11 => self.answer(HEAD, command, id, &[[0].as_slice(), urdf().as_bytes()].concat()),
                other => panic!("the driver sent command {other}"),
            }
        }
        let mut command = [0; 512];
        while let Ok(length) = self.udp.recv(&mut command) {
            assert_eq!(length, 371);
            let number = |at: usize| f64::from_le_bytes(*command[at..at + 8].as_array().unwrap());
            let Some((running, id)) = self.running else { continue };
            facts.held = std::array::from_fn(|joint| number(8 + 8 * joint));
            let entry = (u64::from_le_bytes(*command[..8].as_array().unwrap()), facts.held);
            facts.setpoints.push(entry);
            // After message, joints, joint velocities, pose, twist, elbow and its validity.
            if command[8 + 56 + 56 + 128 + 48 + 16 + 1] == 1 {
                self.running = None;
                facts.finished += 1;
                self.answer(HEAD, running, id, &[0]);
            }
        }
        if std::mem::take(&mut facts.trip) {
            facts.has_reflex = true;
            if let Some((command, id)) = self.running.take() {
                self.answer(HEAD, command, id, &[REFLEX_ABORTED]);
            }
        }
        self.number += 1;
        if facts.lose > 0 {
            facts.lose -= 1;
            return;
        }
        let is_moving = self.running.is_some();
        let mode = if facts.has_reflex { REFLEX } else { if is_moving { MOVING } else { IDLE } };
        let mut state = RobotState {
            message_id: U64::new(self.number),
            // The measured position is a little off the one that the controller holds.
            q: facts.held.map(|position| F32::new((position + 1e-3) as f32)),
            q_d: facts.held.map(|position| F32::new(position as f32)),
            motion_generator_mode: u8::from(is_moving),
            controller_mode: if is_moving { 0 } else { 3 },
            robot_mode: mode,
            ..RobotState::default()
        };
        state.errors[CARTESIAN_REFLEX] = u8::from(facts.has_reflex);
        state.reflex_reason[CARTESIAN_REFLEX] = u8::from(facts.has_reflex);
        self.send(state.as_bytes());
    }

    fn serve_hand(&mut self, facts: &Mutex<Facts>) {
        const HEAD: usize = 10;
        let mut facts = facts.lock().unwrap();
        while let Some((command, id, content)) = self.message(HEAD) {
            let width_m = content.first_chunk().map_or(0.0, |bytes| f64::from_le_bytes(*bytes));
            match command {
                0 => {
                    self.connect(&content);
                    self.answer(HEAD, command, id, &[0, 0, 3, 0]);
                    continue;
                }
                4 => {
                    self.answer(HEAD, command, id, &[0, 0]);
                    if let Some((command, id)) = self.running.take() {
                        self.answer(HEAD, command, id, &[3, 0]);
                    }
                }
                _ => {
                    assert!(self.running.is_none(), "a command while another one is executed");
                    facts.width_m = width_m.max(facts.object_m);
                    match facts.width_m == width_m {
                        true => self.answer(HEAD, command, id, &[0, 0]),
                        false => self.running = Some((command, id)),
                    }
                }
            }
            facts.commands.push((command, width_m));
        }
        self.number += 1;
        let width = F64::new(facts.width_m);
        let state = GripperState { message_id: U32::new(self.number as u32), width, ..GripperState::default() };
        self.send(state.as_bytes());
    }

    fn send(&self, state: &[u8]) {
        if let Some(to) = self.states {
            // The client may be gone.
            let _ = self.udp.send_to(state, to);
        }
    }
}
