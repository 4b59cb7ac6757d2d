//! Edited scenario: the scenario's file, and the log of operations that it results from.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_assets::AssetSource;
use genmanip_core::{Document, Scenario, limits};
use genmanip_data::files;
use genmanip_workspace::documents::{read_bytes, stem, unwritable, write_file};
use genmanip_workspace::scenarios::parse_scenario;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::difference::Difference;
use super::error::{Conflict, EditError};
use super::fields;
use super::history::{History, Overlap};
use super::log::{CommandLine, EditLog, Header, Line, Parent, SCHEMA, Snapshot, Stamp, check_stamp, sha256};
use super::operation::{Change, Operation};

/// A request to apply an operation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Command {
    /// Operation to apply.
    #[serde(flatten)]
    pub operation: Operation,
    /// Revision that the author had seen.
    pub base_revision: u64,
    /// Author, time and id.
    #[serde(flatten)]
    pub stamp: Stamp,
}

/// Acknowledgement of a command, which is then in the log on the disk.
#[derive(Clone, Debug)]
pub struct Applied {
    /// Revision that the command made.
    pub revision: u64,
    /// The scenario after the command; if the command was a repetition, the present scenario.
    pub scenario: Arc<Scenario>,
}

/// A scenario's file with the log of its edits.
pub struct EditedScenario {
    path: PathBuf,
    assets: &'static dyn AssetSource,
    log: EditLog,
    parent: Option<Parent>,
    first: Arc<Scenario>,
    scenario: Arc<Scenario>,
    history: History,
    /// SHA-256 of the scenario's file as last read or written.
    file_sha256: String,
    /// True if the program was killed between writing log and scenario, so that the file is one revision behind the
    /// log.
    is_behind: bool,
    is_stopped: bool,
}

impl EditedScenario {
    /// Reads a scenario and its log `NAME.edits.jsonl`, if there is one; writes nothing.
    ///
    /// # Errors
    /// [`EditError`] if a file cannot be read, the log is damaged, or the scenario was changed outside.
    pub fn open(path: &Path, assets: &'static dyn AssetSource) -> Result<Self, EditError> {
        let bytes = read_bytes(path, limits::SCENARIO)?;
        let (found, file_sha256) = (Arc::new(parse_scenario(path, &bytes)?), sha256(&bytes));
        let log_path = EditLog::path_of(path);
        let mut document = Self {
            path: path.to_owned(),
            assets,
            log: EditLog::new(log_path.clone()),
            parent: None,
            first: Arc::clone(&found),
            scenario: found,
            history: History::default(),
            file_sha256,
            is_behind: false,
            is_stopped: false,
        };
        if !log_path.exists() {
            return Ok(document);
        }
        let (log, header, lines) = EditLog::read(log_path.clone())?;
        let damaged = |line: usize, message: String| EditError::Log { path: log_path.clone(), line, message };
        document.first = Arc::new(header.scenario().map_err(|message| damaged(1, message))?);
        (document.log, document.parent) = (log, header.parent);
        let mut hashes = vec![header.sha256];
        let mut scenario = document.first.as_ref().clone();
        for (index, line) in lines.into_iter().enumerate() {
            let line = match line {
                Line::Command(line) => *line,
                Line::Snapshot(snapshot) => {
                    document.history.record_snapshot(snapshot);
                    continue;
                }
            };
            let (number, expected) = (index + 2, document.history.revision() + 1);
            if line.revision != expected {
                return Err(damaged(number, format!("expected revision {expected}, got {}", line.revision)));
            }
            let change = line.operation.apply(&scenario, assets).map_err(|error| damaged(number, error.to_string()))?;
            hashes.push(line.sha256.clone());
            document.history.record(line, change.inverse, fields::of(&change.operation, &scenario));
            scenario = change.scenario;
        }
        let last = hashes.len() - 1;
        if last > 0 && sha256(scenario.to_json().as_bytes()) != hashes[last] {
            let message =
                "the scenario that follows from the log has another hash; a newer program may have written it";
            return Err(damaged(last + 1, message.into()));
        }
        document.scenario = Arc::new(scenario);
        if document.file_sha256 != hashes[last] {
            document.is_behind = last > 0 && document.file_sha256 == hashes[last - 1];
            if !document.is_behind {
                return Err(EditError::ChangedOutside { path: path.to_owned() });
            }
        }
        Ok(document)
    }

    /// Copies a scenario into a folder for editing; the copy's log names its parent.
    ///
    /// # Errors
    /// As [`EditedScenario::open`]; when the folder cannot be written to, or already has a scenario of that name.
    pub fn copy_into(parent: &Path, folder: &Path, assets: &'static dyn AssetSource) -> Result<Self, EditError> {
        let original = Self::open(parent, assets)?;
        let path = folder.join(format!("{}.json", stem(parent)));
        let text = original.scenario.to_json();
        if EditLog::path_of(&path).exists()
            || !files::create(&path, text.as_bytes()).map_err(|error| unwritable(&path, error))?
        {
            let message = format!("expected a folder without {}", path.display());
            return Err(EditError::invalid("copy", message, "edit that copy, or name another folder"));
        }
        let mut copy = Self::open(&path, assets)?;
        copy.parent = Some(Parent { path: parent.display().to_string(), sha256: original.file_sha256 });
        copy.create_log()?;
        Ok(copy)
    }

    /// Reason why a scenario's file is never edited in place (it belongs to a suite or run); `None` if it may be
    /// edited.
    pub fn read_only_reason(path: &Path) -> Option<String> {
        let folder = std::path::absolute(path).ok()?;
        let scenarios = folder.parent().filter(|folder| folder.ends_with("scenarios"))?;
        let owner = scenarios.parent()?;
        let name = owner.file_name().unwrap_or_default().to_string_lossy();
        if owner.join("suite.json").exists() {
            return Some(format!("it belongs to the suite {name}"));
        }
        owner.join("run.json").exists().then(|| format!("it belongs to the run {name}"))
    }

    /// Path of the scenario's file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The scenario that this one was copied from; `None` for an original.
    pub fn parent(&self) -> Option<&Parent> {
        self.parent.as_ref()
    }

    /// The scenario at the present revision.
    pub fn scenario(&self) -> &Arc<Scenario> {
        &self.scenario
    }

    /// Number of the present revision; 0 without edits.
    pub fn revision(&self) -> u64 {
        self.history.revision()
    }

    /// All commands, in the order of their revisions.
    pub fn history(&self) -> impl Iterator<Item = &CommandLine> {
        self.history.lines()
    }

    /// All snapshots, in order of time.
    pub fn snapshots(&self) -> &[Snapshot] {
        self.history.snapshots()
    }

    /// The scenario at a revision.
    ///
    /// # Errors
    /// [`EditError::Invalid`] if there is no such revision.
    pub fn at_revision(&self, revision: u64) -> Result<Arc<Scenario>, EditError> {
        if revision == self.revision() {
            return Ok(Arc::clone(&self.scenario));
        }
        if revision > self.revision() {
            let message = format!("expected a revision up to {}, got {revision}", self.revision());
            return Err(EditError::invalid("revision", message, ""));
        }
        let mut scenario = self.first.as_ref().clone();
        for line in self.history.lines().take_while(|line| line.revision <= revision) {
            scenario = line.operation.apply(&scenario, self.assets)?.scenario;
        }
        Ok(Arc::new(scenario))
    }

    /// SHA-256 of the scenario's file at each revision, from 0 on.
    pub fn hashes(&self) -> Vec<String> {
        let first = sha256(self.first.to_json().as_bytes());
        std::iter::once(first).chain(self.history.lines().map(|line| line.sha256.clone())).collect()
    }

    /// Difference between two revisions.
    ///
    /// # Errors
    /// As [`EditedScenario::at_revision`].
    pub fn difference(&self, before: u64, after: u64) -> Result<Difference, EditError> {
        Ok(Difference::between(&*self.at_revision(before)?, &*self.at_revision(after)?))
    }

    /// Applies a command: checks it, appends it to the log, syncs the log, and writes the scenario. A command with a
    /// known operation id has no further effect.
    ///
    /// # Errors
    /// [`EditError`]; files and memory are unchanged then.
    pub fn apply(&mut self, command: &Command) -> Result<Applied, EditError> {
        let Command { operation, base_revision, stamp } = command;
        if let Some(applied) = self.seen(stamp)? {
            return Ok(applied);
        }
        if *base_revision > self.revision() {
            let message = format!("expected a revision up to {}, got {base_revision}", self.revision());
            return Err(EditError::invalid("base_revision", message, "open the scenario again"));
        }
        let change = operation.apply(&self.scenario, self.assets);
        let resolved = change.as_ref().map_or(operation, |change| &change.operation);
        let fields = fields::of(resolved, &self.scenario);
        let mine = |field: &str| change.as_ref().map_or(Value::Null, |change| fields::value(field, &change.scenario));
        if let Some(changed) = self.history.changed_since(*base_revision, &stamp.author, &fields) {
            let mine = mine(&changed.field);
            return Err(self.conflict(changed, mine));
        }
        // Report a conflict, since another author may have removed something that the command refers to.
        if change.is_err() && self.history.others_since(*base_revision, &stamp.author) {
            let fitted = operation.apply(&*self.at_revision(*base_revision)?, self.assets);
            if let (Ok(fitted), Some(field)) = (fitted, fields.first()) {
                let changed = Overlap { field: field.clone(), revision: self.revision() };
                let mine = fields::value(field, &fitted.scenario);
                return Err(self.conflict(changed, mine));
            }
        }
        self.commit(change?, fields, *base_revision, stamp, None, None)
    }

    /// Undoes the author's last command that is in effect.
    ///
    /// # Errors
    /// As [`EditedScenario::apply`]; [`EditError::Nothing`] if there is none.
    pub fn undo(&mut self, stamp: &Stamp) -> Result<Applied, EditError> {
        if let Some(applied) = self.seen(stamp)? {
            return Ok(applied);
        }
        let nothing = || EditError::Nothing { author: stamp.author.clone(), action: "undo" };
        let revision = self.history.undoable(&stamp.author).ok_or_else(nothing)?;
        self.take_back(revision, stamp)
    }

    /// Applies the command again that the author undid last.
    ///
    /// # Errors
    /// As [`EditedScenario::apply`]; [`EditError::Nothing`] if there is none.
    pub fn redo(&mut self, stamp: &Stamp) -> Result<Applied, EditError> {
        if let Some(applied) = self.seen(stamp)? {
            return Ok(applied);
        }
        let nothing = || EditError::Nothing { author: stamp.author.clone(), action: "redo" };
        let revision = self.history.redoable(&stamp.author).ok_or_else(nothing)?;
        self.apply_again(revision, stamp)
    }

    /// Undoes the command of a revision, whoever gave it, or applies it again if it is undone.
    ///
    /// # Errors
    /// As [`EditedScenario::apply`]; [`EditError::Invalid`] if there is no such revision.
    pub fn revert(&mut self, revision: u64, stamp: &Stamp) -> Result<Applied, EditError> {
        if let Some(applied) = self.seen(stamp)? {
            return Ok(applied);
        }
        let Some(target) = self.history.target(revision) else {
            let message = format!("expected a revision from 1 to {}, got {revision}", self.revision());
            return Err(EditError::invalid("revision", message, "`--history` lists them"));
        };
        if self.history.is_undone(target) { self.apply_again(target, stamp) } else { self.take_back(target, stamp) }
    }

    /// Names of all who gave a command, sorted.
    pub fn authors(&self) -> BTreeSet<&str> {
        self.history.authors()
    }

    /// True if the author has a command to undo.
    pub fn can_undo(&self, author: &str) -> bool {
        self.history.undoable(author).is_some()
    }

    /// True if the author has a command to redo.
    pub fn can_redo(&self, author: &str) -> bool {
        self.history.redoable(author).is_some()
    }

    /// Names the present revision.
    ///
    /// # Errors
    /// As [`EditedScenario::apply`]; [`EditError::Invalid`] if the name is taken.
    pub fn snapshot(&mut self, name: &str, stamp: &Stamp) -> Result<(), EditError> {
        if self.seen(stamp)?.is_some() {
            return Ok(());
        }
        let length = name.chars().count();
        if !(1..=64).contains(&length) || name.chars().any(char::is_control) {
            let message = format!("expected a name of 1 to 64 characters, got {length}");
            return Err(EditError::invalid("name", message, ""));
        }
        if self.snapshots().iter().any(|snapshot| snapshot.snapshot == name) {
            let message = format!("expected a new name, got {name:?}");
            return Err(EditError::invalid("name", message, "snapshots are never replaced"));
        }
        let snapshot = Snapshot { snapshot: name.to_owned(), revision: self.revision(), stamp: stamp.clone() };
        self.prepare()?;
        self.append(&snapshot)?;
        self.history.record_snapshot(snapshot);
        Ok(())
    }

    fn take_back(&mut self, revision: u64, stamp: &Stamp) -> Result<Applied, EditError> {
        self.check_unchanged(revision)?;
        let nothing = || EditError::Nothing { author: stamp.author.clone(), action: "undo" };
        let inverse = self.history.inverse(revision).ok_or_else(nothing)?;
        let change = inverse.apply(&self.scenario, self.assets)?;
        let fields = fields::of(&change.operation, &self.scenario);
        self.commit(change, fields, self.revision(), stamp, Some(revision), None)
    }

    fn apply_again(&mut self, revision: u64, stamp: &Stamp) -> Result<Applied, EditError> {
        self.check_unchanged(revision)?;
        let nothing = || EditError::Nothing { author: stamp.author.clone(), action: "redo" };
        let operation = self.history.operation(revision).ok_or_else(nothing)?;
        let change = operation.apply(&self.scenario, self.assets)?;
        let fields = fields::of(&change.operation, &self.scenario);
        self.commit(change, fields, self.revision(), stamp, None, Some(revision))
    }

    /// Acknowledgement of an earlier request with the same operation id; `None` for a new request.
    fn seen(&self, stamp: &Stamp) -> Result<Option<Applied>, EditError> {
        check_stamp(stamp)?;
        let revision = self.history.known(&stamp.client_operation_id);
        Ok(revision.map(|revision| Applied { revision, scenario: Arc::clone(&self.scenario) }))
    }

    fn check_unchanged(&self, revision: u64) -> Result<(), EditError> {
        match self.history.changed_after(revision) {
            Some(changed) => Err(self.conflict(changed, Value::Null)),
            None => Ok(()),
        }
    }

    fn conflict(&self, Overlap { field, revision }: Overlap, mine: Value) -> EditError {
        let theirs = fields::value(&field, &self.scenario);
        EditError::Conflict(Box::new(Conflict { field, mine, theirs, revision }))
    }

    fn commit(
        &mut self,
        change: Change,
        fields: Vec<String>,
        base_revision: u64,
        stamp: &Stamp,
        undoes: Option<u64>,
        redoes: Option<u64>,
    ) -> Result<Applied, EditError> {
        self.prepare()?;
        let text = change.scenario.to_json();
        let line = CommandLine {
            revision: self.revision() + 1,
            operation: change.operation,
            stamp: stamp.clone(),
            base_revision,
            undoes,
            redoes,
            sha256: sha256(text.as_bytes()),
        };
        let length = self.log.length();
        self.append(&line)?;
        if let Err(error) = write_file(&self.path, text.as_bytes()) {
            self.is_stopped = self.log.cut(length).is_err();
            return Err(error.into());
        }
        self.file_sha256.clone_from(&line.sha256);
        self.history.record(line, change.inverse, fields);
        self.scenario = Arc::new(change.scenario);
        Ok(Applied { revision: self.revision(), scenario: Arc::clone(&self.scenario) })
    }

    /// Checks that the files may be written and were not changed by another program, and opens the log.
    fn prepare(&mut self) -> Result<(), EditError> {
        if self.is_stopped {
            return Err(EditError::Stopped { path: self.path.clone() });
        }
        if let Some(reason) = Self::read_only_reason(&self.path) {
            return Err(EditError::ReadOnly { path: self.path.clone(), reason });
        }
        if sha256(&read_bytes(&self.path, limits::SCENARIO)?) != self.file_sha256 {
            return Err(EditError::ChangedOutside { path: self.path.clone() });
        }
        if !self.log.exists() {
            self.create_log()?;
        }
        self.log.open(&self.path)?;
        if self.is_behind {
            let text = self.scenario.to_json();
            write_file(&self.path, text.as_bytes())?;
            (self.file_sha256, self.is_behind) = (sha256(text.as_bytes()), false);
        }
        Ok(())
    }

    fn create_log(&mut self) -> Result<(), EditError> {
        self.log.create(&Header {
            schema: SCHEMA.into(),
            parent: self.parent.clone(),
            sha256: self.file_sha256.clone(),
            scenario: self.first.to_value(),
        })
    }

    fn append(&mut self, line: &impl Serialize) -> Result<(), EditError> {
        let appended = self.log.append(line);
        self.is_stopped = matches!(appended, Err(EditError::Stopped { .. }));
        appended
    }
}
