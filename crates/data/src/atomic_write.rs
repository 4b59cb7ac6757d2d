//! Atomic publication of folders: written under a temporary name, synced, then renamed.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use serde_json::Value;

use crate::DataError;
use crate::files::{self, is_file_no_follow, is_folder_no_follow, names, remove, write_new};
use crate::partial::temporary_path;

/// A folder that becomes visible under its name only when it is complete.
///
/// Dropping it before [`AtomicFolder::publish`] removes everything written so far.
#[derive(Debug)]
pub struct AtomicFolder {
    target: PathBuf,
    folder: PathBuf,
    on_conflict: OnConflict,
    published: bool,
}

/// Handling of a folder that already exists at the target when the new one is published.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OnConflict {
    /// The existing folder is kept; publishing fails with [`DataError::Exists`].
    Fail,
    Replace,
    /// Publishing succeeds if it has the same contents and fails otherwise.
    AcceptIdentical,
}

/// Block size for comparing files, bytes. Chosen by hand.
const BLOCK_BYTES: u64 = 1 << 20;
/// Maximum attempts to replace a folder that another program keeps recreating. Chosen by hand.
const MAX_TRIES: usize = 100;

impl AtomicFolder {
    /// Starts a folder to be published at `target`, which must not exist. The parent folder must exist.
    pub fn new(target: &Path) -> Result<Self, DataError> {
        if fs::symlink_metadata(target).is_ok() {
            return Err(DataError::Exists { path: target.to_owned() });
        }
        Self::begin(target, OnConflict::Fail)
    }

    /// As [`AtomicFolder::new`], but an existing target is replaced.
    pub fn replacing(target: &Path) -> Result<Self, DataError> {
        Self::begin(target, OnConflict::Replace)
    }

    /// As [`AtomicFolder::new`], but a target with identical files is accepted, e.g. the output of an earlier call that
    /// was killed after publishing.
    pub fn accepting_identical(target: &Path) -> Result<Self, DataError> {
        Self::begin(target, OnConflict::AcceptIdentical)
    }

    fn begin(target: &Path, on_conflict: OnConflict) -> Result<Self, DataError> {
        let folder = temporary_path(target);
        fs::create_dir(&folder).map_err(DataError::io("create the folder", &folder))?;
        Ok(Self { target: target.to_owned(), folder, on_conflict, published: false })
    }

    /// The temporary folder, until it is published.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Path of a file in the temporary folder; creates its parent folders.
    ///
    /// # Errors
    /// If the name escapes the folder or a parent folder cannot be created.
    pub fn path(&self, name: &str) -> Result<PathBuf, DataError> {
        // Names are derived from the column names of data sets, which are user input.
        if name.is_empty() || !Path::new(name).components().all(|part| matches!(part, Component::Normal(_))) {
            return Err(DataError::mismatch("name of a file", "one within the data set", name));
        }
        let path = self.folder.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))?;
        }
        Ok(path)
    }

    /// Writes and syncs one file, by its path relative to the folder; it must not exist.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), DataError> {
        let path = self.path(name)?;
        write_synced(&path, bytes)
    }

    /// Renames the folder to its final name.
    ///
    /// # Errors
    /// [`DataError::Exists`] if the target exists and may not be replaced, or is not identical.
    pub fn publish(mut self) -> Result<(), DataError> {
        sync_tree(&self.folder)?;
        let mut outdated = Vec::new();
        for _ in 0..MAX_TRIES {
            // A rename never replaces a non-empty folder, so no data is lost unnoticed.
            match fs::rename(&self.folder, &self.target) {
                Ok(()) => {
                    self.published = true;
                    break;
                }
                Err(error) if fs::symlink_metadata(&self.target).is_err() => {
                    return Err(DataError::io("rename", &self.target)(error));
                }
                Err(_) if self.on_conflict == OnConflict::AcceptIdentical && is_same(&self.folder, &self.target)? => {
                    return Ok(());
                }
                Err(_) if self.on_conflict != OnConflict::Replace => {
                    return Err(DataError::Exists { path: self.target.clone() });
                }
                Err(_) => {
                    let old = temporary_path(&self.target);
                    match fs::rename(&self.target, &old) {
                        Ok(()) => outdated.push(old),
                        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
                        Err(error) => return Err(DataError::io("rename", &self.target)(error)),
                    }
                }
            }
        }
        if !self.published {
            return Err(DataError::Exists { path: self.target.clone() });
        }
        sync_folder(parent(&self.target))?;
        outdated.iter().try_for_each(|old| remove(old))
    }
}

impl Drop for AtomicFolder {
    fn drop(&mut self) {
        if !self.published {
            // A failure here cannot be handled: the folder keeps its temporary name, which readers ignore.
            let _ = fs::remove_dir_all(&self.folder);
        }
    }
}

/// Writes a JSON document into an unpublished data set.
pub fn write_json(dataset: &AtomicFolder, name: &str, value: &Value) -> Result<(), DataError> {
    let text = serde_json::to_string_pretty(value)
        .map_err(|error| DataError::NotWritable { what: name.into(), why: error.to_string() })?;
    dataset.write(name, (text + "\n").as_bytes())
}

/// Writes and syncs a new file; the path must not exist.
pub fn write_synced(path: &Path, bytes: &[u8]) -> Result<(), DataError> {
    write_new(path, bytes).map_err(DataError::io("write", path))
}

/// Parent of a path; `.` for a bare name, for which [`Path::parent`] gives an empty path.
fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Creates the parent folder of a path, and removes leftovers of killed processes from it.
pub fn prepare_parent(path: &Path) -> Result<(), DataError> {
    let parent = parent(path);
    fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))?;
    files::sweep(parent)?;
    Ok(())
}

/// True if two folders contain the same files with the same bytes.
fn is_same(left: &Path, right: &Path) -> Result<bool, DataError> {
    let both = names(left)?;
    if !is_folder_no_follow(right) || both != names(right)? {
        return Ok(false);
    }
    for name in both {
        let (left, right) = (left.join(&name), right.join(&name));
        let is_same = match is_folder_no_follow(&left) {
            true => is_same(&left, &right)?,
            false => is_file_no_follow(&right) && has_same_bytes(&left, &right)?,
        };
        if !is_same {
            return Ok(false);
        }
    }
    Ok(true)
}

fn has_same_bytes(left: &Path, right: &Path) -> Result<bool, DataError> {
    let open = |path: &Path| File::open(path).map_err(DataError::io("read", path));
    let (mut ours, mut theirs) = (open(left)?, open(right)?);
    loop {
        let mut blocks = [Vec::new(), Vec::new()];
        for (block, (file, path)) in blocks.iter_mut().zip([(&mut ours, left), (&mut theirs, right)]) {
            file.take(BLOCK_BYTES).read_to_end(block).map_err(DataError::io("read", path))?;
        }
        if blocks[0] != blocks[1] || blocks[0].is_empty() {
            return Ok(blocks[0] == blocks[1]);
        }
    }
}

fn sync_tree(folder: &Path) -> Result<(), DataError> {
    for name in names(folder)? {
        let path = folder.join(name);
        if path.is_dir() {
            sync_tree(&path)?;
        }
    }
    sync_folder(folder)
}

fn sync_folder(folder: &Path) -> Result<(), DataError> {
    File::open(folder).and_then(|file| file.sync_all()).map_err(DataError::io("sync", folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_identical_folder_is_accepted() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("made-depth");
        let write = |bytes: &[u8], name: &str| {
            let staging = AtomicFolder::accepting_identical(&target).unwrap();
            staging.write(name, bytes).unwrap();
            staging.write("meta/info.json", b"{}").unwrap();
            staging.publish()
        };
        let large = vec![7; 3 << 20];
        write(&large, "data/rows").unwrap();
        write(&large, "data/rows").unwrap();
        for (bytes, name) in [(&large[1..], "data/rows"), (&large[..], "data/other"), (b"", "data/rows")] {
            assert!(matches!(write(bytes, name), Err(DataError::Exists { .. })), "{name}, {} bytes", bytes.len());
        }
        assert_eq!(fs::read(target.join("data/rows")).unwrap(), large);
        assert_eq!(names(folder.path()).unwrap(), ["made-depth"], "no temporary folder remains");
    }
}
