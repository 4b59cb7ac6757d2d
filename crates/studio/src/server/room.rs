//! Room of an open scenario: its document, the browser tabs that show it, and its verdict.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use genmanip_assets::Catalogue;
use genmanip_core::Scenario;
use serde_json::{Value, json};
use tokio::sync::{broadcast, watch};

use super::answer::Refusal;
use crate::edit::{Applied, Command, EditError, EditedScenario, Stamp};
use crate::verdict::{Problem, Stage};

/// Number of messages that a slow tab may lag behind; after more, it gets the whole scene again.
const BEHIND: usize = 256;

/// An open scenario with the tabs that show it.
pub struct Room {
    /// Key of the scenario in URLs.
    pub key: String,
    /// Name of the collection that the scenario belongs to; `studio` for copies and new scenarios.
    pub source: String,
    /// Folder for the copy, relative to the studio's folder, if the scenario is read-only; `None` if it is edited in
    /// place.
    pub copies: Option<PathBuf>,
    /// Key of the scenario that this one was copied from; `None` for an original.
    pub parent: Option<String>,
    document: Mutex<Document>,
    /// Sender of messages to all tabs.
    pub events: broadcast::Sender<Event>,
    /// Newest revision that is to be judged; `None` before the first one.
    pub wanted: watch::Sender<Option<Revision>>,
    /// Judged stages of the newest revision, in order.
    verdict: Mutex<Vec<StageVerdict>>,
    /// True once a task has been started that judges the newest revisions of this room.
    is_judged: AtomicBool,
    /// Author of each open tab, by the tab's number.
    tabs: Mutex<BTreeMap<u64, String>>,
}

/// A revision of a scenario.
#[derive(Clone, Debug)]
pub struct Revision {
    /// Number of the revision, from 0.
    pub number: u64,
    /// The scenario at this revision.
    pub scenario: Arc<Scenario>,
}

/// Verdict of one stage on a revision.
#[derive(Clone, Debug)]
pub struct StageVerdict {
    /// Revision that was judged.
    pub revision: u64,
    /// Stage of the verdict.
    pub stage: Stage,
    /// Problems that the stage found.
    pub problems: Vec<Problem>,
    /// True for the last of the requested stages.
    pub done: bool,
}

/// Message to the tabs of a scenario.
#[derive(Clone, Debug)]
pub enum Event {
    /// A command was applied.
    Applied {
        /// Id that the client chose for the command.
        client_operation_id: String,
        /// Author of the command.
        author: String,
        /// State of the scenario, without the fields that depend on the author.
        state: Arc<Value>,
        /// For each author, if undo and redo are possible.
        steps: Arc<Steps>,
    },
    /// A stage of the verdict was judged.
    Verdict(Arc<Value>),
    /// Authors of all tabs, sorted, after a tab was opened or closed or its author renamed.
    Presence(Vec<String>),
    /// Editing has stopped, for this reason.
    Stopped(String),
    /// Progress or end of an episode of a policy.
    Run(Arc<Value>),
}

/// Two flags per author: undo is possible, redo is possible.
#[derive(Clone, Debug, Default)]
pub struct Steps(BTreeMap<String, (bool, bool)>);

/// A change that a client asks for.
#[derive(Clone, Debug)]
pub enum Request {
    /// A new command.
    Command(Box<Command>),
    /// Undoes the author's last command that is in force.
    Undo(Stamp),
    /// Redoes the author's last undone command.
    Redo(Stamp),
    /// Reverts the command that made a revision, whoever gave it.
    Revert(u64, Stamp),
}

impl Request {
    /// Author, time and id of the request.
    pub fn stamp(&self) -> &Stamp {
        match self {
            Self::Command(command) => &command.stamp,
            Self::Undo(stamp) | Self::Redo(stamp) | Self::Revert(_, stamp) => stamp,
        }
    }
}

/// The edited scenario, and the reason if editing has stopped.
struct Document {
    edited: EditedScenario,
    stopped: Option<String>,
}

impl Room {
    /// A room without tabs; `own` is the scenario's document, the other arguments are the fields of the same names.
    pub fn new(
        key: String,
        source: String,
        copies: Option<PathBuf>,
        parent: Option<String>,
        own: EditedScenario,
    ) -> Self {
        Self {
            key,
            source,
            copies,
            parent,
            document: Mutex::new(Document { edited: own, stopped: None }),
            events: broadcast::Sender::new(BEHIND),
            wanted: watch::Sender::new(None),
            verdict: Mutex::default(),
            is_judged: AtomicBool::new(false),
            tabs: Mutex::default(),
        }
    }

    /// Newest revision of the scenario.
    pub fn revision(&self) -> Revision {
        revision_of(&self.lock().edited)
    }

    /// Two flags for an author: undo is possible, redo is possible.
    pub fn steps(&self, author: &str) -> (bool, bool) {
        let document = self.lock();
        (document.edited.can_undo(author), document.edited.can_redo(author))
    }

    /// Reason why editing has stopped; `None` if it has not.
    pub fn stopped(&self) -> Option<String> {
        self.lock().stopped.clone()
    }

    /// Passes the document to `read`, e.g. to list its history.
    pub fn read<T>(&self, read: impl FnOnce(&EditedScenario) -> T) -> T {
        read(&self.lock().edited)
    }

    /// Applies a change, sends the new state to all tabs and requests a verdict; `describe` returns the state of a
    /// revision as JSON. A request with a known operation id changes nothing and returns the present state.
    ///
    /// # Errors
    /// When the change conflicts with another, is invalid or cannot be written; if editing stops because of it, the
    /// tabs are informed.
    pub fn change(
        &self,
        request: &Request,
        describe: impl FnOnce(&Revision) -> Result<Value, Refusal>,
    ) -> Result<(Arc<Value>, Arc<Steps>), Refusal> {
        let mut document = self.lock();
        let before = document.edited.revision();
        let change = |edited: &mut EditedScenario| -> Result<Applied, EditError> {
            match request {
                Request::Command(command) => edited.apply(command),
                Request::Undo(stamp) => edited.undo(stamp),
                Request::Redo(stamp) => edited.redo(stamp),
                Request::Revert(revision, stamp) => edited.revert(*revision, stamp),
            }
        };
        self.edit(&mut document, change)?;
        let revision = revision_of(&document.edited);
        let state = Arc::new(describe(&revision)?);
        let stamp = request.stamp();
        let step =
            |author: &str| (author.to_owned(), (document.edited.can_undo(author), document.edited.can_redo(author)));
        // Of all who ever edited, not of the present tabs: one that opens at this moment gets the event too.
        let steps = Arc::new(Steps(document.edited.authors().into_iter().map(step).collect()));
        // A repeated command (same operation id) made no new revision.
        if revision.number != before {
            // Both locks are held, so that no verdict is sent before its state and none of an older revision is kept.
            let mut verdict = self.lock_verdict();
            verdict.clear();
            let _ = self.events.send(Event::Applied {
                client_operation_id: stamp.client_operation_id.clone(),
                author: stamp.author.clone(),
                state: Arc::clone(&state),
                steps: Arc::clone(&steps),
            });
            self.want(revision);
        }
        Ok((state, steps))
    }

    /// Names the newest revision.
    ///
    /// # Errors
    /// As [`Room::change`].
    pub fn snapshot(&self, name: &str, stamp: &Stamp) -> Result<(), Refusal> {
        self.edit(&mut self.lock(), |edited| edited.snapshot(name, stamp))
    }

    /// Edits the document; if editing has stopped, the document is reopened first.
    fn edit<T>(
        &self,
        document: &mut Document,
        edit: impl FnOnce(&mut EditedScenario) -> Result<T, EditError>,
    ) -> Result<T, Refusal> {
        if document.stopped.is_some() {
            let path = document.edited.path().to_owned();
            document.edited = EditedScenario::open(&path, Catalogue::all()).map_err(Refusal::from)?;
            document.stopped = None;
        }
        edit(&mut document.edited).map_err(|error| {
            let refusal = Refusal::from(error);
            if let Refusal::Stopped { message, hint } = &refusal {
                let message = format!("{message}; {hint}");
                document.stopped = Some(message.clone());
                let _ = self.events.send(Event::Stopped(message));
            }
            refusal
        })
    }

    /// Requests a verdict on a revision, unless one on a newer revision is requested.
    pub fn want(&self, revision: Revision) {
        self.wanted.send_if_modified(|wanted| {
            let is_newer = wanted.as_ref().is_none_or(|known| known.number <= revision.number);
            if is_newer {
                *wanted = Some(revision);
            }
            is_newer
        });
    }

    /// True for the first caller only, which must judge the newest revision from then on.
    pub fn is_first_judge(&self) -> bool {
        !self.is_judged.swap(true, Ordering::Relaxed)
    }

    /// Stores the verdict of a stage and sends it to the tabs, if its revision is still the newest.
    pub fn judged(&self, found: StageVerdict) {
        let mut verdict = self.lock_verdict();
        let is_newest = self.wanted.borrow().as_ref().is_some_and(|wanted| wanted.number == found.revision);
        if is_newest {
            let _ = self.events.send(Event::Verdict(Arc::new(found.message(false))));
            verdict.push(found);
        }
    }

    /// Verdict on the newest revision: the stages judged so far.
    pub fn verdict(&self) -> Vec<StageVerdict> {
        self.lock_verdict().clone()
    }

    /// Adds a tab, or renames its author, and sends all authors to the tabs.
    pub fn enter(&self, tab: u64, author: &str) {
        self.lock_tabs().insert(tab, author.to_owned());
        let _ = self.events.send(Event::Presence(self.authors()));
    }

    /// Removes a tab and sends the remaining authors to the tabs.
    pub fn leave(&self, tab: u64) {
        self.lock_tabs().remove(&tab);
        let _ = self.events.send(Event::Presence(self.authors()));
    }

    /// Names of the tabs' authors, sorted, without duplicates.
    pub fn authors(&self) -> Vec<String> {
        let mut authors: Vec<String> = self.lock_tabs().values().cloned().collect();
        authors.sort();
        authors.dedup();
        authors
    }

    // A panic of another thread leaves the values consistent, so poisoned locks are used.
    fn lock(&self) -> MutexGuard<'_, Document> {
        self.document.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock_verdict(&self) -> MutexGuard<'_, Vec<StageVerdict>> {
        self.verdict.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock_tabs(&self) -> MutexGuard<'_, BTreeMap<u64, String>> {
        self.tabs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl StageVerdict {
    /// The verdict as a message to a tab; `preview` marks one on a change that is not applied.
    pub fn message(&self, preview: bool) -> Value {
        let Self { revision, stage, problems, done } = self;
        json!({
            "type": "verdict", "revision": revision, "stage": stage, "problems": problems, "done": done,
            "preview": preview,
        })
    }
}

impl Steps {
    /// The state with the undo and redo flags of this author; both false for one who has not edited.
    pub fn complete(&self, state: &Value, author: &str) -> Value {
        let (can_undo, can_redo) = self.0.get(author).copied().unwrap_or_default();
        let mut state = state.clone();
        state["can_undo"] = json!(can_undo);
        state["can_redo"] = json!(can_redo);
        state
    }
}

fn revision_of(edited: &EditedScenario) -> Revision {
    Revision { number: edited.revision(), scenario: Arc::clone(edited.scenario()) }
}
