//! Written aside, synced, renamed: a folder is there whole or not at all.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use serde_json::Value;

use crate::DataError;
use crate::files::{is_own_file, is_own_folder, names, remove, write_new};
use crate::partial::beside;

/// A folder that becomes visible under its name only when it is complete.
///
/// Dropping it before [`Aside::publish`] removes everything written so far.
#[derive(Debug)]
pub(crate) struct Aside {
    target: PathBuf,
    folder: PathBuf,
    there: There,
    published: bool,
}

/// What becomes of a folder that lies at the target already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum There {
    /// It stays, and nothing is published.
    Refused,
    Replaced,
    /// It counts as published if it holds the same, and stays otherwise.
    Kept,
}

/// Files are compared in pieces of so many bytes.
const PIECE: u64 = 1 << 20;
/// How often a folder is moved out of the way that another program keeps putting there.
const TRIES: usize = 100;

impl Aside {
    /// Starts a folder that shall appear at `target`. Its parent must exist.
    pub(crate) fn new(target: &Path) -> Result<Self, DataError> {
        if fs::symlink_metadata(target).is_ok() {
            return Err(DataError::Exists { path: target.to_owned() });
        }
        Self::begin(target, There::Refused)
    }

    /// As [`Aside::new`], for a target that may exist and is then replaced.
    pub(crate) fn replacing(target: &Path) -> Result<Self, DataError> {
        Self::begin(target, There::Replaced)
    }

    /// As [`Aside::new`], for a target that may exist if it holds the same, as what a call left that was killed later.
    pub(crate) fn repeating(target: &Path) -> Result<Self, DataError> {
        Self::begin(target, There::Kept)
    }

    fn begin(target: &Path, there: There) -> Result<Self, DataError> {
        let folder = beside(target);
        fs::create_dir(&folder).map_err(DataError::io("create the folder", &folder))?;
        Ok(Self { target: target.to_owned(), folder, there, published: false })
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
    /// [`DataError::Exists`] when another program was quicker and nothing is to be replaced, or what lies there differs.
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
                Err(_) if self.there == There::Kept && is_same(&self.folder, &self.target)? => return Ok(()),
                Err(_) if self.there != There::Replaced => return Err(DataError::Exists { path: self.target.clone() }),
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

/// Whether two folders hold the same files.
fn is_same(left: &Path, right: &Path) -> Result<bool, DataError> {
    let both = names(left)?;
    if !is_own_folder(right) || both != names(right)? {
        return Ok(false);
    }
    for name in both {
        let (left, right) = (left.join(&name), right.join(&name));
        let is_same = match is_own_folder(&left) {
            true => is_same(&left, &right)?,
            false => is_own_file(&right) && has_same_bytes(&left, &right)?,
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
        let mut pieces = [Vec::new(), Vec::new()];
        for (piece, (file, path)) in pieces.iter_mut().zip([(&mut ours, left), (&mut theirs, right)]) {
            file.take(PIECE).read_to_end(piece).map_err(DataError::io("read", path))?;
        }
        if pieces[0] != pieces[1] || pieces[0].is_empty() {
            return Ok(pieces[0] == pieces[1]);
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
    fn what_a_killed_call_left_is_kept_if_it_is_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("made-depth");
        let write = |bytes: &[u8], name: &str| {
            let aside = Aside::repeating(&target).unwrap();
            aside.write(name, bytes).unwrap();
            aside.write("meta/info.json", b"{}").unwrap();
            aside.publish()
        };
        let large = vec![7; 3 << 20];
        write(&large, "data/rows").unwrap();
        write(&large, "data/rows").unwrap();
        for (bytes, name) in [(&large[1..], "data/rows"), (&large[..], "data/other"), (b"", "data/rows")] {
            assert!(matches!(write(bytes, name), Err(DataError::Exists { .. })), "{name}, {} bytes", bytes.len());
        }
        assert_eq!(fs::read(target.join("data/rows")).unwrap(), large);
        assert_eq!(names(folder.path()).unwrap(), ["made-depth"], "nothing else is left");
    }
}
