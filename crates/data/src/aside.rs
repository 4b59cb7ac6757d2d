//! Written aside, synced, renamed: a folder is there whole or not at all.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::DataError;

/// Marks folders that a run has not finished; the process id follows.
const MARK: &str = ".partial-";
/// Marks what a finished folder is about to replace.
const OLD: &str = ".old.partial-";

/// A folder that becomes visible under its name only when it is complete.
///
/// Dropping it before [`Aside::publish`] removes everything written so far.
#[derive(Debug)]
pub(crate) struct Aside {
    target: PathBuf,
    folder: PathBuf,
    published: bool,
}

impl Aside {
    /// Starts a folder that shall appear at `target`. Its parent must exist.
    pub(crate) fn new(target: &Path) -> Result<Self, DataError> {
        if target.exists() {
            return Err(DataError::Exists { path: target.to_owned() });
        }
        Self::replacing(target)
    }

    /// As [`Aside::new`], for a target that may exist and is then replaced.
    pub(crate) fn replacing(target: &Path) -> Result<Self, DataError> {
        let folder = beside(target, &format!("{MARK}{}", std::process::id()));
        remove(&folder)?;
        fs::create_dir(&folder).map_err(DataError::io("create the folder", &folder))?;
        Ok(Self { target: target.to_owned(), folder, published: false })
    }

    /// Where a file of the folder lies until it is published; folders on the way are made.
    pub(crate) fn path(&self, name: &str) -> Result<PathBuf, DataError> {
        let path = self.folder.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))?;
        }
        Ok(path)
    }

    /// Writes and syncs one file.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> Result<(), DataError> {
        let path = self.path(name)?;
        write_synced(&path, bytes)
    }

    /// Makes the folder visible under its name.
    pub(crate) fn publish(mut self) -> Result<(), DataError> {
        sync_tree(&self.folder)?;
        let old = beside(&self.target, &format!("{OLD}{}", std::process::id()));
        if self.target.exists() {
            remove(&old)?;
            fs::rename(&self.target, &old).map_err(DataError::io("rename", &self.target))?;
        }
        fs::rename(&self.folder, &self.target).map_err(DataError::io("rename", &self.target))?;
        self.published = true;
        sync_folder(parent(&self.target))?;
        remove(&old)
    }
}

impl Drop for Aside {
    fn drop(&mut self) {
        if !self.published {
            // Nothing more can be done about a failure here: the folder stays marked and is ignored by readers.
            let _ = fs::remove_dir_all(&self.folder);
        }
    }
}

/// Removes what killed runs left in a folder; what a process that still runs is writing stays.
///
/// Leftovers of the calling process count as its own, so call this before it writes anything.
/// Returns the names removed, sorted. Where there is no `/proc`, every leftover is removed.
pub(crate) fn sweep(folder: &Path) -> Result<Vec<String>, DataError> {
    let mut removed = Vec::new();
    for name in names(folder)? {
        if is_leftover(&name) {
            remove(&folder.join(&name))?;
            removed.push(name);
        }
    }
    Ok(removed)
}

/// Removes what killed runs left of one target, see [`sweep`].
pub(crate) fn sweep_target(target: &Path) -> Result<(), DataError> {
    let partial = beside(target, MARK);
    let beginning = partial.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let parent = parent(target);
    for name in names(parent)? {
        let ours = name.starts_with(&beginning) || name.starts_with(&beginning.replace(MARK, OLD));
        if ours && is_leftover(&name) {
            remove(&parent.join(name))?;
        }
    }
    Ok(())
}

/// Sorted names of the entries of a folder.
pub(crate) fn names(folder: &Path) -> Result<Vec<String>, DataError> {
    let entries = fs::read_dir(folder).map_err(DataError::io("list", folder))?;
    let mut names = Vec::new();
    for entry in entries {
        let entry = entry.map_err(DataError::io("list", folder))?;
        if let Ok(name) = entry.file_name().into_string() {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

/// Writes one file so that it is on the disk when this returns.
pub(crate) fn write_synced(path: &Path, bytes: &[u8]) -> Result<(), DataError> {
    let file = File::create(path).map_err(DataError::io("create", path))?;
    let mut writer = BufWriter::new(file);
    writer.write_all(bytes).map_err(DataError::io("write", path))?;
    let file = writer.into_inner().map_err(|error| DataError::io("write", path)(error.into_error()))?;
    file.sync_all().map_err(DataError::io("write", path))
}

fn is_leftover(name: &str) -> bool {
    let Some((_, pid)) = name.rsplit_once(MARK) else { return false };
    let Ok(pid) = pid.parse::<u32>() else { return false };
    let alive = Path::new("/proc/self").exists() && Path::new("/proc").join(pid.to_string()).exists();
    name.starts_with('.') && (!alive || pid == std::process::id())
}

fn beside(target: &Path, ending: &str) -> PathBuf {
    let name = target.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    target.with_file_name(format!(".{name}{ending}"))
}

/// The folder something lies in; a bare name lies in the current one.
fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn remove(path: &Path) -> Result<(), DataError> {
    let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    match removed {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(DataError::io("remove", path)(error)),
        _ => Ok(()),
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
