//! Results as they come, so that an evaluation can be continued.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use genmanip_bench::suite_hash;
use genmanip_core::{Document, EpisodeResult};
use serde::{Deserialize, Serialize};

use super::Suite;
use crate::error::RunError;
use crate::inputs;
use crate::policies::PolicyFactory;

/// What results belong to; others are not continued.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Identity {
    suite_hash: String,
    /// The policy with its arguments.
    policy: String,
    cameras: Option<String>,
    /// Settings of the loop, as JSON.
    settings: serde_json::Value,
    keep_episodes: bool,
    engine: String,
    genmanip_version: String,
}

impl Document for Identity {
    const SCHEMA: &'static str = "genmanip.evaluation_identity/1";
}

impl Identity {
    pub(super) fn of(suite: &Suite, policy: &PolicyFactory, keep_episodes: bool) -> Self {
        Self {
            suite_hash: suite_hash(&suite.scenarios),
            policy: policy.label().into(),
            cameras: suite.cameras.clone(),
            settings: serde_json::to_value(&suite.settings).unwrap_or_default(),
            keep_episodes,
            engine: genmanip_sim::engine_version(),
            genmanip_version: env!("CARGO_PKG_VERSION").into(),
        }
    }
}

/// A file of results, one per line, and the folder it lies in.
pub(super) struct Stream {
    folder: PathBuf,
    known: Vec<EpisodeResult>,
    file: Mutex<File>,
}

impl Stream {
    /// Continues the results of this identity, or begins: those of another evaluation are removed with its episodes.
    pub(super) fn open(folder: &Path, identity: &Identity) -> Result<Self, RunError> {
        let (name, path) = (folder.join("identity.json"), folder.join("results.jsonl"));
        let is_same = inputs::read_document::<Identity>(&name).is_ok_and(|known| known == *identity);
        if !is_same {
            for old in [&name, &path] {
                if old.exists() {
                    fs::remove_file(old).map_err(|error| RunError::file("write", old, error))?;
                }
            }
            let episodes = folder.join("episodes");
            if episodes.join("store.json").is_file() {
                fs::remove_dir_all(&episodes).map_err(|error| RunError::file("write", &episodes, error))?;
            }
            inputs::write_file(&name, identity.to_json().as_bytes())?;
        }
        let text = if path.exists() { inputs::read_text(&path, u64::MAX)? } else { String::new() };
        // A last line without an end was cut off when its writer was killed.
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        let known = text[..whole].lines().filter_map(|line| EpisodeResult::from_json(line).ok()).collect();
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let file = file.and_then(|file| file.set_len(whole as u64).map(|()| file));
        let file = file.map_err(|error| RunError::file("write", &path, error))?;
        Ok(Self { folder: folder.to_owned(), known, file: Mutex::new(file) })
    }

    /// Results of the part before.
    pub(super) fn known(&self) -> &[EpisodeResult] {
        &self.known
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Keeps a result.
    pub(super) fn add(&self, result: &EpisodeResult) -> Result<(), RunError> {
        let line = format!("{}\n", result.to_value());
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let written = file.write_all(line.as_bytes()).and_then(|()| file.sync_data());
        written.map_err(|error| RunError::file("write", &self.folder.join("results.jsonl"), error))
    }

    /// Forgets the results, which stand in the report now; episodes stay.
    pub(super) fn close(self) -> Result<(), RunError> {
        drop(self.file);
        for name in ["results.jsonl", "identity.json"] {
            let path = self.folder.join(name);
            fs::remove_file(&path).map_err(|error| RunError::file("write", &path, error))?;
        }
        // Only an empty folder goes.
        let _ = fs::remove_dir(&self.folder);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn identity(policy: &str) -> Identity {
        Identity {
            suite_hash: "00".into(),
            policy: policy.into(),
            cameras: None,
            settings: serde_json::Value::Null,
            keep_episodes: false,
            engine: "mujoco".into(),
            genmanip_version: "0".into(),
        }
    }

    #[test]
    fn results_are_continued_and_never_mixed() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("expert");
        let result = EpisodeResult::from_json(include_str!("../../../core/testdata/result_1.json")).unwrap();
        let again = EpisodeResult { id: "again".into(), ..result.clone() };
        let stream = Stream::open(&folder, &identity("expert")).unwrap();
        assert!(stream.known().is_empty());
        stream.add(&result).unwrap();
        drop(stream);
        // A line that was being written when its writer was killed.
        let path = folder.join("results.jsonl");
        let whole = fs::read(&path).unwrap();
        fs::write(&path, [&whole[..], &whole[..whole.len() / 2]].concat()).unwrap();
        let stream = Stream::open(&folder, &identity("expert")).unwrap();
        assert_eq!(stream.known(), std::slice::from_ref(&result));
        stream.add(&again).unwrap();
        drop(stream);
        assert_eq!(Stream::open(&folder, &identity("expert")).unwrap().known(), [result, again]);
        let other = Stream::open(&folder, &identity("another")).unwrap();
        assert!(other.known().is_empty(), "results of another evaluation are not continued");
        other.close().unwrap();
        assert!(!folder.exists(), "nothing is left when nothing was kept");
    }
}
