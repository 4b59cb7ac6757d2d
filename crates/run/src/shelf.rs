//! The tasks of a run, out of memory while it is collected.

use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use genmanip_core::{Task, TaskKind};

use crate::error::RunError;

/// Tasks in an unnamed file, which nothing leaves behind, so that a run's memory does not grow with them.
pub(crate) struct Shelf {
    file: Mutex<File>,
    entries: Vec<Shelved>,
}

/// What is kept of a task in memory.
pub(crate) struct Shelved {
    pub id: String,
    pub kind: TaskKind,
    /// Where its text lies in the file, bytes.
    start: u64,
    length: usize,
}

impl Shelf {
    /// Puts tasks into a file on the disk of a folder.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn new(tasks: Vec<Task>, folder: &Path) -> Result<Self, RunError> {
        let failed = |error: std::io::Error| {
            let help = "check that the folder is writable and the disk is not full";
            RunError::file("write", folder, error).with_hint(help)
        };
        let mut out = BufWriter::new(tempfile::tempfile_in(folder).map_err(failed)?);
        let (mut entries, mut start) = (Vec::with_capacity(tasks.len()), 0);
        for task in tasks {
            let text = serde_json::to_vec(&task).map_err(|error| failed(error.into()))?;
            out.write_all(&text).map_err(failed)?;
            entries.push(Shelved { id: task.id, kind: task.kind, start, length: text.len() });
            start += text.len() as u64;
        }
        let file = out.into_inner().map_err(|error| failed(error.into_error()))?;
        Ok(Self { file: Mutex::new(file), entries })
    }

    /// What there is, in the order of the tasks.
    pub fn entries(&self) -> &[Shelved] {
        &self.entries
    }

    /// A task by its place in the order.
    ///
    /// # Errors
    /// When the disk gives it back no more.
    pub fn read(&self, index: usize) -> Result<Task, RunError> {
        let Shelved { id, start, length, .. } = &self.entries[index];
        let mut text = vec![0; *length];
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let read = file.seek(SeekFrom::Start(*start)).and_then(|_| file.read_exact(&mut text));
        drop(file);
        let task = read.and_then(|()| serde_json::from_slice(&text).map_err(std::io::Error::from));
        task.map_err(|error| RunError::broken(format!("cannot read task {id} again"), error))
    }
}

#[cfg(test)]
mod tests {
    use genmanip_assets::Catalogue;

    use super::*;
    use crate::inputs;

    #[test]
    fn tasks_come_back_as_they_were_in_any_order_and_leave_nothing() {
        let tasks = inputs::designed_tasks(6, 3, Catalogue::builtin()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let shelf = Shelf::new(tasks.clone(), folder.path()).unwrap();
        let known: Vec<_> = shelf.entries().iter().map(|entry| (entry.id.as_str(), entry.kind)).collect();
        assert_eq!(known, tasks.iter().map(|task| (task.id.as_str(), task.kind)).collect::<Vec<_>>());
        for index in [4, 0, 5, 1, 2, 3, 0] {
            assert_eq!(shelf.read(index).unwrap(), tasks[index]);
        }
        drop(shelf);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(Shelf::new(tasks, &folder.path().join("missing")).is_err());
    }
}
