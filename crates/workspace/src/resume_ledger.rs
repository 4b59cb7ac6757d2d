//! Ledger of finished items, a JSON Lines file beside their files, from which a killed call resumes.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use genmanip_core::limits;
use genmanip_data::files;
use serde::{Deserialize, Serialize};

use crate::documents;
use crate::error::WorkspaceError;

/// Ledger line of one finished item.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Entry {
    /// Name of the item, unique within a ledger.
    pub name: String,
    /// Hash of all inputs of the item.
    pub key: String,
    /// Reason why the item has no file; `None` if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

/// The ledger: appended in completion order, sorted by name on [`close`](Ledger::close).
pub struct Ledger {
    path: PathBuf,
    known: BTreeMap<String, Entry>,
    file: Mutex<File>,
}

impl Ledger {
    /// Opens or creates the ledger at a path; ignores a line truncated by a kill.
    ///
    /// # Errors
    /// When it cannot be read or written.
    pub fn open(path: &Path) -> Result<Self, WorkspaceError> {
        let failed = |error| {
            let help = "check that the folder exists, is writable and the disk is not full";
            WorkspaceError::file("write", path, error).with_hint(help)
        };
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(failed)?;
        }
        let bytes = match files::read_no_follow(path, limits::LEDGER) {
            Err(error) if error.is_missing() => Vec::new(),
            bytes => bytes.map_err(|error| WorkspaceError::of_file("read", path, error))?,
        };
        let lines = bytes.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice::<Entry>(line).ok());
        let known = lines.map(|entry| (entry.name.clone(), entry)).collect();
        let mut file = OpenOptions::new().create(true).append(true).open(path).map_err(failed)?;
        if bytes.last().is_some_and(|last| *last != b'\n') {
            file.write_all(b"\n").map_err(failed)?;
        }
        Ok(Self { path: path.to_owned(), known, file: Mutex::new(file) })
    }

    /// Entry of an item that an earlier call finished. `None` if none did.
    pub fn known(&self, name: &str) -> Option<&Entry> {
        self.known.get(name)
    }

    /// Appends an entry; the item's file must exist by then.
    ///
    /// # Errors
    /// When the ledger cannot be written.
    pub fn add(&self, entry: &Entry) -> Result<(), WorkspaceError> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(line(entry).as_bytes()).map_err(|error| WorkspaceError::file("write", &self.path, error))
    }

    /// Rewrites the ledger sorted by name: `entries`, and earlier ones for which `kept` is true.
    ///
    /// # Errors
    /// When the ledger cannot be written.
    pub fn close(self, entries: Vec<Entry>, kept: impl Fn(&Entry) -> bool) -> Result<(), WorkspaceError> {
        let mut all = self.known;
        all.retain(|_, entry| kept(entry));
        all.extend(entries.into_iter().map(|entry| (entry.name.clone(), entry)));
        let lines: String = all.values().map(line).collect();
        documents::write_file(&self.path, lines.as_bytes())
    }
}

fn line(entry: &Entry) -> String {
    format!("{}\n", serde_json::to_string(entry).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_cut_off_does_not_count_and_the_order_is_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("made.jsonl");
        let entry = |name: &str| Entry { name: name.into(), key: "k".into(), refused: None };
        let ledger = Ledger::open(&path).unwrap();
        ledger.add(&entry("b")).unwrap();
        ledger.add(&entry("a")).unwrap();
        drop(ledger);
        let whole = fs::read(&path).unwrap();
        fs::write(&path, &whole[..whole.len() - 5]).unwrap();
        let ledger = Ledger::open(&path).unwrap();
        assert_eq!((ledger.known("b"), ledger.known("a")), (Some(&entry("b")), None));
        ledger.add(&entry("a")).unwrap();
        ledger.close(vec![entry("a")], |_| true).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(text, "{\"name\":\"a\",\"key\":\"k\"}\n{\"name\":\"b\",\"key\":\"k\"}\n");
        Ledger::open(&path).unwrap().close(vec![], |_| false).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"");
    }
}
