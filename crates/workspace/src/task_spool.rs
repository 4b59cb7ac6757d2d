//! Tasks of a run, spooled to a temporary file and read one by one, so that memory does not grow with their number.

use std::fmt;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_core::{Task, TaskKind};
use serde::ser::{Error, Serialize, SerializeSeq, Serializer};
use tempfile::SpooledTempFile;

use crate::error::WorkspaceError;

/// Total text length above which tasks are spooled to a file, bytes: some 3,000 tasks. Chosen by hand.
const MAX_IN_MEMORY_BYTES: usize = 32 << 20;

/// Tasks of a run: few are held in memory, many in an anonymous temporary file, which is removed with the last clone.
/// Clones share the tasks.
#[derive(Clone)]
pub struct Tasks(Arc<Spooled>);

/// Entry of a task that is always in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TaskEntry {
    /// Id of the task.
    pub id: String,
    /// Kind of the task.
    pub kind: TaskKind,
    /// Byte offset of the task's text in the spool.
    start: u64,
    length: usize,
}

struct Spooled {
    texts: Mutex<SpooledTempFile>,
    entries: Vec<TaskEntry>,
}

/// Builder of [`Tasks`]: appends tasks one by one.
pub struct Spool {
    texts: SpooledTempFile,
    entries: Vec<TaskEntry>,
    end: u64,
}

impl Spool {
    /// Empty spool; its temporary file, if needed, is created in `folder`.
    pub fn in_folder(folder: &Path) -> Self {
        Self { texts: tempfile::spooled_tempfile_in(MAX_IN_MEMORY_BYTES, folder), entries: Vec::new(), end: 0 }
    }

    /// Appends a task.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub fn add(&mut self, task: Task) -> Result<(), WorkspaceError> {
        let text = serde_json::to_vec(&task).map_err(std::io::Error::from);
        let text = text.and_then(|text| self.texts.write_all(&text).map(|()| text)).map_err(|error| {
            WorkspaceError::broken("cannot keep the tasks aside", error)
                .with_hint("check that the disk of the output folder is writable and not full")
        })?;
        self.entries.push(TaskEntry { id: task.id, kind: task.kind, start: self.end, length: text.len() });
        self.end += text.len() as u64;
        Ok(())
    }

    /// All appended tasks, in the order of their addition.
    pub fn finish(self) -> Tasks {
        let Self { texts, entries, .. } = self;
        Tasks(Arc::new(Spooled { texts: Mutex::new(texts), entries }))
    }
}

impl Tasks {
    /// Spools `tasks`; the temporary file, if needed, is created in `folder`.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub fn spool(tasks: impl IntoIterator<Item = Task>, folder: &Path) -> Result<Self, WorkspaceError> {
        let mut spool = Spool::in_folder(folder);
        tasks.into_iter().try_for_each(|task| spool.add(task))?;
        Ok(spool.finish())
    }

    /// Entries in the order of the tasks.
    pub fn entries(&self) -> &[TaskEntry] {
        &self.0.entries
    }

    /// Reads the task with an index.
    ///
    /// # Errors
    /// When the temporary file cannot be read.
    pub fn read(&self, index: usize) -> Result<Task, WorkspaceError> {
        let task = self.text(index).and_then(|text| serde_json::from_slice(&text).map_err(std::io::Error::from));
        task.map_err(|error| {
            WorkspaceError::broken(format!("cannot read task {} again", self.entries()[index].id), error)
        })
    }

    /// Reads all tasks, one by one.
    pub fn iter(&self) -> impl Iterator<Item = Result<Task, WorkspaceError>> + '_ {
        (0..self.entries().len()).map(|index| self.read(index))
    }

    fn text(&self, index: usize) -> std::io::Result<Vec<u8>> {
        let TaskEntry { start, length, .. } = &self.entries()[index];
        let mut text = vec![0; *length];
        let mut texts = self.0.texts.lock().unwrap_or_else(PoisonError::into_inner);
        texts.seek(SeekFrom::Start(*start))?;
        texts.read_exact(&mut text)?;
        Ok(text)
    }
}

/// Compares tasks by their texts; a task that cannot be read equals no other.
impl PartialEq for Tasks {
    fn eq(&self, other: &Self) -> bool {
        let is_same = |index| self.text(index).ok().is_some_and(|text| other.text(index).is_ok_and(|it| it == text));
        Arc::ptr_eq(&self.0, &other.0) || self.entries() == other.entries() && (0..self.entries().len()).all(is_same)
    }
}

impl Serialize for Tasks {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut list = serializer.serialize_seq(Some(self.entries().len()))?;
        for task in self.iter() {
            list.serialize_element(&task.map_err(S::Error::custom)?)?;
        }
        list.end()
    }
}

impl fmt::Debug for Tasks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.entries().iter().map(|entry| &entry.id)).finish()
    }
}

#[cfg(test)]
mod tests {
    use genmanip_assets::Catalogue;

    use super::*;
    use crate::task_files;

    #[test]
    fn tasks_come_back_as_they_were_in_any_order_and_leave_nothing() {
        let designed = task_files::designed_tasks(6, 3, Catalogue::builtin()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let check = |most: usize| {
            let mut spool =
                Spool { texts: tempfile::spooled_tempfile_in(most, folder.path()), ..Spool::in_folder(folder.path()) };
            designed.iter().for_each(|task| spool.add(task.clone()).unwrap());
            assert_eq!(spool.texts.is_rolled(), most == 0);
            let tasks = spool.finish();
            let known: Vec<_> = tasks.entries().iter().map(|entry| (entry.id.as_str(), entry.kind)).collect();
            assert_eq!(known, designed.iter().map(|task| (task.id.as_str(), task.kind)).collect::<Vec<_>>());
            for index in [4, 0, 5, 1, 2, 3, 0] {
                assert_eq!(tasks.read(index).unwrap(), designed[index]);
            }
            tasks
        };
        let (on_disk, in_memory) = (check(0), check(MAX_IN_MEMORY_BYTES));
        assert_eq!(on_disk, in_memory);
        let others = designed.iter().map(|task| Task { instruction: task.instruction.to_uppercase(), ..task.clone() });
        assert_ne!(Tasks::spool(others, folder.path()).unwrap(), in_memory);
        drop(on_disk);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let mut nowhere = Spool {
            texts: tempfile::spooled_tempfile_in(0, folder.path().join("missing")),
            ..Spool::in_folder(folder.path())
        };
        assert!(nowhere.add(designed[0].clone()).is_err());
    }
}
