//! Upload and download of folders.
//!
//! The object `PREFIX/PATH` holds the file PATH, with its SHA-256 as metadata, so that a repeated push uploads only
//! missing or changed files. [`LIST`] is written last: if it exists, so do all objects it lists.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use genmanip_core::{Document, DocumentError};
use genmanip_data::DataError;
use genmanip_data::files::{self, Writing};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::bucket::{ObjectInfo, PART};
use crate::parallel::each;
use crate::{Bucket, S3Error};
use genmanip_core::hexadecimal;

/// Name of the object that lists the files of a folder.
pub const LIST: &str = "genmanip-objects.json";
/// Maximum size of the list, bytes: about 500,000 files.
const MAX_LIST_BYTES: u64 = 64 << 20;

/// File list of a pushed folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileList {
    /// Files, sorted by path.
    pub files: Vec<FileEntry>,
}

/// An entry of the file list.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileEntry {
    /// Path relative to the folder, separated by slashes.
    pub path: String,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
}

/// Summary of a push or pull.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TransferSummary {
    /// Number of files in the folder.
    pub files: usize,
    /// Total size of the files in the folder, bytes.
    pub bytes: u64,
    /// Number of transferred files; the others were already up to date.
    pub moved: usize,
}

impl Document for FileList {
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

/// True if a listed path is valid: within the folder, without empty parts, backslash or NUL, and not the reserved name
/// [`LIST`].
fn is_inside(path: &str) -> bool {
    let is_name = |part: &str| !matches!(part, "" | "." | "..") && !part.contains(['\\', '\0']);
    path.split('/').all(is_name) && path != LIST
}

/// Uploads a folder, `jobs` files at a time. Files that already exist with the same size and hash are skipped, and
/// unfinished files (`.NAME.partial-…`) are ignored. `on_file` is called once per file, with the number of all files.
///
/// # Errors
/// [`S3Error::Stopped`] with the progress: uploaded files are kept, and another call resumes.
pub fn push(
    bucket: &Bucket,
    folder: &Path,
    prefix: &str,
    jobs: usize,
    on_file: &(dyn Fn(usize) + Sync),
) -> Result<TransferSummary, S3Error> {
    let paths = files_below(folder)?;
    let listed = std::sync::Mutex::new(Vec::new());
    let sent = std::sync::atomic::AtomicUsize::new(0);
    let (done, failed) = each(&paths, jobs, &|path: &String| {
        let (file, is_sent) = send(bucket, folder, prefix, path)?;
        listed.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).push(file);
        sent.fetch_add(usize::from(is_sent), std::sync::atomic::Ordering::Relaxed);
        on_file(paths.len());
        Ok(())
    });
    if let Some(source) = failed {
        return Err(S3Error::Stopped { done, all: paths.len(), moved: "uploaded", source: Box::new(source) });
    }
    let mut files = listed.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    files.sort_by(|a, b| a.path.cmp(&b.path));
    let moved = TransferSummary {
        files: files.len(),
        bytes: files.iter().map(|file| file.bytes).sum(),
        moved: sent.into_inner(),
    };
    let list = FileList { files }.to_json().into_bytes();
    bucket.put(&key(prefix, LIST), &list, &hexadecimal(&Sha256::digest(&list)))?;
    Ok(moved)
}

/// Downloads a pushed folder, `jobs` files at a time. Files that already exist with the same size and hash are skipped,
/// others are replaced. Files that are not listed are kept, except unfinished files of an earlier pull that was killed
/// on this machine. `on_file` is called once per file, with the number of all files.
///
/// # Errors
/// [`S3Error::NotComplete`] if there is no file list; [`S3Error::Stopped`] with the progress.
pub fn pull(
    bucket: &Bucket,
    prefix: &str,
    folder: &Path,
    jobs: usize,
    on_file: &(dyn Fn(usize) + Sync),
) -> Result<TransferSummary, S3Error> {
    let name = key(prefix, LIST);
    let object = bucket.url(&name);
    let list = bucket.fetch(&name, MAX_LIST_BYTES, || Ok(Vec::new()), |_, _| true)?;
    let list = list.ok_or_else(|| S3Error::NotComplete { object: object.clone() })?;
    let FileList { files } = FileList::from_bytes(&list).map_err(|source| S3Error::List { object, source })?;
    fs::create_dir_all(folder).map_err(io("create the folder", folder))?;
    sweep(folder, &files)?;
    let fetched = std::sync::atomic::AtomicUsize::new(0);
    let (done, failed) = each(&files, jobs, &|file: &FileEntry| {
        let is_fetched = fetch(bucket, prefix, folder, file)?;
        fetched.fetch_add(usize::from(is_fetched), std::sync::atomic::Ordering::Relaxed);
        on_file(files.len());
        Ok(())
    });
    match failed {
        Some(source) => Err(S3Error::Stopped { done, all: files.len(), moved: "downloaded", source: Box::new(source) }),
        None => Ok(TransferSummary {
            files: files.len(),
            bytes: files.iter().map(|file| file.bytes).sum(),
            moved: fetched.into_inner(),
        }),
    }
}

/// Removes unfinished files of killed pulls from all listed folders.
fn sweep(folder: &Path, listed: &[FileEntry]) -> Result<(), S3Error> {
    let parents: BTreeSet<&str> =
        listed.iter().map(|file| file.path.rsplit_once('/').map_or("", |(parent, _)| parent)).collect();
    for parent in parents.into_iter().map(|parent| folder.join(parent)).filter(|parent| parent.is_dir()) {
        files::sweep(&parent)?;
    }
    Ok(())
}

/// Uploads a file unless it is up to date; returns true if it was uploaded.
fn send(bucket: &Bucket, folder: &Path, prefix: &str, path: &str) -> Result<(FileEntry, bool), S3Error> {
    let (from, key) = (folder.join(path), key(prefix, path));
    let mut file = File::open(&from).map_err(io("read", &from))?;
    let bytes = file.metadata().map_err(io("read", &from))?.len();
    let changed = || S3Error::Changed { path: from.clone() };
    // A small file is read into memory once, for both hash and upload.
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
        Some(whole) => hexadecimal(&Sha256::digest(whole)),
        None => hash(&from)?.1,
    };
    let listed = FileEntry { path: path.into(), bytes, sha256 };
    let there = ObjectInfo { bytes, sha256: Some(listed.sha256.clone()) };
    if bucket.head(&key)?.is_some_and(|about| about == there) {
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

/// Downloads a file unless it is up to date; returns true if it was downloaded.
fn fetch(bucket: &Bucket, prefix: &str, folder: &Path, file: &FileEntry) -> Result<bool, S3Error> {
    let to = folder.join(&file.path);
    if files::is_file_no_follow(&to) && hash(&to)? == (file.bytes, file.sha256.clone()) {
        return Ok(false);
    }
    let key = key(prefix, &file.path);
    let is_it = |bytes: u64, hash: &str| bytes == file.bytes && hash == file.sha256;
    let fetched = bucket.fetch(&key, file.bytes, || Ok(Writing::begin(&to)?), is_it)?;
    let fetched = fetched.ok_or_else(|| S3Error::NotComplete { object: bucket.url(&key) })?;
    fetched.finish()?;
    Ok(true)
}

/// Size and SHA-256 of a file.
fn hash(path: &Path) -> Result<(u64, String), S3Error> {
    let mut file = File::open(path).map_err(io("read", path))?;
    let (mut hasher, mut bytes, mut buffer) = (Sha256::new(), 0, vec![0; 64 << 10]);
    loop {
        let count = file.read(&mut buffer).map_err(io("read", path))?;
        if count == 0 {
            return Ok((bytes, hexadecimal(&hasher.finalize())));
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

/// Relative paths of the files below a folder, sorted, separated by slashes.
fn files_below(root: &Path) -> Result<Vec<String>, S3Error> {
    let (mut found, mut folders) = (Vec::new(), vec![PathBuf::new()]);
    while let Some(folder) = folders.pop() {
        let here = root.join(&folder);
        for entry in fs::read_dir(&here).map_err(io("read the folder", &here))? {
            let entry = entry.map_err(io("read the folder", &here))?;
            let path = folder.join(entry.file_name());
            let wrong = |expected, found| Err(S3Error::File { expected, found, path: root.join(&path) });
            let Some(name) = path.to_str() else { return wrong("a UTF-8 file name", "another encoding") };
            if files::is_unfinished(&entry.file_name().to_string_lossy()) {
                continue;
            }
            let kind = entry.file_type().map_err(io("read", &root.join(&path)))?;
            if kind.is_dir() {
                folders.push(path);
            } else if !kind.is_file() {
                return wrong("files and folders", "a link, pipe or device");
            } else if !is_inside(name) {
                return wrong("another file name", "the reserved name of the file list");
            } else {
                found.push(name.to_owned());
            }
        }
    }
    found.sort();
    Ok(found)
}
