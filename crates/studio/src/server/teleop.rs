//! WebSocket of teleoperation: device events and commands of a page, states and status of the take.
//!
//! ```text
//! page ─▶ start · events · gripper · go_to · pause · resume · back · hand_over · take_over · retry · keep · discard
//! page ◀─ started · status (both JSON) · states (binary) · refused
//! program beside the page ─▶ join · events
//! program beside the page ◀─ joined · refused
//! ```

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::response::{IntoResponse, Response};
use genmanip_assets::Catalogue;
use genmanip_core::{Atom, Goal, Pose};
use genmanip_rollout::Stage as Simulation;
use genmanip_teleop::TeleopSettings;
use genmanip_teleop::device::{Control, DeviceEvent};
use genmanip_teleop::mapping::OperatorFrame;
use genmanip_workspace::WorkspaceError;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::watch;

use super::answer::Refusal;
use super::jobs::{Job, Stage};
use super::room::Room;
use super::runs;
use super::socket::Open;
use super::studio::Studio;
use crate::run::playback;
use crate::teleop::session::{BACK_S, HORIZON_S};
use crate::teleop::{Phase, Request, Session, SessionSetup, SessionStatus, TakeCommand};

/// Label of takes among the episodes of a scenario.
pub const LABEL: &str = "teleop";
/// Maximum number of connections.
const MAX_CONNECTIONS: usize = 16;
/// Maximum size of a message, bytes: many times that of a page at 25 messages per second.
const MAX_MESSAGE: usize = 1 << 16;
/// Maximum length of a person's name, bytes.
const MAX_NAME: usize = 80;
/// Timeout for sending a message.
const SEND: Duration = Duration::from_secs(5);
/// Interval of status messages while nothing but numbers changes.
const STATUS: Duration = Duration::from_millis(100);

/// Message from a page.
#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
enum FromPage {
    /// Begins a session, or returns to the one of the scenario.
    Start {
        scenario: String,
        #[serde(default)]
        author: String,
        #[serde(default)]
        frame: OperatorFrame,
        #[serde(default)]
        camera: Option<String>,
        #[serde(default)]
        policy: Option<String>,
    },
    /// Lets this connection send the events of the session that a page has begun.
    Join {
        scenario: String,
    },
    Events {
        sequence: u64,
        #[serde(default)]
        sent_ms: f64,
        events: Vec<DeviceEvent>,
    },
    Gripper,
    /// Moves the tool to a pose, `world_from_tcp`, by the planner.
    GoTo {
        pose: Pose,
    },
    Pause,
    Resume,
    Back,
    HandOver {
        policy: String,
    },
    TakeOver,
    Retry,
    Keep {
        #[serde(default)]
        trim: bool,
    },
    Discard,
}

/// Accepts the connection of a page.
pub async fn connect(State(studio): State<Arc<Studio>>, upgrade: WebSocketUpgrade) -> Response {
    static OPEN: AtomicUsize = AtomicUsize::new(0);
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let Some(open) = Open::below(MAX_CONNECTIONS, &OPEN) else {
        let message = format!("{MAX_CONNECTIONS} pages teleoperate");
        return Refusal::Stopped { message, hint: "close some".into() }.into_response();
    };
    upgrade.max_message_size(MAX_MESSAGE).max_frame_size(MAX_MESSAGE).on_upgrade(async move |socket| {
        let _open = open;
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let mut connection = Connection { studio, number, attached: None, joined: None };
        connection.serve(socket).await;
        if let Some(attached) = connection.attached {
            attached.session.detach(number);
        }
        if let Some(session) = connection.joined {
            session.leave(number);
        }
    })
}

/// Connection of a page.
struct Connection {
    studio: Arc<Studio>,
    number: u64,
    attached: Option<Attached>,
    /// Session to which a program beside the page sends the events.
    joined: Option<Arc<Session>>,
}

/// Session that a connection is attached to, with its newest state and status.
struct Attached {
    session: Arc<Session>,
    states: watch::Receiver<Arc<Vec<u8>>>,
    status: watch::Receiver<SessionStatus>,
}

/// Next event to handle.
enum Next {
    Received(Option<Result<Message, axum::Error>>),
    State,
    Status,
}

impl Connection {
    /// Serves the page until it disconnects.
    async fn serve(&mut self, mut socket: WebSocket) {
        let mut told: Option<(Instant, SessionStatus)> = None;
        loop {
            let changes = async {
                match &mut self.attached {
                    Some(Attached { states, status, .. }) => tokio::select! {
                        Ok(()) = states.changed() => Next::State,
                        Ok(()) = status.changed() => Next::Status,
                        else => std::future::pending().await,
                    },
                    None => std::future::pending().await,
                }
            };
            let next = tokio::select! {
                received = socket.recv() => Next::Received(received),
                change = changes => change,
            };
            let message = match next {
                Next::Received(Some(Ok(Message::Text(text)))) => match self.received(text.as_str()).await {
                    Ok(None) => continue,
                    Ok(Some(answer)) => {
                        told = None;
                        Message::Text(answer.to_string().into())
                    }
                    Err(refusal) => refused(&refusal),
                },
                Next::Received(Some(Ok(Message::Binary(_)))) => refused(&unreadable("expected text, got bytes")),
                Next::Received(Some(Ok(Message::Ping(_) | Message::Pong(_)))) => continue,
                Next::Received(Some(Ok(Message::Close(_)) | Err(_)) | None) => return,
                Next::State => {
                    let Some(attached) = &mut self.attached else { continue };
                    Message::Binary(attached.states.borrow_and_update().to_vec().into())
                }
                Next::Status => {
                    let Some(attached) = &mut self.attached else { continue };
                    let now = attached.status.borrow_and_update().clone();
                    let is_due =
                        told.as_ref().is_none_or(|(at, before)| is_news(before, &now) || at.elapsed() >= STATUS);
                    if !is_due {
                        continue;
                    }
                    let message = json!({ "type": "status", "status": now });
                    told = Some((Instant::now(), now));
                    Message::Text(message.to_string().into())
                }
            };
            if !matches!(tokio::time::timeout(SEND, socket.send(message)).await, Ok(Ok(()))) {
                return;
            }
        }
    }

    /// Handles a message of the page.
    async fn received(&mut self, text: &str) -> Result<Option<Value>, Refusal> {
        let message: FromPage = serde_json::from_str(text).map_err(|error| unreadable(&error.to_string()))?;
        if let FromPage::Start { scenario, author, frame, camera, policy } = message {
            return self.start(scenario, &author, frame, camera, policy).await.map(Some);
        }
        if let FromPage::Join { scenario } = &message {
            return self.join(scenario).map(Some);
        }
        if let (Some(session), FromPage::Events { sequence, events, .. }) = (&self.joined, &message) {
            if session.status.borrow().phase.is_over() {
                return Err(Refusal::unsuited("the session is over", "join the next one"));
            }
            session.inbox.put_from_program(*sequence, events.clone(), Instant::now());
            return Ok(None);
        }
        let Some(Attached { session, .. }) = &self.attached else {
            return Err(Refusal::unsuited("no scenario is teleoperated", "send a `start` message first"));
        };
        match message {
            FromPage::Start { .. } | FromPage::Join { .. } => {}
            FromPage::Events { sequence, sent_ms, events } => {
                session.inbox.put(sequence, sent_ms, events, Instant::now());
            }
            FromPage::GoTo { pose } => session.ask(Request::GoTo(pose)),
            FromPage::Gripper => session.inbox.press(Control::Gripper),
            FromPage::Pause => session.set_command(TakeCommand::Pause),
            FromPage::Resume => session.set_command(TakeCommand::Run),
            FromPage::Retry => session.set_command(TakeCommand::Retry),
            FromPage::Back => session.ask(Request::Back),
            FromPage::HandOver { policy } => {
                runs::check_offered(&self.studio, &policy)?;
                session.ask(Request::HandOver(policy));
            }
            FromPage::TakeOver => session.ask(Request::TakeOver),
            FromPage::Keep { trim: false } => session.set_command(TakeCommand::Keep),
            FromPage::Keep { trim: true } => session.set_command(TakeCommand::KeepTrimmed),
            FromPage::Discard => session.set_command(TakeCommand::Discard),
        }
        Ok(None)
    }

    /// Joins the session that a page has begun on a scenario.
    fn join(&mut self, key: &str) -> Result<Value, Refusal> {
        let session = self.studio.teleoperations.newest(key).filter(|session| !session.status.borrow().phase.is_over());
        let Some(session) = session else {
            return Err(Refusal::unsuited("nobody teleoperates this scenario", "begin in the page first"));
        };
        if let Some(before) = self.joined.take() {
            before.leave(self.number);
        }
        if !session.join(self.number) {
            return Err(Refusal::unsuited("another program sends the events of this session", "end it first"));
        }
        let mut answer = session.about.clone();
        answer["type"] = json!("joined");
        self.joined = Some(session);
        Ok(answer)
    }

    async fn start(
        &mut self,
        key: String,
        author: &str,
        frame: OperatorFrame,
        camera: Option<String>,
        policy: Option<String>,
    ) -> Result<Value, Refusal> {
        if let Some(policy) = &policy {
            runs::check_offered(&self.studio, policy)?;
        }
        if let Some(attached) = self.attached.take() {
            attached.session.detach(self.number);
        }
        let author = if author.trim().is_empty() { self.studio.author.clone() } else { author.trim().to_owned() };
        if author.len() > MAX_NAME {
            return Err(Refusal::unsuited(format!("a name has at most {MAX_NAME} bytes"), ""));
        }
        let mut teleop = TeleopSettings { camera, ..TeleopSettings::default() };
        teleop.mapping.frame = frame;
        let (studio, number) = (Arc::clone(&self.studio), self.number);
        let runtime = tokio::runtime::Handle::current();
        let started = tokio::task::spawn_blocking(move || {
            open(&studio, &key, Opening { author, teleop, policy }, number, &runtime)
        })
        .await;
        let panicked = |_| Refusal::unsuited("the session panicked; please report this bug", "");
        let (session, answer) = started.map_err(panicked)??;
        let (mut states, mut status) = (session.states.subscribe(), session.status.subscribe());
        states.mark_changed();
        status.mark_changed();
        if states.borrow().is_empty() {
            states.mark_unchanged();
        }
        self.attached = Some(Attached { session, states, status });
        Ok(answer)
    }
}

/// True if a status differs from the one before in more than its numbers.
fn is_news(before: &SessionStatus, now: &SessionStatus) -> bool {
    let facts =
        |status: &SessionStatus| (status.phase, status.take, status.held, status.closed, status.frame, status.success);
    let texts = |status: &SessionStatus| {
        let SessionStatus { limits, grasped, policy, note, undone, .. } = status.clone();
        (limits, grasped, policy, note, undone)
    };
    facts(before) != facts(now) || texts(before) != texts(now)
}

/// Wishes of the person who begins a session.
struct Opening {
    author: String,
    teleop: TeleopSettings,
    policy: Option<String>,
}

/// Begins a session, or attaches to the one of the scenario; its answer to the page.
fn open(
    studio: &Arc<Studio>,
    key: &str,
    Opening { author, teleop, policy }: Opening,
    connection: u64,
    runtime: &tokio::runtime::Handle,
) -> Result<(Arc<Session>, Value), Refusal> {
    let room = studio.room(key)?;
    let known = studio.teleoperations.newest(key);
    if let Some(session) = known.filter(|session| !session.status.borrow().phase.is_over()) {
        if !session.attach(connection) {
            return Err(Refusal::unsuited(
                "somebody teleoperates this scenario already",
                "wait for the end, or take another scenario",
            ));
        }
        return Ok(started(session, true));
    }
    let now = room.revision();
    let scene = studio.scene_at(&room, &now)?;
    let robot = studio.scenes.robot(&now.scenario.world)?;
    let models = studio.models(&now.scenario)?;
    let unusable = |error| Refusal::from(WorkspaceError::broken("the scenario cannot be simulated", error));
    let stage = Simulation::open(Arc::clone(&now.scenario), Catalogue::all(), &robot).map_err(unusable)?;
    if let Some(camera) = &teleop.camera
        && !stage.scenario.world.cameras.iter().any(|known| known.name == *camera)
    {
        return Err(Refusal::unsuited("the scenario has no camera of this name", ""));
    }
    let bodies = playback::bodies(&scene, &robot, &models);
    let runs = studio.runs.folder.clone();
    let setup = SessionSetup { stage, bodies, models, operator: author, teleop, policy, runs };
    let about = json!({
        "scenario": key, "revision": now.number, "instruction": setup.stage.scenario.task.instruction,
        "skill": skill(&setup.stage.goal), "control_rate_hz": setup.stage.control_rate_hz(), "horizon_s": HORIZON_S, "back_s": BACK_S,
        "width": playback::width(&setup.bodies),
    });
    let job = studio.runs.add(key, LABEL, now.number)?;
    job.change(&room, |_| {});
    let session = Arc::new(Session::new(about, Arc::clone(&job.stop)));
    session.attach(connection);
    studio.teleoperations.add(key, &session);
    runtime.spawn(run(Arc::clone(studio), room, job, Arc::clone(&session), setup));
    Ok(started(session, false))
}

/// Skill that a take shows: relations and states of the goal's first alternative, such as `in + closed`.
fn skill(goal: &Goal) -> String {
    let mut names: Vec<&str> = Vec::new();
    for atom in goal.alternatives.iter().take(1).flatten() {
        let name = match atom {
            Atom::Relation { relation, .. } => relation.name(),
            Atom::State { state, .. } => state,
        };
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names.join(" + ")
}

/// Answer to a page that is attached to a session; `again` if the session began before.
fn started(session: Arc<Session>, again: bool) -> (Arc<Session>, Value) {
    let mut answer = session.about.clone();
    (answer["type"], answer["again"]) = (json!("started"), json!(again));
    (session, answer)
}

/// Runs a session as soon as a permit is free, and gives it the phase in which its job ends.
async fn run(studio: Arc<Studio>, room: Arc<Room>, job: Arc<Job>, session: Arc<Session>, setup: SessionSetup) {
    let own = Arc::clone(&session);
    runs::run(studio, room, Arc::clone(&job), move |_, advance| own.run(&setup, advance)).await;
    let phase = match job.now().state {
        Stage::Done => Phase::Kept,
        Stage::Cancelled => Phase::Discarded,
        _ => Phase::Failed,
    };
    session.status.send_modify(|status| status.phase = phase);
}

fn refused(refusal: &Refusal) -> Message {
    Message::Text(json!({ "type": "refused", "error": refusal.error() }).to_string().into())
}

fn unreadable(reason: &str) -> Refusal {
    let hint = "expected a JSON message with `type`: start, join, events, gripper, go_to, pause, resume, back, hand_over, take_over, \
                retry, keep or discard";
    Refusal::unsuited(format!("the message cannot be read: {reason}"), hint)
}
