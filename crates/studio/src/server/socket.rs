//! WebSocket of a tab: it opens a scenario, and receives edits, verdicts and the names of the other authors.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::response::{IntoResponse, Response};
use genmanip_assets::Catalogue;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::{broadcast, mpsc, watch};

use super::answer::Refusal;
use super::requests::MAX_BODY;
use super::room::{Event, Request, Revision, Room};
use super::studio::{Changed, Studio};
use crate::edit::{Command, Operation, Placement, Stamp};
use crate::verdict::Stage;

/// Maximum number of open tabs.
const MAX_TABS: usize = 256;
/// Maximum length of an author's name, bytes.
const MAX_AUTHOR: usize = 80;
/// Idle time after which a connection is pinged, to detect a dead one.
const PROBE: Duration = Duration::from_secs(30);
/// Timeout for sending a message to a tab.
const SEND: Duration = Duration::from_secs(20);
/// Stages that a preview judges, the fast ones.
const PREVIEWED: [Stage; 3] = [Stage::Wording, Stage::Relations, Stage::Collision];

/// Message from a tab.
#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum FromTab {
    /// Shows a scenario.
    Open {
        scenario: String,
        #[serde(default)]
        author: String,
    },
    Command {
        command: Box<Command>,
    },
    Undo(Stamp),
    Redo(Stamp),
    /// Judges poses that are not stored, while an object is dragged.
    Preview {
        objects: Vec<Placement>,
    },
}

/// Accepts the connection of a tab.
pub async fn connect(State(studio): State<Arc<Studio>>, upgrade: WebSocketUpgrade) -> Response {
    static OPEN: AtomicUsize = AtomicUsize::new(0);
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let Some(open) = Open::below(MAX_TABS, &OPEN) else {
        return Refusal::Stopped { message: format!("{MAX_TABS} tabs are open"), hint: "close some".into() }
            .into_response();
    };
    upgrade.max_message_size(MAX_BODY).max_frame_size(MAX_BODY).on_upgrade(async move |socket| {
        let _open = open;
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let mut tab = Tab::new(studio, number);
        tab.serve(socket).await;
        tab.leave();
    })
}

/// An open connection in a counter, which is decremented on drop, also if the handshake fails.
pub(super) struct Open(&'static AtomicUsize);

impl Open {
    /// Counts a connection; `None` if `most` are open.
    pub fn below(most: usize, counter: &'static AtomicUsize) -> Option<Self> {
        let open = Self(counter);
        (counter.fetch_add(1, Ordering::Relaxed) < most).then_some(open)
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// A tab, with the scenario that it shows.
struct Tab {
    studio: Arc<Studio>,
    number: u64,
    author: String,
    room: Option<Arc<Room>>,
    events: Option<broadcast::Receiver<Event>>,
    /// Sender of the newest preview to judge; dropping it ends the judging task.
    previews: Option<watch::Sender<Option<Revision>>>,
    outbox: mpsc::Sender<Value>,
    inbox: Option<mpsc::Receiver<Value>>,
}

/// Next event to handle.
enum Next {
    Received(Option<Result<Message, axum::Error>>),
    Event(Result<Event, broadcast::error::RecvError>),
    Outgoing(Option<Value>),
    Silent,
}

impl Tab {
    fn new(studio: Arc<Studio>, number: u64) -> Self {
        let (outbox, inbox) = mpsc::channel(64);
        let author = studio.author.clone();
        Self { studio, number, author, room: None, events: None, previews: None, outbox, inbox: Some(inbox) }
    }

    /// Serves the tab until it disconnects.
    async fn serve(&mut self, mut socket: WebSocket) {
        let Some(mut outgoing) = self.inbox.take() else { return };
        loop {
            let event = async {
                match &mut self.events {
                    Some(events) => events.recv().await,
                    None => std::future::pending().await,
                }
            };
            let next = tokio::select! {
                received = socket.recv() => Next::Received(received),
                event = event => Next::Event(event),
                message = outgoing.recv() => Next::Outgoing(message),
                () = tokio::time::sleep(PROBE) => Next::Silent,
            };
            let messages = match next {
                Next::Received(Some(Ok(Message::Text(text)))) => self.received(text.as_str()).await,
                Next::Received(Some(Ok(Message::Binary(_)))) => {
                    vec![refused("", &unreadable("expected text, got bytes"))]
                }
                Next::Received(Some(Ok(Message::Ping(_) | Message::Pong(_)))) => Vec::new(),
                Next::Received(Some(Ok(Message::Close(_)) | Err(_)) | None) | Next::Outgoing(None) => return,
                Next::Event(Ok(event)) => vec![self.heard(event)],
                Next::Event(Err(broadcast::error::RecvError::Lagged(_))) => self.scene().await,
                Next::Event(Err(broadcast::error::RecvError::Closed)) => return,
                Next::Outgoing(Some(message)) => vec![message],
                Next::Silent => {
                    if send(&mut socket, Message::Ping(Vec::new().into())).await.is_none() {
                        return;
                    }
                    continue;
                }
            };
            for message in messages {
                if send(&mut socket, Message::Text(message.to_string().into())).await.is_none() {
                    return;
                }
            }
        }
    }

    /// Handles a message of the tab; returns the answers.
    async fn received(&mut self, text: &str) -> Vec<Value> {
        let message: FromTab = match serde_json::from_str(text) {
            Ok(message) => message,
            Err(error) => {
                let id = serde_json::from_str::<Value>(text).ok();
                let id = id.as_ref().and_then(|value| {
                    value["client_operation_id"].as_str().or_else(|| value["command"]["client_operation_id"].as_str())
                });
                return vec![refused(id.unwrap_or_default(), &unreadable(&error.to_string()))];
            }
        };
        match message {
            FromTab::Open { scenario, author } => self.open(scenario, author).await,
            FromTab::Command { command } => self.change(Request::Command(command)).await,
            FromTab::Undo(stamp) => self.change(Request::Undo(stamp)).await,
            FromTab::Redo(stamp) => self.change(Request::Redo(stamp)).await,
            FromTab::Preview { objects } => {
                self.preview(objects);
                Vec::new()
            }
        }
    }

    async fn open(&mut self, key: String, author: String) -> Vec<Value> {
        if !author.trim().is_empty() {
            self.author = author
                .trim()
                .chars()
                .scan(0, |bytes, letter| {
                    *bytes += letter.len_utf8();
                    (*bytes <= MAX_AUTHOR).then_some(letter)
                })
                .collect();
        }
        let studio = Arc::clone(&self.studio);
        let room = blocking(move || studio.room(&key)).await;
        match room {
            Ok(room) => {
                self.enter(&room);
                self.scene().await
            }
            Err(refusal) => vec![refused("", &refusal)],
        }
    }

    /// Shows a scenario: subscribes to its messages and enters its room.
    fn enter(&mut self, room: &Arc<Room>) {
        self.leave();
        self.events = Some(room.events.subscribe());
        room.enter(self.number, &self.author);
        self.room = Some(Arc::clone(room));
        self.previews = None;
        begin_judging(&self.studio, room);
    }

    fn leave(&mut self) {
        if let Some(room) = self.room.take() {
            room.leave(self.number);
        }
        self.events = None;
    }

    /// Messages with the whole scene, and the stages of the verdict so far.
    async fn scene(&mut self) -> Vec<Value> {
        let Some(room) = self.room.clone() else { return Vec::new() };
        // Subscribe before reading the scene, so that no event is lost in between.
        self.events = Some(room.events.subscribe());
        let (studio, author) = (Arc::clone(&self.studio), self.author.clone());
        let own = Arc::clone(&room);
        match blocking(move || studio.scene(&own, &author)).await {
            Ok(mut scene) => {
                scene["type"] = json!("scene");
                let presence = json!({ "type": "presence", "authors": room.authors() });
                let verdict = room.verdict();
                let stopped = room.stopped().map(|message| json!({ "type": "stopped", "message": message }));
                let found = verdict.iter().map(|found| found.message(false));
                let run = self.studio.runs.message(&room.key);
                [scene, presence].into_iter().chain(stopped).chain(run).chain(found).collect()
            }
            Err(refusal) => vec![refused("", &refusal)],
        }
    }

    /// Applies a change. All tabs get it as an event, this one included, so that there usually is no other answer.
    async fn change(&mut self, request: Request) -> Vec<Value> {
        let id = request.stamp().client_operation_id.clone();
        let Some(room) = self.room.clone() else {
            return vec![refused(&id, &Refusal::unsuited("no scenario is open", "send an `open` message first"))];
        };
        let (studio, key) = (Arc::clone(&self.studio), room.key.clone());
        let before = room.revision().number;
        let author = request.stamp().author.clone();
        let changed = blocking(move || studio.change(&key, &request)).await;
        match changed {
            Ok(Changed { room: own, state, steps }) => {
                let applied = json!({
                    "type": "applied", "client_operation_id": id, "author": author,
                    "state": steps.complete(&state, &self.author),
                });
                if !Arc::ptr_eq(&own, &room) {
                    // The first edit of a read-only scenario has made a copy, which the tab shows from now on.
                    self.enter(&own);
                    let mut messages = self.scene().await;
                    messages.push(applied);
                    return messages;
                }
                // A repeated command causes no event, so it is answered directly.
                if own.revision().number == before { vec![applied] } else { Vec::new() }
            }
            Err(Refusal::Conflict { conflict }) => {
                vec![json!({ "type": "conflict", "client_operation_id": id, "conflict": conflict })]
            }
            Err(refusal) => vec![refused(&id, &refusal)],
        }
    }

    /// Message to the tab for an event of its room.
    fn heard(&self, event: Event) -> Value {
        match event {
            Event::Applied { client_operation_id, author, state, steps } => json!({
                "type": "applied", "client_operation_id": client_operation_id, "author": author,
                "state": steps.complete(&state, &self.author),
            }),
            Event::Verdict(message) | Event::Run(message) => Value::clone(&message),
            Event::Presence(authors) => json!({ "type": "presence", "authors": authors }),
            Event::Stopped(message) => json!({ "type": "stopped", "message": message }),
        }
    }

    /// Requests a preview of poses by the fast stages; it replaces an older one that is not judged yet.
    fn preview(&mut self, objects: Vec<Placement>) {
        let Some(room) = &self.room else { return };
        let now = room.revision();
        // The poses do not fit if another author has removed an object meanwhile; there is no preview then.
        let Ok(change) = (Operation::Place { objects }).apply(&now.scenario, Catalogue::all()) else { return };
        let wanted = Revision { number: now.number, scenario: Arc::new(change.scenario) };
        let previews = self.previews.get_or_insert_with(|| {
            let (sender, receiver) = watch::channel(None);
            tokio::spawn(judge_previews(Arc::clone(&self.studio), receiver, self.outbox.clone()));
            sender
        });
        previews.send_replace(Some(wanted));
    }
}

/// Judges the newest preview, until the tab shows another scenario.
async fn judge_previews(
    studio: Arc<Studio>,
    mut wanted: watch::Receiver<Option<Revision>>,
    outbox: mpsc::Sender<Value>,
) {
    while wanted.changed().await.is_ok() {
        let Some(now) = wanted.borrow_and_update().clone() else { continue };
        let Ok(_turn) = studio.permits.acquire().await else { return };
        let (own, newer, outbox) = (Arc::clone(&studio), wanted.clone(), outbox.clone());
        let judged = blocking(move || {
            own.judge(&now, &PREVIEWED, |found| {
                if newer.has_changed().unwrap_or(true) {
                    return false;
                }
                // Judging ends if the tab's queue is full or closed.
                found.is_none_or(|found| outbox.try_send(found.message(true)).is_ok())
            })
        });
        // Errors of a preview are ignored; they are reported when the poses are stored.
        drop(judged.await);
    }
}

/// Starts the task that judges the newest revision of a scenario; once per scenario.
fn begin_judging(studio: &Arc<Studio>, room: &Arc<Room>) {
    if !room.is_first_judge() {
        return;
    }
    let mut wanted = room.wanted.subscribe();
    room.want(room.revision());
    // The task never ends, since rooms are never closed; it sleeps while nothing changes.
    let (studio, room) = (Arc::clone(studio), Arc::clone(room));
    tokio::spawn(async move {
        while wanted.changed().await.is_ok() {
            let Some(now) = wanted.borrow_and_update().clone() else { continue };
            let Ok(_turn) = studio.permits.acquire().await else { return };
            let (own, own_room, newer) = (Arc::clone(&studio), Arc::clone(&room), wanted.clone());
            let judged = blocking(move || {
                own.judge(&now, &Stage::ALL, |found| {
                    if newer.has_changed().unwrap_or(true) {
                        return false;
                    }
                    if let Some(found) = found {
                        own_room.judged(found);
                    }
                    true
                })
            });
            if let Err(refusal) = judged.await {
                let message = refusal.error()["message"].as_str().unwrap_or_default().to_owned();
                let _ = room.events.send(Event::Verdict(Arc::new(json!({
                    "type": "verdict", "revision": room.revision().number, "stage": Stage::Goal, "problems": [],
                    "done": true, "preview": false, "error": message,
                }))));
            }
        }
    });
}

/// Runs a computation on a blocking thread; a panic becomes a refusal.
async fn blocking<T: Send + 'static>(
    compute: impl FnOnce() -> Result<T, Refusal> + Send + 'static,
) -> Result<T, Refusal> {
    let panicked = || Refusal::Stopped {
        message: "the computation panicked; please report this bug".into(),
        hint: "the scenario's log has every acknowledged edit".into(),
    };
    tokio::task::spawn_blocking(compute).await.unwrap_or_else(|_| Err(panicked()))
}

/// Sends a message; `None` if the tab is disconnected or does not read within [`SEND`].
async fn send(socket: &mut WebSocket, message: Message) -> Option<()> {
    tokio::time::timeout(SEND, socket.send(message)).await.ok()?.ok()
}

fn refused(client_operation_id: &str, refusal: &Refusal) -> Value {
    json!({ "type": "refused", "client_operation_id": client_operation_id, "error": refusal.error() })
}

fn unreadable(reason: &str) -> Refusal {
    let hint = "expected a JSON message with `type`: open, command, undo, redo or preview";
    Refusal::unsuited(format!("the message cannot be read: {reason}"), hint)
}
