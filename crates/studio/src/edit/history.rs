//! History of a scenario: its commands, those that are in effect, and those that an author can undo and redo.

use std::collections::{BTreeMap, BTreeSet};

use super::fields::overlap;
use super::log::{CommandLine, Snapshot};
use super::operation::Operation;

/// All commands of a scenario, in order; revision `n` was made by entry `n - 1`.
#[derive(Clone, Debug, Default)]
pub(super) struct History {
    entries: Vec<Entry>,
    snapshots: Vec<Snapshot>,
    /// Revision by client operation id.
    known: BTreeMap<String, u64>,
}

#[derive(Clone, Debug)]
struct Entry {
    line: CommandLine,
    /// Operation that undoes the command, for the state in which it was last applied.
    inverse: Operation,
    fields: Vec<String>,
    /// Revision since which the command is in effect: its own, or that of its last redo.
    since: u64,
    /// Revision and author of the undo; `None` if the command is in effect.
    undone: Option<(u64, String)>,
}

/// A field that a later command changed as well.
pub(super) struct Overlap {
    pub field: String,
    pub revision: u64,
}

impl History {
    /// Number of the present revision, which is the number of commands.
    pub fn revision(&self) -> u64 {
        self.entries.len() as u64
    }

    /// All commands, in order.
    pub fn lines(&self) -> impl Iterator<Item = &CommandLine> {
        self.entries.iter().map(|entry| &entry.line)
    }

    /// All snapshots, in order.
    pub fn snapshots(&self) -> &[Snapshot] {
        &self.snapshots
    }

    /// Revision that the command with this client operation id made, or that the snapshot with this id names; `None`
    /// for a new id.
    pub fn known(&self, client_operation_id: &str) -> Option<u64> {
        self.known.get(client_operation_id).copied()
    }

    /// Records a command with its inverse and the fields that it changed.
    pub fn record(&mut self, line: CommandLine, inverse: Operation, fields: Vec<String>) {
        let revision = line.revision;
        if let Some(entry) = line.undoes.and_then(|undone| self.entry_mut(undone)) {
            entry.undone = Some((revision, line.stamp.author.clone()));
        }
        if let Some(entry) = line.redoes.and_then(|redone| self.entry_mut(redone)) {
            (entry.undone, entry.since, entry.inverse) = (None, revision, inverse.clone());
        }
        self.known.insert(line.stamp.client_operation_id.clone(), revision);
        self.entries.push(Entry { line, inverse, fields, since: revision, undone: None });
    }

    /// Appends a snapshot, and remembers its operation id.
    pub fn record_snapshot(&mut self, snapshot: Snapshot) {
        self.known.insert(snapshot.stamp.client_operation_id.clone(), snapshot.revision);
        self.snapshots.push(snapshot);
    }

    /// Names of all who gave a command, sorted.
    pub fn authors(&self) -> BTreeSet<&str> {
        self.entries.iter().map(|entry| entry.line.stamp.author.as_str()).collect()
    }

    /// Revision of the author's command in effect that was applied or redone last; `None` without one.
    pub fn undoable(&self, author: &str) -> Option<u64> {
        let own = self.entries.iter().filter(|entry| entry.line.stamp.author == author && entry.is_in_effect());
        own.max_by_key(|entry| entry.since).map(|entry| entry.line.revision)
    }

    /// Revision of the command that the author undid last; `None` without one, or if the author has given a
    /// new command since.
    pub fn redoable(&self, author: &str) -> Option<u64> {
        let own = self.entries.iter().filter(|entry| entry.is_plain() && entry.line.stamp.author == author);
        let last = own.map(|entry| entry.line.revision).max().unwrap_or(0);
        let undone = self.entries.iter().filter_map(|entry| {
            let (at, by) = entry.undone.as_ref()?;
            (by == author && *at > last).then_some((*at, entry.line.revision))
        });
        undone.max().map(|(_, revision)| revision)
    }

    /// Operation that undoes the command of a revision; `None` if it does not exist or is not in effect.
    pub fn inverse(&self, revision: u64) -> Option<&Operation> {
        self.entry(revision).filter(|entry| entry.is_in_effect()).map(|entry| &entry.inverse)
    }

    /// Operation of the command of a revision; `None` if it does not exist.
    pub fn operation(&self, revision: u64) -> Option<&Operation> {
        self.entry(revision).map(|entry| &entry.line.operation)
    }

    /// Revision of the command that an undo or redo refers to; for other commands the revision itself; `None` if it
    /// does not exist.
    pub fn target(&self, revision: u64) -> Option<u64> {
        let line = &self.entry(revision)?.line;
        Some(line.undoes.or(line.redoes).unwrap_or(revision))
    }

    /// True if the command of a revision is undone.
    pub fn is_undone(&self, revision: u64) -> bool {
        self.entry(revision).is_some_and(|entry| entry.undone.is_some())
    }

    /// Latest command of another author after the base revision that changed one of the fields, with the first such
    /// field; `None` if there is none.
    pub fn changed_since(&self, base_revision: u64, author: &str, fields: &[String]) -> Option<Overlap> {
        let later = self.entries.iter().filter(|entry| entry.line.revision > base_revision);
        overlapping(later.filter(|entry| entry.line.stamp.author != author), fields, |entry| entry.line.revision)
    }

    /// True if another author made a revision after this one.
    pub fn others_since(&self, base_revision: u64, author: &str) -> bool {
        let mut later = self.entries.iter().filter(|entry| entry.line.revision > base_revision);
        later.any(|entry| entry.line.stamp.author != author)
    }

    /// Latest other command in effect that changed a field of this command since it was last applied or, if it is
    /// undone, since the undo; with the first such field. After an undo, earlier commands of the same author do not
    /// count, even if redone since. `None` if there is none.
    pub fn changed_after(&self, revision: u64) -> Option<Overlap> {
        let entry = self.entry(revision)?;
        let is_later = |other: &&Entry| match &entry.undone {
            None => other.since > entry.since,
            Some((at, _)) if other.line.stamp.author == entry.line.stamp.author => other.line.revision > *at,
            Some((at, _)) => other.since > *at,
        };
        let later = self.entries.iter().filter(|other| other.is_in_effect() && other.line.revision != revision);
        overlapping(later.filter(is_later), &entry.fields, |other| other.since)
    }

    fn entry(&self, revision: u64) -> Option<&Entry> {
        self.entries.get(usize::try_from(revision).ok()?.checked_sub(1)?)
    }

    fn entry_mut(&mut self, revision: u64) -> Option<&mut Entry> {
        self.entries.get_mut(usize::try_from(revision).ok()?.checked_sub(1)?)
    }
}

impl Entry {
    /// True for a command that is neither an undo nor a redo.
    fn is_plain(&self) -> bool {
        self.line.undoes.is_none() && self.line.redoes.is_none()
    }

    fn is_in_effect(&self) -> bool {
        self.is_plain() && self.undone.is_none()
    }
}

fn overlapping<'a>(
    entries: impl Iterator<Item = &'a Entry>,
    fields: &[String],
    revision: impl Fn(&Entry) -> u64,
) -> Option<Overlap> {
    let mut found: Option<Overlap> = None;
    for entry in entries {
        if let Some(field) = overlap(fields, &entry.fields) {
            found = Some(Overlap { field: field.clone(), revision: revision(entry) });
        }
    }
    found
}
