//! Journal of results, so that an interrupted evaluation can be continued.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use genmanip_benchmark::suite_hash;
use genmanip_core::{Document, EpisodeResult, limits};
use genmanip_data::files;
use genmanip_rollout::collect::PipelineSettings;
use serde::{Deserialize, Serialize};

use super::Suite;
use crate::policies::PolicyFactory;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::difference::first_difference;
use genmanip_workspace::documents::{self, sweep};
use genmanip_workspace::shard::Shard;

/// Identity of an evaluation; a journal is continued only if it is equal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Identity {
    suite_hash: String,
    /// Label of the policy.
    policy: String,
    /// Identities of folders among the policy's arguments that the label only names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    folders: Vec<String>,
    cameras: Option<String>,
    /// Settings of the episode loop, as JSON.
    settings: serde_json::Value,
    keep_episodes: bool,
    engine: String,
    genmanip_version: String,
}

impl Document for Identity {
    const SCHEMA: &'static str = "genmanip.evaluation_identity/1";
}

impl Identity {
    pub(super) fn of(suite: &Suite, policy: &PolicyFactory, settings: &PipelineSettings, keep_episodes: bool) -> Self {
        Self {
            suite_hash: suite_hash(&suite.scenarios),
            policy: policy.label().into(),
            folders: policy.named_folders().to_vec(),
            cameras: suite.cameras.clone(),
            settings: serde_json::to_value(settings).unwrap_or_default(),
            keep_episodes,
            engine: genmanip_sim::engine_version(),
            genmanip_version: env!("CARGO_PKG_VERSION").into(),
        }
    }
}

/// Journal of an evaluation: files of results, one per line, in its folder.
pub(super) struct Stream {
    folder: PathBuf,
    known: Vec<EpisodeResult>,
    /// File that results are appended to.
    file: Mutex<File>,
    path: PathBuf,
    /// Result files of shards, locked so that no shard continues meanwhile; empty for a shard's own journal.
    gathered: Vec<(PathBuf, File)>,
}

impl Stream {
    /// Continues or begins the journal of this identity: that of a shard, or that of the whole, which includes the
    /// results of all shards.
    ///
    /// # Errors
    /// [`WorkspaceError::AnotherEvaluation`] if the folder holds results or episodes of another identity; an error if a
    /// line of the results cannot be read, or another program is writing the same journal.
    pub(super) fn open(folder: &Path, identity: &Identity, shard: Option<Shard>) -> Result<Self, WorkspaceError> {
        sweep(folder)?;
        let own = shard.map_or_else(|| RESULTS.into(), |shard| format!("results.{}.jsonl", shard.name()));
        let (name, path) = (folder.join("identity.json"), folder.join(own));
        let is_there = |path: &Path| fs::symlink_metadata(path).is_ok();
        let fresh = || -> Result<bool, WorkspaceError> {
            let created = files::create(&name, identity.to_json().as_bytes());
            created.map_err(|error| WorkspaceError::of_file("write", &name, error))
        };
        let shards = if shard.is_none() { of_shards(folder)? } else { Vec::new() };
        if !is_there(&name) && (is_there(&path) || !shards.is_empty() || is_there(&folder.join("episodes"))) {
            let difference = "it does not say of which".into();
            return Err(WorkspaceError::AnotherEvaluation { path: folder.to_owned(), difference });
        }
        if is_there(&name) || !fresh()? {
            let known: Identity = documents::read_document_no_follow(&name, limits::IDENTITY)?;
            if known != *identity {
                let difference = first_difference("evaluation", &known.to_value(), &identity.to_value());
                let difference = difference.unwrap_or_default();
                return Err(WorkspaceError::AnotherEvaluation { path: folder.to_owned(), difference });
            }
        }
        let (file, mut known) = continued(&path)?;
        let mut gathered = Vec::new();
        for path in shards {
            let (file, more) = continued(&path)?;
            add_unknown(&mut known, more);
            gathered.push((path, file));
        }
        Ok(Self { folder: folder.to_owned(), known, file: Mutex::new(file), path, gathered })
    }

    /// Results of earlier calls.
    pub(super) fn known(&self) -> &[EpisodeResult] {
        &self.known
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Appends a result and syncs it to the disk.
    pub(super) fn add(&self, result: &EpisodeResult) -> Result<(), WorkspaceError> {
        let line = format!("{}\n", result.to_value());
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let written = file.write_all(line.as_bytes()).and_then(|()| file.sync_data());
        written.map_err(|error| WorkspaceError::file("write", &self.path, error))
    }

    /// Removes the result files, since the report contains the results; kept episodes and the identity remain.
    pub(super) fn close(self) -> Result<(), WorkspaceError> {
        drop(self.file);
        let keeps_episodes = self.folder.join("episodes").exists();
        let identity = (!keeps_episodes).then(|| self.folder.join("identity.json"));
        for path in self.gathered.into_iter().map(|(path, _)| path).chain([self.path]).chain(identity) {
            fs::remove_file(&path).map_err(|error| WorkspaceError::file("write", &path, error))?;
        }
        // Succeeds only for an empty folder.
        let _ = fs::remove_dir(&self.folder);
        Ok(())
    }
}

/// Results in the journals of an evaluation that is not finished, shards included; nothing is locked or changed.
///
/// # Errors
/// If a file cannot be read, or a line of it is no result.
pub(super) fn journalled(folder: &Path) -> Result<Vec<EpisodeResult>, WorkspaceError> {
    let mut known: Vec<EpisodeResult> = Vec::new();
    for path in [folder.join(RESULTS)].into_iter().chain(of_shards(folder)?).filter(|path| path.exists()) {
        add_unknown(&mut known, complete_lines(&path)?.1);
    }
    Ok(known)
}

/// Adds the results of episodes that are not known yet.
fn add_unknown(known: &mut Vec<EpisodeResult>, more: Vec<EpisodeResult>) {
    let ids: BTreeSet<String> = known.iter().map(|result| result.id.clone()).collect();
    known.extend(more.into_iter().filter(|result| !ids.contains(&result.id)));
}

/// File name of the journal of a whole evaluation.
const RESULTS: &str = "results.jsonl";

/// Result files of shards, sorted by name.
fn of_shards(folder: &Path) -> Result<Vec<PathBuf>, WorkspaceError> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(|error| WorkspaceError::file("list", folder, error))?,
    };
    let is_shard = |name: &str| name.starts_with("results.shard-") && name.ends_with(".jsonl");
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut paths: Vec<PathBuf> = names.filter(|name| is_shard(name)).map(|name| folder.join(name)).collect();
    paths.sort();
    Ok(paths)
}

/// Opens and locks a file of results, and reads its complete lines.
fn continued(path: &Path) -> Result<(File, Vec<EpisodeResult>), WorkspaceError> {
    let unwritable = |error: std::io::Error| WorkspaceError::file("write", path, error);
    if fs::symlink_metadata(path).is_ok() && !files::is_file_no_follow(path) {
        return Err(WorkspaceError::input(format!("{} is no file", path.display())).with_hint("move it away"));
    }
    let file = OpenOptions::new().create(true).append(true).open(path).map_err(unwritable)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            return Err(WorkspaceError::input(format!("another program is writing {}", path.display()))
                .with_hint("wait until it has ended; what it finished is kept"));
        }
        // Some file systems do not support locks; the file is then used without one.
        Err(TryLockError::Error(_)) => {}
    }
    let (length, known) = complete_lines(path)?;
    file.set_len(length as u64).map_err(unwritable)?;
    Ok((file, known))
}

/// Complete lines of a file of results: their length in bytes, and the results. An incomplete last line was being
/// written when its program was killed, or is being written.
fn complete_lines(path: &Path) -> Result<(usize, Vec<EpisodeResult>), WorkspaceError> {
    let bytes = files::read_no_follow(path, limits::RESULTS);
    let bytes = bytes.map_err(|error| WorkspaceError::of_file("read", path, error))?;
    let length = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    Ok((length, known_results(path, &bytes[..length])?))
}

/// Results in the complete lines, without repetitions of an episode.
fn known_results(path: &Path, bytes: &[u8]) -> Result<Vec<EpisodeResult>, WorkspaceError> {
    let mut known: Vec<EpisodeResult> = Vec::new();
    let mut ids = BTreeSet::new();
    for (index, line) in bytes.split(|byte| *byte == b'\n').enumerate().filter(|(_, line)| !line.is_empty()) {
        let damaged = |why: String| {
            WorkspaceError::input(format!("{}: line {} is no result: {why}", path.display(), index + 1))
                .with_hint("take the line out: that episode is then evaluated again")
        };
        if line.len() as u64 > limits::RESULT_LINE.bytes {
            return Err(damaged(format!(
                "expected at most {}, got {} bytes",
                limits::RESULT_LINE.human_readable(),
                line.len()
            )));
        }
        let result = EpisodeResult::from_bytes(line).map_err(|error| damaged(error.to_string()))?;
        if ids.insert(result.id.clone()) {
            known.push(result);
        }
    }
    Ok(known)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn identity(policy: &str) -> Identity {
        Identity {
            suite_hash: "00".into(),
            policy: policy.into(),
            folders: Vec::new(),
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
        let stream = Stream::open(&folder, &identity("expert"), None).unwrap();
        assert!(stream.known().is_empty());
        stream.add(&result).unwrap();
        drop(stream);
        // A line that was being written when its writer was killed.
        let path = folder.join("results.jsonl");
        let whole = fs::read(&path).unwrap();
        fs::write(&path, [&whole[..], &whole[..whole.len() / 2]].concat()).unwrap();
        let stream = Stream::open(&folder, &identity("expert"), None).unwrap();
        assert_eq!(stream.known(), std::slice::from_ref(&result));
        stream.add(&again).unwrap();
        drop(stream);
        assert_eq!(Stream::open(&folder, &identity("expert"), None).unwrap().known(), [result, again]);
        // Shards write files of their own, side by side; who is no shard finds what all of them left.
        let shards = [0, 1].map(|index| Some(Shard::new(index, 2).unwrap()));
        let of_shard = EpisodeResult { id: "of a shard".into(), ..EpisodeResult::from_bytes(&whole[..]).unwrap() };
        let [first, second] = shards.map(|shard| Stream::open(&folder, &identity("expert"), shard).unwrap());
        assert!(first.known().is_empty() && second.known().is_empty());
        second.add(&of_shard).unwrap();
        drop(first);
        let error = Stream::open(&folder, &identity("expert"), None).err().unwrap().to_string();
        assert!(error.contains("another program is writing") && error.contains("shard-1-of-2"), "{error}");
        drop(second);
        let known = Stream::open(&folder, &identity("expert"), None).unwrap().known().to_vec();
        assert_eq!(known.len(), 3);
        assert_eq!(known[2], of_shard);
        assert_eq!(Stream::open(&folder, &identity("expert"), shards[1]).unwrap().known(), [of_shard]);
        // Results of another evaluation are neither continued nor removed.
        let before = fs::read(&path).unwrap();
        let error = Stream::open(&folder, &identity("another"), None).err().unwrap().to_string();
        assert!(error.contains("evaluation.policy is \"expert\", not \"another\""), "{error}");
        assert_eq!(fs::read(&path).unwrap(), before);
        // Two programs do not write into one file.
        let stream = Stream::open(&folder, &identity("expert"), None).unwrap();
        let error = Stream::open(&folder, &identity("expert"), None).err().unwrap().to_string();
        assert!(error.contains("another program is writing"), "{error}");
        stream.close().unwrap();
        assert!(!folder.exists(), "nothing is left when nothing was kept");
    }

    #[test]
    fn a_line_that_cannot_be_read_is_named_and_stays() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("expert");
        let path = folder.join("results.jsonl");
        let result = EpisodeResult::from_json(include_str!("../../../core/testdata/result_1.json")).unwrap();
        let stream = Stream::open(&folder, &identity("expert"), None).unwrap();
        stream.add(&result).unwrap();
        drop(stream);
        let line = fs::read(&path).unwrap();
        let long = [&vec![b' '; limits::RESULT_LINE.bytes as usize + 1][..], b"\n"].concat();
        for (damage, expected) in [
            (&b"{\"schema\": \"gen\n"[..], "line 2 is no result: not JSON"),
            (b"\xff\xfe\n", "line 2 is no result: not JSON: not UTF-8"),
            (b"{\"schema\": \"genmanip.task/2\"}\n", "line 2 is no result: expected schema"),
            (&long, "line 2 is no result: expected at most 1 MiB"),
        ] {
            let bytes = [&line[..], damage, &line[..]].concat();
            fs::write(&path, &bytes).unwrap();
            let error = Stream::open(&folder, &identity("expert"), None).err().unwrap();
            assert!(error.to_string().contains(expected) && error.hint().is_some(), "{error}");
            assert_eq!(fs::read(&path).unwrap(), bytes, "nothing is removed");
        }
        // Twice the same result counts once.
        fs::write(&path, [&line[..], &line[..]].concat()).unwrap();
        assert_eq!(Stream::open(&folder, &identity("expert"), None).unwrap().known(), [result]);
        // Episodes of which nobody knows the evaluation.
        fs::remove_file(folder.join("identity.json")).unwrap();
        let error = Stream::open(&folder, &identity("expert"), None).err().unwrap().to_string();
        assert!(error.contains("holds another evaluation (it does not say of which)"), "{error}");
    }
}
