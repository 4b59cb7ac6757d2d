//! A scenario that is open: its document, who looks at it, and its verdict.

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

/// Messages that a slow tab may be behind before it gets the whole scene instead.
const BEHIND: usize = 256;

/// An open scenario.
pub struct Room {
    /// Key in addresses.
    pub key: String,
    /// Collection that it belongs to.
    pub source: String,
    /// Folder for its copy if it is read-only.
    pub copies: Option<PathBuf>,
    /// Key of the scenario of which it is a copy.
    pub parent: Option<String>,
    document: Mutex<Document>,
    /// Messages to its tabs.
    pub events: broadcast::Sender<Event>,
    /// Newest revision that is to be judged.
    pub wanted: watch::Sender<Option<Revision>>,
    /// Stages of the verdict on the newest revision.
    verdict: Mutex<Vec<StageVerdict>>,
    /// True once somebody judges the newest revision.
    is_judged: AtomicBool,
    /// Author of each tab.
    tabs: Mutex<BTreeMap<u64, String>>,
}

/// A revision of a scenario.
#[derive(Clone, Debug)]
pub struct Revision {
    /// Number.
    pub number: u64,
    /// The scenario.
    pub scenario: Arc<Scenario>,
}

/// Findings of one stage.
#[derive(Clone, Debug)]
pub struct StageVerdict {
    /// Revision that was judged.
    pub revision: u64,
    /// The stage.
    pub stage: Stage,
    /// Its problems.
    pub problems: Vec<Problem>,
    /// True for the last stage.
    pub done: bool,
}

/// Message to the tabs of a scenario.
#[derive(Clone, Debug)]
pub enum Event {
    /// A command was applied.
    Applied {
        /// Id that the client chose.
        client_operation_id: String,
        /// Its author.
        author: String,
        /// State without the fields that depend on the author.
        state: Arc<Value>,
        /// Authors who may undo and redo.
        steps: Arc<Steps>,
    },
    /// A stage was judged.
    Verdict(Arc<Value>),
    /// Authors came or left.
    Presence(Vec<String>),
    /// Editing has stopped.
    Stopped(String),
    /// An episode is run, or was.
    Run(Arc<Value>),
}

/// True for each author of a tab who may undo, and redo.
#[derive(Clone, Debug, Default)]
pub struct Steps(BTreeMap<String, (bool, bool)>);

/// A change that a client asks for.
#[derive(Clone, Debug)]
pub enum Request {
    /// A new command.
    Command(Box<Command>),
    /// Takes the author's last command back.
    Undo(Stamp),
    /// Applies it again.
    Redo(Stamp),
    /// Takes any one command back.
    Revert(u64, Stamp),
}

impl Request {
    /// Author, time and id.
    pub fn stamp(&self) -> &Stamp {
        match self {
            Self::Command(command) => &command.stamp,
            Self::Undo(stamp) | Self::Redo(stamp) | Self::Revert(_, stamp) => stamp,
        }
    }
}

/// The document, or why editing has stopped.
struct Document {
    edited: EditedScenario,
    stopped: Option<String>,
}

impl Room {
    /// Opens a document for tabs.
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

    /// Newest revision.
    pub fn revision(&self) -> Revision {
        revision_of(&self.lock().edited)
    }

    /// True if an author may undo, and redo.
    pub fn steps(&self, author: &str) -> (bool, bool) {
        let document = self.lock();
        (document.edited.can_undo(author), document.edited.can_redo(author))
    }

    /// Message why editing has stopped.
    pub fn stopped(&self) -> Option<String> {
        self.lock().stopped.clone()
    }

    /// Reads the document, such as its history.
    pub fn read<T>(&self, read: impl FnOnce(&EditedScenario) -> T) -> T {
        read(&self.lock().edited)
    }

    /// Makes a change and tells all tabs; `describe` gives the state of a revision.
    ///
    /// # Errors
    /// [`Refusal`]; a stop is reported to the tabs.
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
        let mut authors: Vec<String> = self.authors();
        authors.push(stamp.author.clone());
        let step = |author: String| {
            let steps = (document.edited.can_undo(&author), document.edited.can_redo(&author));
            (author, steps)
        };
        let steps = Arc::new(Steps(authors.into_iter().map(step).collect()));
        // A command that was sent again changes nothing.
        if revision.number != before {
            // Under one lock, so that no verdict comes before its state, and none of an older revision is kept.
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

    /// Edits the document; a stopped one is opened again first.
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

    /// Wants a revision judged, unless it already wants a newer one.
    pub fn want(&self, revision: Revision) {
        self.wanted.send_if_modified(|wanted| {
            let is_newer = wanted.as_ref().is_none_or(|known| known.number <= revision.number);
            if is_newer {
                *wanted = Some(revision);
            }
            is_newer
        });
    }

    /// True for the first caller, who is to judge the newest revision from now on.
    pub fn is_first_judge(&self) -> bool {
        !self.is_judged.swap(true, Ordering::Relaxed)
    }

    /// Keeps what a stage found and tells the tabs, if the revision is still the newest.
    pub fn judged(&self, found: StageVerdict) {
        let mut verdict = self.lock_verdict();
        let is_newest = self.wanted.borrow().as_ref().is_some_and(|wanted| wanted.number == found.revision);
        if is_newest {
            let _ = self.events.send(Event::Verdict(Arc::new(found.message(false))));
            verdict.push(found);
        }
    }

    /// Stages of the verdict on the newest revision, as far as they are judged.
    pub fn verdict(&self) -> Vec<StageVerdict> {
        self.lock_verdict().clone()
    }

    /// Adds or renames the author of a tab and tells the others.
    pub fn enter(&self, tab: u64, author: &str) {
        self.lock_tabs().insert(tab, author.to_owned());
        let _ = self.events.send(Event::Presence(self.authors()));
    }

    /// Removes a tab and tells the others.
    pub fn leave(&self, tab: u64) {
        self.lock_tabs().remove(&tab);
        let _ = self.events.send(Event::Presence(self.authors()));
    }

    /// Authors of the tabs, sorted, each once.
    pub fn authors(&self) -> Vec<String> {
        let mut authors: Vec<String> = self.lock_tabs().values().cloned().collect();
        authors.sort();
        authors.dedup();
        authors
    }

    // Poisoned locks still guard whole values.
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
    /// Message to a tab.
    pub fn message(&self, preview: bool) -> Value {
        let Self { revision, stage, problems, done } = self;
        json!({
            "type": "verdict", "revision": revision, "stage": stage, "problems": problems, "done": done,
            "preview": preview,
        })
    }
}

impl Steps {
    /// State with the fields of an author.
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
