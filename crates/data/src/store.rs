//! The native episode store, from which every other format is derived.
//!
//! ```text
//! <root>/store.json                      marks the folder as an episode store
//! <root>/<episode id>/episode.json       result; size and SHA-256 of the episode's files
//! <root>/<episode id>/scenario.json      initial scenario (absent if none could be generated)
//! <root>/<episode id>/frames.parquet     60 Hz, columns in `frames.rs`
//! <root>/<episode id>/initial_state.f64le, final_state.f64le   physics state, little-endian doubles
//! <root>/<episode id>/<group>/…          added later, e.g. images_15hz; its files.json holds the hashes
//! ```
//!
//! Episodes and groups are published atomically: written to a temporary folder, synced, renamed. Equal episodes give
//! equal bytes: nothing in a folder depends on time, machine or path.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use genmanip_core::limits::{self, Limit};
use genmanip_core::names::is_file_name;
use genmanip_core::{Document, Episode, EpisodeResult, Scenario, Upgrade, upgrade};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::atomic_write::AtomicFolder;
use crate::files::{self, is_file_no_follow, is_folder_no_follow, read_no_follow};
use crate::inventory::{FileInventory, Inspected};
use crate::manifest::{FileHash, Manifest, check_bytes};
use crate::{DataError, frames};

mod copies;

const EPISODE: &str = "episode.json";
const SCENARIO: &str = "scenario.json";
const FRAMES: &str = "frames.parquet";
const INITIAL_STATE: &str = "initial_state.f64le";
const FINAL_STATE: &str = "final_state.f64le";
const FILES: &str = "files.json";

/// Handle of a store folder. Cheap to clone; threads may share it if each works on different episodes.
#[derive(Clone, Debug)]
pub struct EpisodeStore {
    root: PathBuf,
}

/// File to be stored in the folder or in a group of an episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// File name, e.g. `static.h264`.
    pub name: String,
    /// Contents of the file.
    pub bytes: Vec<u8>,
}

/// Contents of a store folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Listing {
    /// Ids of attempts, sorted, including damaged ones.
    pub ids: Vec<String>,
    /// Other entries, sorted; they are neither read nor changed.
    pub foreign: Vec<String>,
}

/// Contents of `episode.json`: result and files of an attempt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct EpisodeRecord {
    /// True if frames and states were stored; of failed attempts often only the result is.
    recorded: bool,
    result: EpisodeResult,
    files: Vec<FileHash>,
}

impl Document for EpisodeRecord {
    const SCHEMA: &'static str = "genmanip.episode/2";
    const PREVIOUS: Option<Upgrade> = Some(Upgrade {
        schema: "genmanip.episode/1",
        upgrade: |record| {
            record.get_mut("result").and_then(Value::as_object_mut).map_or(Ok(()), upgrade::result::from_1)
        },
    });
}

/// Contents of `store.json`, which marks a folder as an episode store.
#[derive(Serialize, Deserialize)]
struct StoreMark {
    content: String,
}

impl Document for StoreMark {
    const SCHEMA: &'static str = "genmanip.store/1";
}

impl EpisodeStore {
    /// Opens a store, or creates one in a missing or empty folder.
    ///
    /// # Errors
    /// If the folder contains anything but a store, or cannot be written.
    pub fn create(root: impl Into<PathBuf>) -> Result<Self, DataError> {
        let root = root.into();
        if root.join("store.json").exists() {
            return Self::open(root);
        }
        fs::create_dir_all(&root).map_err(DataError::io("create the folder", &root))?;
        if files::names(&root)?.iter().any(|name| !name.starts_with('.')) {
            return Err(DataError::NotAStore { path: root });
        }
        let mark = StoreMark { content: "one folder per episode".into() };
        files::create(&root.join("store.json"), mark.to_json().as_bytes())?;
        Self::open(root)
    }

    /// Opens an existing store.
    ///
    /// # Errors
    /// If the folder is not a store, or has another version.
    pub fn open(root: impl Into<PathBuf>) -> Result<Self, DataError> {
        let root = root.into();
        let path = root.join("store.json");
        let text = match read_no_follow(&path, limits::STORE_MARK) {
            Err(error) if error.is_missing() => return Err(DataError::NotAStore { path: root }),
            text => text?,
        };
        parse::<StoreMark>(&path, &text)?;
        Ok(Self { root })
    }

    /// Root folder of the store.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Ids of all attempts, with or without frames, sorted; some may be damaged.
    ///
    /// # Errors
    /// If the folder cannot be listed.
    pub fn ids(&self) -> Result<Vec<String>, DataError> {
        Ok(self.list()?.ids)
    }

    /// Attempts, and other entries of the folder.
    ///
    /// # Errors
    /// If the folder cannot be listed.
    pub fn list(&self) -> Result<Listing, DataError> {
        let mut listing = Listing::default();
        for name in files::names(&self.root)?.into_iter().filter(|name| !name.starts_with('.') && name != "store.json")
        {
            let is_attempt = self.contains(&name);
            if is_attempt { listing.ids.push(name) } else { listing.foreign.push(name) }
        }
        Ok(listing)
    }

    /// True if the store has an attempt with this id, with or without frames.
    pub fn contains(&self, id: &str) -> bool {
        let folder = self.root.join(id);
        check_name(id).is_ok() && is_folder_no_follow(&folder) && is_file_no_follow(&folder.join(EPISODE))
    }

    /// True if the folder of an attempt exists, even if damaged.
    pub fn has_folder(&self, id: &str) -> bool {
        check_name(id).is_ok() && fs::symlink_metadata(self.root.join(id)).is_ok()
    }

    /// Checks an attempt without reading its files: a valid record, and files and groups of the recorded sizes.
    ///
    /// # Errors
    /// The first damage found.
    pub fn inspect(&self, id: &str) -> Result<Inspected, DataError> {
        let folder = self.root.join(id);
        let record = match self.record(id) {
            Err(DataError::UnknownEpisode { .. }) if self.has_folder(id) => {
                return Err(DataError::NotAFile { path: folder.join(EPISODE), found: "nothing" });
            }
            record => record?,
        };
        let mut inventory = FileInventory::default();
        let own = fs::symlink_metadata(folder.join(EPISODE)).map_err(DataError::io("read", &folder))?;
        inventory.files.insert(EPISODE.into(), own.len());
        for file in &record.files {
            check_size(&folder, file)?;
            inventory.files.insert(file.name.clone(), file.bytes as u64);
        }
        let (hidden, names): (Vec<String>, Vec<String>) =
            files::names(&folder)?.into_iter().partition(|name| name.starts_with('.'));
        for name in names {
            let group = folder.join(&name);
            if !is_folder_no_follow(&group) {
                continue;
            }
            let manifest = read_manifest(&group)?;
            let own = fs::symlink_metadata(group.join(FILES)).map_err(DataError::io("read", &group))?;
            inventory.files.insert(format!("{name}/{FILES}"), own.len());
            for file in &manifest.files {
                check_size(&group, file)?;
                inventory.files.insert(format!("{name}/{}", file.name), file.bytes as u64);
            }
            inventory.groups.push(name);
        }
        Ok(Inspected {
            recorded: record.recorded,
            has_scenario: record.files.iter().any(|file| file.name == SCENARIO),
            result: record.result,
            inventory: hidden.is_empty().then_some(inventory),
        })
    }

    /// True if an attempt still has the files found by [`EpisodeStore::inspect`], and none was written at or after
    /// `since`; compares file metadata only.
    pub fn is_unchanged(&self, id: &str, inventory: &FileInventory, since: SystemTime) -> bool {
        check_name(id).is_ok() && inventory.are_unchanged(&self.root.join(id), since)
    }

    /// As [`EpisodeStore::inspect`], and also compares the hash of every file.
    ///
    /// # Errors
    /// The first damage found.
    pub fn verify(&self, id: &str) -> Result<(), DataError> {
        self.inspect(id)?;
        let (record, folder) = (self.record(id)?, self.root.join(id));
        for file in &record.files {
            read_checked(&folder, &record.files, &file.name, limits::ATTACHMENT)?;
        }
        if record.recorded {
            self.read(id)?;
        }
        for group in files::names(&folder)?.into_iter().filter(|name| self.has_group(id, name)) {
            let group = folder.join(group);
            let manifest = read_manifest(&group)?;
            for file in &manifest.files {
                read_checked(&group, &manifest.files, &file.name, limits::ATTACHMENT)?;
            }
        }
        Ok(())
    }

    /// Moves the folder of an attempt, even if damaged, out of the store; `to` must not exist.
    ///
    /// # Errors
    /// If the folder cannot be moved.
    pub fn move_out(&self, id: &str, to: &Path) -> Result<(), DataError> {
        check_name(id)?;
        if let Some(parent) = to.parent() {
            fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))?;
        }
        let from = self.root.join(id);
        fs::rename(&from, to).map_err(DataError::io("move", &from))
    }

    /// Adds a recorded episode under `episode.result.id`, with additional files.
    ///
    /// # Errors
    /// If the id exists or is invalid, the episode is inconsistent or not storable without loss, or writing fails; the
    /// store is then unchanged.
    pub fn write(&self, episode: &Episode, attachments: &[Attachment]) -> Result<(), DataError> {
        let result = &episode.result;
        if result.frames != episode.frames.len() {
            let what = format!("frames of episode {}", result.id);
            return Err(DataError::mismatch(what, result.frames, episode.frames.len()));
        }
        let file = |name: &str, bytes: Vec<u8>| Attachment { name: name.into(), bytes };
        let mut files = vec![
            file(SCENARIO, document_bytes(&episode.scenario, "scenario")?),
            file(FRAMES, frames::to_bytes(&episode.frames, episode.scenario.objects.len())?),
            file(INITIAL_STATE, frames::state_to_bytes(&episode.initial_state)),
            file(FINAL_STATE, frames::state_to_bytes(&episode.final_state)),
        ];
        files.extend_from_slice(attachments);
        self.write_record(result, true, &files)
    }

    /// Adds the result of an attempt without frames, so that it is counted and a resumed run skips it.
    ///
    /// # Errors
    /// As [`EpisodeStore::write`].
    pub fn write_result_only(&self, result: &EpisodeResult, scenario: Option<&Scenario>) -> Result<(), DataError> {
        let scenario = scenario.map(|scenario| document_bytes(scenario, "scenario")).transpose()?;
        let files: Vec<Attachment> =
            scenario.into_iter().map(|bytes| Attachment { name: SCENARIO.into(), bytes }).collect();
        self.write_record(result, false, &files)
    }

    /// Reads the result of an attempt.
    ///
    /// # Errors
    /// If the record of the attempt is missing or damaged.
    pub fn read_result(&self, id: &str) -> Result<EpisodeResult, DataError> {
        Ok(self.record(id)?.result)
    }

    /// Reads the result of an attempt, and whether its frames were stored.
    ///
    /// # Errors
    /// As [`EpisodeStore::read_result`].
    pub fn read_attempt(&self, id: &str) -> Result<(EpisodeResult, bool), DataError> {
        let record = self.record(id)?;
        Ok((record.result, record.recorded))
    }

    /// SHA-256 of an attempt's record, which includes the hashes of its files: equal attempts have equal hashes.
    ///
    /// # Errors
    /// If the record is missing or cannot be read.
    pub fn record_hash(&self, id: &str) -> Result<String, DataError> {
        check_name(id)?;
        let bytes = read_no_follow(&self.root.join(id).join(EPISODE), limits::EPISODE_RECORD)?;
        Ok(FileHash::of(EPISODE, &bytes).sha256)
    }

    /// True if the frames of an attempt were stored.
    ///
    /// # Errors
    /// As [`EpisodeStore::read_result`].
    pub fn is_recorded(&self, id: &str) -> Result<bool, DataError> {
        Ok(self.record(id)?.recorded)
    }

    /// Reads the initial scenario of an attempt; `None` if none could be generated.
    ///
    /// # Errors
    /// As [`EpisodeStore::read_result`].
    pub fn read_scenario(&self, id: &str) -> Result<Option<Scenario>, DataError> {
        let record = self.record(id)?;
        if !record.files.iter().any(|file| file.name == SCENARIO) {
            return Ok(None);
        }
        self.scenario(id, &record).map(Some)
    }

    /// Reads a recorded episode and checks its files against their hashes.
    ///
    /// # Errors
    /// If it is missing, has no frames, or a file is missing or damaged.
    pub fn read(&self, id: &str) -> Result<Episode, DataError> {
        let record = self.record(id)?;
        let folder = self.root.join(id);
        if !record.recorded {
            return Err(DataError::NotRecorded { path: folder });
        }
        let scenario = self.scenario(id, &record)?;
        let state = |name| {
            let bytes = read_checked(&folder, &record.files, name, limits::STATE)?;
            frames::state_from_bytes(&folder.join(name), &bytes)
        };
        let initial_state = state(INITIAL_STATE)?;
        let final_state = state(FINAL_STATE)?;
        let table = read_checked(&folder, &record.files, FRAMES, limits::FRAMES)?;
        let frames = frames::from_bytes(&folder.join(FRAMES), table, scenario.objects.len(), record.result.frames)?;
        Ok(Episode { scenario, result: record.result, initial_state, final_state, frames })
    }

    /// Adds a group of files to an episode, e.g. images rendered afterwards; replaces a group of that name.
    ///
    /// # Errors
    /// If the episode is missing or writing fails; the episode is then unchanged.
    pub fn attach(&self, id: &str, group: &str, attachments: &[Attachment]) -> Result<(), DataError> {
        check_name(group)?;
        self.record(id)?;
        let manifest = Manifest { files: hashes_of(attachments)? };
        let target = self.root.join(id).join(group);
        let staging = AtomicFolder::replacing(&target)?;
        for file in attachments {
            staging.write(&file.name, &file.bytes)?;
        }
        staging.write(FILES, manifest.to_json().as_bytes())?;
        // A concurrent process may have written the same group; it is kept, as others may be reading it.
        let is_sound = |file: &FileHash| read_checked(&target, &manifest.files, &file.name, limits::ATTACHMENT).is_ok();
        if read_manifest(&target).is_ok_and(|known| known == manifest) && manifest.files.iter().all(is_sound) {
            return Ok(());
        }
        staging.publish()
    }

    /// True if an episode has a group of files.
    pub fn has_group(&self, id: &str, group: &str) -> bool {
        let folder = self.root.join(id).join(group);
        self.contains(id)
            && check_name(group).is_ok()
            && is_folder_no_follow(&folder)
            && is_file_no_follow(&folder.join(FILES))
    }

    /// Reads one file of an episode and checks its hash: `notes.txt`, or `images_15hz/static.h264` in a group.
    ///
    /// # Errors
    /// If the episode or the file is missing or damaged.
    pub fn read_attachment(&self, id: &str, name: &str) -> Result<Vec<u8>, DataError> {
        let record = self.record(id)?;
        let folder = self.root.join(id);
        let missing = || DataError::NoAttachment { name: name.into(), path: folder.clone() };
        let Some((group, file)) = name.split_once('/') else {
            let known = record.files.iter().any(|file| file.name == name);
            return if known { read_checked(&folder, &record.files, name, limits::ATTACHMENT) } else { Err(missing()) };
        };
        if check_name(file).is_err() || !self.has_group(id, group) {
            return Err(missing());
        }
        let group = folder.join(group);
        let manifest = read_manifest(&group)?;
        if !manifest.files.iter().any(|known| known.name == file) {
            return Err(missing());
        }
        read_checked(&group, &manifest.files, file, limits::ATTACHMENT)
    }

    /// Removes unfinished files of dead processes of this host from the store; returns their names.
    ///
    /// # Errors
    /// If the folder cannot be listed or an entry cannot be removed.
    pub fn sweep_partial(&self) -> Result<Vec<String>, DataError> {
        files::sweep(&self.root)
    }

    /// As [`EpisodeStore::sweep_partial`], inside the folder of an attempt.
    ///
    /// # Errors
    /// As [`EpisodeStore::sweep_partial`].
    pub fn sweep_attempt(&self, id: &str) -> Result<Vec<String>, DataError> {
        check_name(id)?;
        let removed = files::sweep(&self.root.join(id))?;
        Ok(removed.into_iter().map(|name| format!("{id}/{name}")).collect())
    }

    fn write_record(&self, result: &EpisodeResult, recorded: bool, files: &[Attachment]) -> Result<(), DataError> {
        check_name(&result.id)?;
        let record = EpisodeRecord { recorded, result: result.clone(), files: hashes_of(files)? };
        let document = document_bytes(&record, "result")?;
        let staging = AtomicFolder::new(&self.root.join(&result.id))?;
        for file in files {
            staging.write(&file.name, &file.bytes)?;
        }
        staging.write(EPISODE, &document)?;
        staging.publish()
    }

    fn record(&self, id: &str) -> Result<EpisodeRecord, DataError> {
        if !self.contains(id) {
            let near = similar_ids(&self.ids()?, id);
            return Err(DataError::UnknownEpisode { id: id.into(), root: self.root.clone(), near });
        }
        let path = self.root.join(id).join(EPISODE);
        let record: EpisodeRecord = read_document(&path)?;
        if record.result.id != id {
            return Err(DataError::mismatch(format!("id in {}", path.display()), id, record.result.id));
        }
        check_listed(&path, &record.files)?;
        Ok(record)
    }

    fn scenario(&self, id: &str, record: &EpisodeRecord) -> Result<Scenario, DataError> {
        let folder = self.root.join(id);
        let bytes = read_checked(&folder, &record.files, SCENARIO, limits::SCENARIO)?;
        parse(&folder.join(SCENARIO), &bytes)
    }
}

fn check_name(name: &str) -> Result<(), DataError> {
    if is_file_name(name) { Ok(()) } else { Err(DataError::BadName { name: name.chars().take(80).collect() }) }
}

/// Hashes of files to be written; their names must be valid and distinct.
fn hashes_of(files: &[Attachment]) -> Result<Vec<FileHash>, DataError> {
    for (index, file) in files.iter().enumerate() {
        check_name(&file.name)?;
        let reserved = file.name == EPISODE || file.name == FILES;
        if reserved || files[..index].iter().any(|other| other.name == file.name) {
            return Err(DataError::Exists { path: PathBuf::from(&file.name) });
        }
    }
    Ok(files.iter().map(|file| FileHash::of(&file.name, &file.bytes)).collect())
}

/// Serialises a document; fails if it does not survive a round trip (NaN, infinity).
fn document_bytes<D: Document + PartialEq>(document: &D, what: &str) -> Result<Vec<u8>, DataError> {
    let text = document.to_json();
    let refuse = |why: String| Err(DataError::NotWritable { what: what.into(), why });
    match D::from_json(&text) {
        Ok(same) if same == *document => Ok(text.into_bytes()),
        Ok(_) => refuse("a number changes in a JSON round trip".into()),
        Err(error) => refuse(error.to_string()),
    }
}

/// Checks that the listed names are valid and distinct.
fn check_listed(path: &Path, files: &[FileHash]) -> Result<(), DataError> {
    for (index, file) in files.iter().enumerate() {
        let twin = files[..index].iter().any(|other| other.name == file.name);
        if check_name(&file.name).is_err() || twin || file.name == EPISODE || file.name == FILES {
            let name: String = file.name.chars().take(80).collect();
            let what = format!("files[{index}].name in {}", path.display());
            return Err(DataError::mismatch(what, "valid and distinct file names", format!("{name:?}")));
        }
    }
    Ok(())
}

/// Checks the size of a file against its record, without reading it.
fn check_size(folder: &Path, file: &FileHash) -> Result<(), DataError> {
    let path = folder.join(&file.name);
    let about = fs::symlink_metadata(&path).map_err(DataError::io("read", &path))?;
    if about.is_file() && about.len() == file.bytes as u64 {
        return Ok(());
    }
    let got = if about.is_file() { format!("{} bytes", about.len()) } else { "not a regular file".into() };
    Err(DataError::Damaged { path, expected: format!("{} bytes", file.bytes), got })
}

/// Reads a file of the record; checks its size first, then its hash.
fn read_checked(folder: &Path, files: &[FileHash], name: &str, limit: Limit) -> Result<Vec<u8>, DataError> {
    let path = folder.join(name);
    let Some(expected) = files.iter().find(|file| file.name == name) else {
        return Err(DataError::NoAttachment { name: name.into(), path: folder.to_owned() });
    };
    check_size(folder, expected)?;
    check_bytes(&path, expected, read_no_follow(&path, limit)?)
}

fn read_manifest(group: &Path) -> Result<Manifest, DataError> {
    let path = group.join(FILES);
    let manifest: Manifest = read_document(&path)?;
    check_listed(&path, &manifest.files)?;
    Ok(manifest)
}

fn read_document<D: Document>(path: &Path) -> Result<D, DataError> {
    parse(path, &read_no_follow(path, limits::EPISODE_RECORD)?)
}

fn parse<D: Document>(path: &Path, bytes: &[u8]) -> Result<D, DataError> {
    D::from_bytes(bytes).map_err(|source| DataError::Document { path: path.into(), source })
}

/// Up to three ids with the longest prefix in common with the requested one.
fn similar_ids(ids: &[String], asked: &str) -> Vec<String> {
    let shared = |id: &str| id.bytes().zip(asked.bytes()).take_while(|(a, b)| a == b).count();
    let mut near: Vec<&String> = ids.iter().filter(|id| shared(id) >= 3).collect();
    near.sort_by_key(|id| std::cmp::Reverse(shared(id)));
    near.into_iter().take(3).cloned().collect()
}
