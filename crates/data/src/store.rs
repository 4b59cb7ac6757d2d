//! The native episode store: the truth that every other format is derived from.
//!
//! ```text
//! <root>/store.json                      what this folder is
//! <root>/<episode id>/episode.json       result, and size and sha256 of the files beside it
//! <root>/<episode id>/scenario.json      what it started from (absent when no scenario could be made)
//! <root>/<episode id>/frames.parquet     60 Hz, columns in `frames.rs`
//! <root>/<episode id>/initial_state.f64le, final_state.f64le   physics state, little-endian doubles
//! <root>/<episode id>/<group>/…          made later, e.g. images_15hz; files.json in it holds the hashes
//! ```
//!
//! An episode or a group is written aside, synced and renamed, so it is there whole or not at all.
//! Equal episodes give equal bytes: nothing in a folder depends on time, machine or path.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use genmanip_core::limits::{self, Limit};
use genmanip_core::names::is_file_name;
use genmanip_core::{Document, Episode, EpisodeResult, Scenario, Upgrade, upgrade};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::aside::Aside;
use crate::files::{self, is_own_file, is_own_folder, read_own};
use crate::manifest::{FileHash, Manifest, check_bytes};
use crate::parts::{Inspected, Parts};
use crate::{DataError, frames};

mod copies;

const EPISODE: &str = "episode.json";
const SCENARIO: &str = "scenario.json";
const FRAMES: &str = "frames.parquet";
const INITIAL_STATE: &str = "initial_state.f64le";
const FINAL_STATE: &str = "final_state.f64le";
const FILES: &str = "files.json";

/// A folder of episodes. Cheap to clone; several threads may use one, each for episodes of its own.
#[derive(Clone, Debug)]
pub struct EpisodeStore {
    root: PathBuf,
}

/// Bytes kept beside an episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// File name, e.g. `static.h264`.
    pub name: String,
    /// Contents.
    pub bytes: Vec<u8>,
}

/// What lies in the folder of a store.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Listing {
    /// Ids of attempts, sorted, whole or damaged.
    pub ids: Vec<String>,
    /// Names of what is no attempt, sorted: nothing of it is read or changed.
    pub strangers: Vec<String>,
}

/// `episode.json`: how an attempt went, and which files belong to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct EpisodeRecord {
    /// Whether the frames and states were kept; of a failed attempt often only the result is.
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

/// `store.json`.
#[derive(Serialize, Deserialize)]
struct StoreMark {
    content: String,
}

impl Document for StoreMark {
    const SCHEMA: &'static str = "genmanip.store/1";
}

impl EpisodeStore {
    /// Opens a store, or makes an empty one in a folder that does not exist or is empty.
    ///
    /// # Errors
    /// When the folder holds something else or cannot be written.
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
    /// When there is none, or it has another version.
    pub fn open(root: impl Into<PathBuf>) -> Result<Self, DataError> {
        let root = root.into();
        let path = root.join("store.json");
        let text = match read_own(&path, limits::STORE_MARK) {
            Err(error) if error.is_missing() => return Err(DataError::NotAStore { path: root }),
            text => text?,
        };
        parse::<StoreMark>(&path, &text)?;
        Ok(Self { root })
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Ids of all attempts, recorded or not, sorted; some may be damaged.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub fn ids(&self) -> Result<Vec<String>, DataError> {
        Ok(self.list()?.ids)
    }

    /// Attempts, and what else lies in the folder.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub fn list(&self) -> Result<Listing, DataError> {
        let mut listing = Listing::default();
        for name in files::names(&self.root)?.into_iter().filter(|name| !name.starts_with('.') && name != "store.json")
        {
            let is_attempt = self.contains(&name);
            if is_attempt { listing.ids.push(name) } else { listing.strangers.push(name) }
        }
        Ok(listing)
    }

    /// Whether an attempt with this id is there, recorded or not.
    pub fn contains(&self, id: &str) -> bool {
        let folder = self.root.join(id);
        check_name(id).is_ok() && is_own_folder(&folder) && is_own_file(&folder.join(EPISODE))
    }

    /// Whether the place of an attempt is taken, by the attempt itself or by what is left of it.
    pub fn is_taken(&self, id: &str) -> bool {
        check_name(id).is_ok() && fs::symlink_metadata(self.root.join(id)).is_ok()
    }

    /// Looks at an attempt without reading its files: a sound record, and files and groups that have the sizes recorded.
    ///
    /// # Errors
    /// What is damaged.
    pub fn look_at(&self, id: &str) -> Result<Inspected, DataError> {
        let folder = self.root.join(id);
        let record = match self.record(id) {
            Err(DataError::UnknownEpisode { .. }) if self.is_taken(id) => {
                return Err(DataError::NotAFile { path: folder.join(EPISODE), found: "no such file" });
            }
            record => record?,
        };
        let mut parts = Parts::default();
        let own = fs::symlink_metadata(folder.join(EPISODE)).map_err(DataError::io("read", &folder))?;
        parts.files.insert(EPISODE.into(), own.len());
        for file in &record.files {
            check_size(&folder, file)?;
            parts.files.insert(file.name.clone(), file.bytes as u64);
        }
        let (hidden, names): (Vec<String>, Vec<String>) =
            files::names(&folder)?.into_iter().partition(|name| name.starts_with('.'));
        for name in names {
            let group = folder.join(&name);
            if !is_own_folder(&group) {
                continue;
            }
            let manifest = read_manifest(&group)?;
            let own = fs::symlink_metadata(group.join(FILES)).map_err(DataError::io("read", &group))?;
            parts.files.insert(format!("{name}/{FILES}"), own.len());
            for file in &manifest.files {
                check_size(&group, file)?;
                parts.files.insert(format!("{name}/{}", file.name), file.bytes as u64);
            }
            parts.groups.push(name);
        }
        Ok(Inspected {
            recorded: record.recorded,
            has_scenario: record.files.iter().any(|file| file.name == SCENARIO),
            result: record.result,
            parts: hidden.is_empty().then_some(parts),
        })
    }

    /// Whether an attempt is still what [`EpisodeStore::look_at`] found, and nothing of it was written at or after
    /// `since`; none of its files is read.
    pub fn is_unchanged(&self, id: &str, parts: &Parts, since: SystemTime) -> bool {
        check_name(id).is_ok() && parts.are_unchanged(&self.root.join(id), since)
    }

    /// As [`EpisodeStore::look_at`], with every file read and compared with its hash.
    ///
    /// # Errors
    /// What is damaged.
    pub fn verify(&self, id: &str) -> Result<(), DataError> {
        self.look_at(id)?;
        let (record, folder) = (self.record(id)?, self.root.join(id));
        for file in &record.files {
            checked(&folder, &record.files, &file.name, limits::ATTACHMENT)?;
        }
        if record.recorded {
            self.read(id)?;
        }
        for group in files::names(&folder)?.into_iter().filter(|name| self.has_group(id, name)) {
            let group = folder.join(group);
            let manifest = read_manifest(&group)?;
            for file in &manifest.files {
                checked(&group, &manifest.files, &file.name, limits::ATTACHMENT)?;
            }
        }
        Ok(())
    }

    /// Moves an attempt out of the store, whatever is left of it; `to` must not exist.
    ///
    /// # Errors
    /// When it cannot be moved.
    pub fn move_out(&self, id: &str, to: &Path) -> Result<(), DataError> {
        check_name(id)?;
        if let Some(parent) = to.parent() {
            fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))?;
        }
        let from = self.root.join(id);
        fs::rename(&from, to).map_err(DataError::io("move", &from))
    }

    /// Adds a recorded episode under `episode.result.id`, with files of the caller's beside it.
    ///
    /// # Errors
    /// When the id is taken or unfit, when something in the episode is inconsistent or could not be read back,
    /// or when the disk refuses; the store is then unchanged.
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

    /// Adds an attempt of which only the result is kept, so that it is counted and a resumed run skips it.
    ///
    /// # Errors
    /// As [`EpisodeStore::write`].
    pub fn write_result_only(&self, result: &EpisodeResult, scenario: Option<&Scenario>) -> Result<(), DataError> {
        let scenario = scenario.map(|scenario| document_bytes(scenario, "scenario")).transpose()?;
        let files: Vec<Attachment> =
            scenario.into_iter().map(|bytes| Attachment { name: SCENARIO.into(), bytes }).collect();
        self.write_record(result, false, &files)
    }

    /// How an attempt went.
    ///
    /// # Errors
    /// When it is not there, damaged or unreadable.
    pub fn read_result(&self, id: &str) -> Result<EpisodeResult, DataError> {
        Ok(self.record(id)?.result)
    }

    /// How an attempt went, and whether its frames were kept, from one reading of its record.
    ///
    /// # Errors
    /// As [`EpisodeStore::read_result`].
    pub fn read_attempt(&self, id: &str) -> Result<(EpisodeResult, bool), DataError> {
        let record = self.record(id)?;
        Ok((record.result, record.recorded))
    }

    /// Hash of the record of an attempt, which holds the hashes of its files: equal attempts have equal ones.
    ///
    /// # Errors
    /// When it is not there or cannot be read.
    pub fn record_hash(&self, id: &str) -> Result<String, DataError> {
        check_name(id)?;
        let bytes = read_own(&self.root.join(id).join(EPISODE), limits::EPISODE_RECORD)?;
        Ok(FileHash::of(EPISODE, &bytes).sha256)
    }

    /// Whether the frames of an attempt were kept.
    ///
    /// # Errors
    /// As [`EpisodeStore::read_result`].
    pub fn is_recorded(&self, id: &str) -> Result<bool, DataError> {
        Ok(self.record(id)?.recorded)
    }

    /// What an attempt started from; `None` when no scenario could be made.
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

    /// A recorded episode, its files checked against their hashes.
    ///
    /// # Errors
    /// When it is not there, was not recorded, or a file is missing or damaged.
    pub fn read(&self, id: &str) -> Result<Episode, DataError> {
        let record = self.record(id)?;
        let folder = self.root.join(id);
        if !record.recorded {
            return Err(DataError::NotRecorded { path: folder });
        }
        let scenario = self.scenario(id, &record)?;
        let state = |name| {
            let bytes = checked(&folder, &record.files, name, limits::STATE)?;
            frames::state_from_bytes(&folder.join(name), &bytes)
        };
        let initial_state = state(INITIAL_STATE)?;
        let final_state = state(FINAL_STATE)?;
        let table = checked(&folder, &record.files, FRAMES, limits::FRAMES)?;
        let frames = frames::from_bytes(&folder.join(FRAMES), table, scenario.objects.len(), record.result.frames)?;
        Ok(Episode { scenario, result: record.result, initial_state, final_state, frames })
    }

    /// Adds a group of files to an episode, e.g. the images drawn afterwards. A group of that name is replaced.
    ///
    /// # Errors
    /// When the episode is not there or the disk refuses; the episode is then unchanged.
    pub fn attach(&self, id: &str, group: &str, attachments: &[Attachment]) -> Result<(), DataError> {
        check_name(group)?;
        self.record(id)?;
        let manifest = Manifest { files: write_order(attachments)? };
        let target = self.root.join(id).join(group);
        let aside = Aside::replacing(&target)?;
        for file in attachments {
            aside.write(&file.name, &file.bytes)?;
        }
        aside.write(FILES, manifest.to_json().as_bytes())?;
        // Another program that shares the work may have been quicker; what somebody may be reading stays.
        let is_sound = |file: &FileHash| checked(&target, &manifest.files, &file.name, limits::ATTACHMENT).is_ok();
        if read_manifest(&target).is_ok_and(|known| known == manifest) && manifest.files.iter().all(is_sound) {
            return Ok(());
        }
        aside.publish()
    }

    /// Whether an episode has a group of files.
    pub fn has_group(&self, id: &str, group: &str) -> bool {
        let folder = self.root.join(id).join(group);
        self.contains(id) && check_name(group).is_ok() && is_own_folder(&folder) && is_own_file(&folder.join(FILES))
    }

    /// One file beside an episode, checked against its hash: `notes.txt`, or `images_15hz/static.h264` in a group.
    ///
    /// # Errors
    /// When the episode or the file is not there or is damaged.
    pub fn read_attachment(&self, id: &str, name: &str) -> Result<Vec<u8>, DataError> {
        let record = self.record(id)?;
        let folder = self.root.join(id);
        let missing = || DataError::NoAttachment { name: name.into(), path: folder.clone() };
        let Some((group, file)) = name.split_once('/') else {
            let known = record.files.iter().any(|file| file.name == name);
            return if known { checked(&folder, &record.files, name, limits::ATTACHMENT) } else { Err(missing()) };
        };
        if check_name(file).is_err() || !self.has_group(id, group) {
            return Err(missing());
        }
        let group = folder.join(group);
        let manifest = read_manifest(&group)?;
        if !manifest.files.iter().any(|known| known.name == file) {
            return Err(missing());
        }
        checked(&group, &manifest.files, file, limits::ATTACHMENT)
    }

    /// Removes what killed runs of this host left behind in the store, so far as they certainly ended. Returns what was
    /// removed.
    ///
    /// # Errors
    /// When the folder cannot be listed or a leftover cannot be removed.
    pub fn sweep_partial(&self) -> Result<Vec<String>, DataError> {
        files::sweep(&self.root)
    }

    /// The same inside the folder of an attempt.
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
        let record = EpisodeRecord { recorded, result: result.clone(), files: write_order(files)? };
        let document = document_bytes(&record, "result")?;
        let aside = Aside::new(&self.root.join(&result.id))?;
        for file in files {
            aside.write(&file.name, &file.bytes)?;
        }
        aside.write(EPISODE, &document)?;
        aside.publish()
    }

    fn record(&self, id: &str) -> Result<EpisodeRecord, DataError> {
        if !self.contains(id) {
            let near = near(&self.ids()?, id);
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
        let bytes = checked(&folder, &record.files, SCENARIO, limits::SCENARIO)?;
        parse(&folder.join(SCENARIO), &bytes)
    }
}

fn check_name(name: &str) -> Result<(), DataError> {
    if is_file_name(name) { Ok(()) } else { Err(DataError::BadName { name: name.chars().take(80).collect() }) }
}

/// Hashes of files that are about to be written; names must be fit and different.
fn write_order(files: &[Attachment]) -> Result<Vec<FileHash>, DataError> {
    for (index, file) in files.iter().enumerate() {
        check_name(&file.name)?;
        let reserved = file.name == EPISODE || file.name == FILES;
        if reserved || files[..index].iter().any(|other| other.name == file.name) {
            return Err(DataError::Exists { path: PathBuf::from(&file.name) });
        }
    }
    Ok(files.iter().map(|file| FileHash::of(&file.name, &file.bytes)).collect())
}

/// The text of a document, refused when it would be read back as something else (NaN, infinity).
fn document_bytes<D: Document + PartialEq>(document: &D, what: &str) -> Result<Vec<u8>, DataError> {
    let text = document.to_json();
    let refuse = |why: String| Err(DataError::NotWritable { what: what.into(), why });
    match D::from_json(&text) {
        Ok(same) if same == *document => Ok(text.into_bytes()),
        Ok(_) => refuse("a number changes when it is written and read".into()),
        Err(error) => refuse(error.to_string()),
    }
}

/// What a record says about the files beside it must be names of files there, each once.
fn check_listed(path: &Path, files: &[FileHash]) -> Result<(), DataError> {
    for (index, file) in files.iter().enumerate() {
        let twin = files[..index].iter().any(|other| other.name == file.name);
        if check_name(&file.name).is_err() || twin || file.name == EPISODE || file.name == FILES {
            let name: String = file.name.chars().take(80).collect();
            let what = format!("files[{index}].name in {}", path.display());
            return Err(DataError::mismatch(what, "the name of a file beside it, each once", format!("{name:?}")));
        }
    }
    Ok(())
}

/// A file with the size that was recorded; nothing of it is read.
fn check_size(folder: &Path, file: &FileHash) -> Result<(), DataError> {
    let path = folder.join(&file.name);
    let about = fs::symlink_metadata(&path).map_err(DataError::io("read", &path))?;
    if about.is_file() && about.len() == file.bytes as u64 {
        return Ok(());
    }
    let got = if about.is_file() { format!("{} bytes", about.len()) } else { "something that is no file".into() };
    Err(DataError::Damaged { path, expected: format!("{} bytes", file.bytes), got })
}

/// A file beside a record, read only when it has the size recorded, and checked against its hash.
fn checked(folder: &Path, files: &[FileHash], name: &str, limit: Limit) -> Result<Vec<u8>, DataError> {
    let path = folder.join(name);
    let Some(expected) = files.iter().find(|file| file.name == name) else {
        return Err(DataError::NoAttachment { name: name.into(), path: folder.to_owned() });
    };
    check_size(folder, expected)?;
    check_bytes(&path, expected, read_own(&path, limit)?)
}

fn read_manifest(group: &Path) -> Result<Manifest, DataError> {
    let path = group.join(FILES);
    let manifest: Manifest = read_document(&path)?;
    check_listed(&path, &manifest.files)?;
    Ok(manifest)
}

fn read_document<D: Document>(path: &Path) -> Result<D, DataError> {
    parse(path, &read_own(path, limits::EPISODE_RECORD)?)
}

fn parse<D: Document>(path: &Path, bytes: &[u8]) -> Result<D, DataError> {
    D::from_bytes(bytes).map_err(|source| DataError::Document { path: path.into(), source })
}

/// Up to three ids that share the longest beginning with the one asked for.
fn near(ids: &[String], asked: &str) -> Vec<String> {
    let shared = |id: &str| id.bytes().zip(asked.bytes()).take_while(|(a, b)| a == b).count();
    let mut near: Vec<&String> = ids.iter().filter(|id| shared(id) >= 3).collect();
    near.sort_by_key(|id| std::cmp::Reverse(shared(id)));
    near.into_iter().take(3).cloned().collect()
}
