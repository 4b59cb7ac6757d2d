//! A folder as objects, and back.
//!
//! `PREFIX/PATH` holds the file PATH, and keeps its hash beside it, so that a push that goes on sends only what is
//! missing or different. [`LIST`] is written last: where it is, all that it names is there.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use genmanip_core::{Document, DocumentError};
use genmanip_data::DataError;
use genmanip_data::files::{self, Writing};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::bucket::{About, PART};
use crate::parallel::each;
use crate::sign::hex;
use crate::{Bucket, S3Error};

/// Name of the object that lists the files of a folder.
pub const LIST: &str = "genmanip-objects.json";
/// Largest list that is read, bytes: some 500,000 files.
const LARGEST_LIST: u64 = 64 << 20;

/// The files of a folder that was pushed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Objects {
    /// Sorted by their paths.
    pub files: Vec<Listed>,
}

/// A file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Listed {
    /// Below the folder, with slashes.
    pub path: String,
    /// Its size.
    pub bytes: u64,
    /// Its hash, in hexadecimal digits.
    pub sha256: String,
}

/// What a push or pull did.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Moved {
    /// Files of the folder.
    pub files: usize,
    /// Their size.
    pub bytes: u64,
    /// Files that were sent or fetched; the others were there already.
    pub moved: usize,
}

impl Document for Objects {
    const SCHEMA: &'static str = "genmanip.objects/1";

    fn check(&self) -> Result<(), DocumentError> {
        let wrong = |path: String, message: String| Err(DocumentError::Invalid { path, message });
        let mut known = BTreeSet::new();
        for (index, file) in self.files.iter().enumerate() {
            if !is_inside(&file.path) {
                return wrong(
                    format!("files[{index}].path"),
                    format!("expected a path within the folder, got {:?}", file.path),
                );
            }
            let is_hash =
                file.sha256.len() == 64 && file.sha256.bytes().all(|c| matches!(c, b'0'..=b'9' | b'a'..=b'f'));
            if !is_hash {
                return wrong(format!("files[{index}].sha256"), format!("expected 64 digits, got {:?}", file.sha256));
            }
            if !known.insert(&file.path) {
                return wrong(format!("files[{index}].path"), format!("{} is listed twice", file.path));
            }
        }
        Ok(())
    }
}

/// Whether a path of a list leads to a file within the folder.
fn is_inside(path: &str) -> bool {
    let is_name = |part: &str| !matches!(part, "" | "." | "..") && !part.contains(['\\', '\0']);
    path.split('/').all(is_name) && path != LIST
}

/// Sends a folder; files that are there with the same size and hash are not sent again, and what is being written
/// (`.NAME.partial-…`) is left out. `heard` is told the number of files and called once per file.
///
/// # Errors
/// [`S3Error::Stopped`] with how far it came: what was sent stays, and another call goes on.
pub fn push(
    bucket: &Bucket,
    folder: &Path,
    prefix: &str,
    at_once: usize,
    heard: &(dyn Fn(usize) + Sync),
) -> Result<Moved, S3Error> {
    let paths = files_below(folder)?;
    let listed = std::sync::Mutex::new(Vec::new());
    let sent = std::sync::atomic::AtomicUsize::new(0);
    let (done, failed) = each(&paths, at_once, &|path: &String| {
        let (file, is_sent) = send(bucket, folder, prefix, path)?;
        listed.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).push(file);
        sent.fetch_add(usize::from(is_sent), std::sync::atomic::Ordering::Relaxed);
        heard(paths.len());
        Ok(())
    });
    if let Some(source) = failed {
        return Err(S3Error::Stopped { done, all: paths.len(), moved: "sent", source: Box::new(source) });
    }
    let mut files = listed.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    files.sort_by(|a, b| a.path.cmp(&b.path));
    let moved =
        Moved { files: files.len(), bytes: files.iter().map(|file| file.bytes).sum(), moved: sent.into_inner() };
    let list = Objects { files }.to_json().into_bytes();
    bucket.put(&key(prefix, LIST), &list, &hex(&Sha256::digest(&list)))?;
    Ok(moved)
}

/// Fetches a folder that was pushed; files that are there with the same size and hash are not fetched again, others are
/// replaced, and what the list does not name stays, but for files that an earlier pull left half-written when it was
/// killed on this machine.
///
/// # Errors
/// [`S3Error::NotComplete`] where no list is; [`S3Error::Stopped`] with how far it came.
pub fn pull(
    bucket: &Bucket,
    prefix: &str,
    folder: &Path,
    at_once: usize,
    heard: &(dyn Fn(usize) + Sync),
) -> Result<Moved, S3Error> {
    let name = key(prefix, LIST);
    let object = bucket.url(&name);
    let list = bucket.fetch(&name, LARGEST_LIST, || Ok(Vec::new()), |_, _| true)?;
    let list = list.ok_or_else(|| S3Error::NotComplete { object: object.clone() })?;
    let Objects { files } = Objects::from_bytes(&list).map_err(|source| S3Error::List { object, source })?;
    fs::create_dir_all(folder).map_err(io("create the folder", folder))?;
    sweep(folder, &files)?;
    let fetched = std::sync::atomic::AtomicUsize::new(0);
    let (done, failed) = each(&files, at_once, &|file: &Listed| {
        let is_fetched = fetch(bucket, prefix, folder, file)?;
        fetched.fetch_add(usize::from(is_fetched), std::sync::atomic::Ordering::Relaxed);
        heard(files.len());
        Ok(())
    });
    match failed {
        Some(source) => Err(S3Error::Stopped { done, all: files.len(), moved: "here", source: Box::new(source) }),
        None => Ok(Moved {
            files: files.len(),
            bytes: files.iter().map(|file| file.bytes).sum(),
            moved: fetched.into_inner(),
        }),
    }
}

/// Removes what a pull that was killed left half-written, in all folders that a list names.
fn sweep(folder: &Path, listed: &[Listed]) -> Result<(), S3Error> {
    let parents: BTreeSet<&str> =
        listed.iter().map(|file| file.path.rsplit_once('/').map_or("", |(parent, _)| parent)).collect();
    for parent in parents.into_iter().map(|parent| folder.join(parent)).filter(|parent| parent.is_dir()) {
        files::sweep(&parent)?;
    }
    Ok(())
}

/// Sends a file unless it is there; whether it was sent.
fn send(bucket: &Bucket, folder: &Path, prefix: &str, path: &str) -> Result<(Listed, bool), S3Error> {
    let (from, key) = (folder.join(path), key(prefix, path));
    let mut file = File::open(&from).map_err(io("read", &from))?;
    let bytes = file.metadata().map_err(io("read", &from))?.len();
    let changed = || S3Error::Changed { path: from.clone() };
    // Small ones are read once.
    let whole = match bytes <= PART {
        true => {
            let mut whole = Vec::with_capacity(bytes as usize);
            file.by_ref().take(PART + 1).read_to_end(&mut whole).map_err(io("read", &from))?;
            if whole.len() as u64 != bytes {
                return Err(changed());
            }
            Some(whole)
        }
        false => None,
    };
    let sha256 = match &whole {
        Some(whole) => hex(&Sha256::digest(whole)),
        None => hash(&from)?.1,
    };
    let listed = Listed { path: path.into(), bytes, sha256 };
    let there = About { bytes, sha256: Some(listed.sha256.clone()) };
    if bucket.about(&key)?.is_some_and(|about| about == there) {
        return Ok((listed, false));
    }
    match &whole {
        Some(whole) => bucket.put(&key, whole, &listed.sha256)?,
        None => {
            let mut read = |part: &mut [u8]| file.read_exact(part).map_err(io("read", &from));
            let sent = bucket.put_in_parts(&key, (bytes, &listed.sha256), &mut read)?;
            if sent != listed.sha256 {
                return Err(changed());
            }
        }
    }
    Ok((listed, true))
}

/// Fetches a file unless it is there; whether it was fetched.
fn fetch(bucket: &Bucket, prefix: &str, folder: &Path, file: &Listed) -> Result<bool, S3Error> {
    let to = folder.join(&file.path);
    if files::is_own_file(&to) && hash(&to)? == (file.bytes, file.sha256.clone()) {
        return Ok(false);
    }
    let key = key(prefix, &file.path);
    let is_it = |bytes: u64, hash: &str| bytes == file.bytes && hash == file.sha256;
    let fetched = bucket.fetch(&key, file.bytes, || Ok(Writing::begin(&to)?), is_it)?;
    let fetched = fetched.ok_or_else(|| S3Error::NotComplete { object: bucket.url(&key) })?;
    fetched.finish()?;
    Ok(true)
}

/// Size and hash of a file.
fn hash(path: &Path) -> Result<(u64, String), S3Error> {
    let mut file = File::open(path).map_err(io("read", path))?;
    let (mut hasher, mut bytes, mut buffer) = (Sha256::new(), 0, vec![0; 64 << 10]);
    loop {
        let count = file.read(&mut buffer).map_err(io("read", path))?;
        if count == 0 {
            return Ok((bytes, hex(&hasher.finalize())));
        }
        bytes += count as u64;
        hasher.update(&buffer[..count]);
    }
}

fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> S3Error {
    let path = path.to_owned();
    move |source| DataError::Io { action, path, source }.into()
}

fn key(prefix: &str, path: &str) -> String {
    if prefix.is_empty() { path.to_owned() } else { format!("{prefix}/{path}") }
}

/// The files below a folder, sorted, with slashes.
fn files_below(root: &Path) -> Result<Vec<String>, S3Error> {
    let (mut found, mut folders) = (Vec::new(), vec![PathBuf::new()]);
    while let Some(folder) = folders.pop() {
        let here = root.join(&folder);
        for entry in fs::read_dir(&here).map_err(io("read the folder", &here))? {
            let entry = entry.map_err(io("read the folder", &here))?;
            let path = folder.join(entry.file_name());
            let wrong = |expected, found| Err(S3Error::File { expected, found, path: root.join(&path) });
            let Some(name) = path.to_str() else { return wrong("a name in UTF-8", "another") };
            if files::is_unfinished(&entry.file_name().to_string_lossy()) {
                continue;
            }
            let kind = entry.file_type().map_err(io("read", &root.join(&path)))?;
            if kind.is_dir() {
                folders.push(path);
            } else if !kind.is_file() {
                return wrong("files and folders", "a link, pipe or device");
            } else if !is_inside(name) {
                return wrong("another name", "one that the list of files has");
            } else {
                found.push(name.to_owned());
            }
        }
    }
    found.sort();
    Ok(found)
}
