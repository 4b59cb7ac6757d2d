//! Written aside, synced, renamed: a folder is there whole or not at all.

use std::fs::{self, File};
use std::path::{Component, Path, PathBuf};

use serde_json::Value;

use crate::DataError;
use crate::files::{names, remove, write_new};
use crate::partial::beside;

/// A folder that becomes visible under its name only when it is complete.
///
/// Dropping it before [`Aside::publish`] removes everything written so far.
#[derive(Debug)]
pub(crate) struct Aside {
    target: PathBuf,
    folder: PathBuf,
    replaces: bool,
    published: bool,
}

/// How often a folder is moved out of the way that another program keeps putting there.
const TRIES: usize = 100;

impl Aside {
    /// Starts a folder that shall appear at `target`. Its parent must exist.
    pub(crate) fn new(target: &Path) -> Result<Self, DataError> {
        if fs::symlink_metadata(target).is_ok() {
            return Err(DataError::Exists { path: target.to_owned() });
        }
        Self::begin(target, false)
    }

    /// As [`Aside::new`], for a target that may exist and is then replaced.
    pub(crate) fn replacing(target: &Path) -> Result<Self, DataError> {
        Self::begin(target, true)
    }

    fn begin(target: &Path, replaces: bool) -> Result<Self, DataError> {
        let folder = beside(target);
        fs::create_dir(&folder).map_err(DataError::io("create the folder", &folder))?;
        Ok(Self { target: target.to_owned(), folder, replaces, published: false })
    }

    /// The folder until it is published.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where a file of the folder lies until it is published; folders on the way are made.
    ///
    /// # Errors
    /// When the name leads out of the folder, or the disk refuses.
    pub(crate) fn path(&self, name: &str) -> Result<PathBuf, DataError> {
        // Names are made of what data sets call their columns.
        if name.is_empty() || !Path::new(name).components().all(|part| matches!(part, Component::Normal(_))) {
            return Err(DataError::mismatch("name of a file", "one within the data set", name));
        }
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
    ///
    /// # Errors
    /// [`DataError::Exists`] when another program was quicker and nothing is to be replaced.
    pub(crate) fn publish(mut self) -> Result<(), DataError> {
        sync_tree(&self.folder)?;
        let mut outdated = Vec::new();
        for _ in 0..TRIES {
            // A folder that holds something is never replaced by a rename, so that nothing is lost unnoticed.
            match fs::rename(&self.folder, &self.target) {
                Ok(()) => {
                    self.published = true;
                    break;
                }
                Err(error) if fs::symlink_metadata(&self.target).is_err() => {
                    return Err(DataError::io("rename", &self.target)(error));
                }
                Err(_) if !self.replaces => return Err(DataError::Exists { path: self.target.clone() }),
                Err(_) => {
                    let old = beside(&self.target);
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

impl Drop for Aside {
    fn drop(&mut self) {
        if !self.published {
            // Nothing more can be done about a failure here: the folder stays marked and is ignored by readers.
            let _ = fs::remove_dir_all(&self.folder);
        }
    }
}

/// Writes a JSON file of a data set.
pub(crate) fn write_json(dataset: &Aside, name: &str, value: &Value) -> Result<(), DataError> {
    let text = serde_json::to_string_pretty(value)
        .map_err(|error| DataError::NotWritable { what: name.into(), why: error.to_string() })?;
    dataset.write(name, (text + "\n").as_bytes())
}

/// Writes one file so that it is on the disk when this returns; there must be none.
pub(crate) fn write_synced(path: &Path, bytes: &[u8]) -> Result<(), DataError> {
    write_new(path, bytes).map_err(DataError::io("write", path))
}

/// The folder something lies in; a bare name lies in the current one.
pub(crate) fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Makes the folder that something shall lie in.
pub(crate) fn make_parent(path: &Path) -> Result<(), DataError> {
    let parent = parent(path);
    fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))
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
