//! Folder of a run: its files, their owners, and access to them.
//!
//! ```text
//! run.json          record of everything that the run depends on; a folder never mixes two runs
//! shard.json        the part of the run in this folder; absent for a whole run
//! scenarios/        one file per laid-out attempt
//! episodes/         the episode store
//! dataset/          LeRobotDataset v3.0, with the depth images in dataset-depth/
//! exports/          further datasets, written by `export`
//! evaluation/       one file per policy
//! timings.json      wall-clock figures, separate from all reproducible files
//! index.jsonl       summary of each episode, so that its files need not be read; updated when stale
//! report.html, report/   pages of `report` and `report --full`
//! damaged/          episodes that `collect --repair` set aside
//! ```

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use genmanip_core::{
    Document, DocumentError, LongDocument, Seed, Task, Upgrade, hexadecimal, limits, long_from_json, long_from_reader,
    long_to_json, upgrade, write_tagged,
};
use genmanip_data::{EpisodeStore, files};
use genmanip_rollout::collect::PipelineSettings;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::index::{INDEX, Survey};
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::difference::{first_difference, listed};
use genmanip_workspace::documents::{self, sweep, unwritable};
use genmanip_workspace::shard::{Manifest, Shard};
use genmanip_workspace::task_spool::{Spool, Tasks};

/// Everything a run depends on: its input, settings and seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run<L = Tasks> {
    /// Seed of all attempts.
    pub seed: Seed,
    /// Attempts per task; 0 if the run continues until a number of demonstrations are verified.
    pub episodes_per_task: usize,
    /// Tasks of the run, in order.
    pub tasks: L,
    /// Settings of all stages of the pipeline.
    pub settings: PipelineSettings,
    /// Name and version of the physics engine.
    pub engine: String,
    /// Version of this program.
    pub genmanip_version: String,
}

/// A run with all its tasks in memory.
pub type RunRecord = Run<Vec<Task>>;

impl Document for RunRecord {
    const SCHEMA: &'static str = "genmanip.run/2";
    const PREVIOUS: Option<Upgrade> = Some(upgrade::run::FROM_1);

    fn from_json(text: &str) -> Result<Self, DocumentError> {
        long_from_json(text, |_| {})
    }

    fn to_json(&self) -> String {
        long_to_json(self)
    }
}

impl LongDocument for RunRecord {
    const LIST: &'static str = "tasks";
    const MAX_ENTRIES: usize = limits::TASKS;
    type Entry = Task;

    fn entries(&mut self) -> &mut Vec<Task> {
        &mut self.tasks
    }
}

impl Run {
    /// A run by this program, with its version and that of the physics engine.
    pub fn new(tasks: Tasks, episodes_per_task: usize, settings: PipelineSettings, seed: Seed) -> Self {
        let (engine, genmanip_version) = Self::versions();
        Self { seed, episodes_per_task, tasks, settings, engine, genmanip_version }
    }

    /// Versions of the physics engine and of this program.
    pub(crate) fn versions() -> (String, String) {
        (genmanip_sim::engine_version(), env!("CARGO_PKG_VERSION").into())
    }

    /// Writes the record of the run (`run.json`), task by task.
    ///
    /// # Errors
    /// Errors of `out`, and when a spooled task cannot be read again.
    pub fn write(&self, out: impl Write) -> io::Result<()> {
        write_tagged(out, RunRecord::SCHEMA, self)
    }

    /// Reads the record that a run has written, task by task.
    fn read(path: &Path) -> Result<Self, WorkspaceError> {
        let file = files::open_no_follow(path, limits::RUN).map_err(|error| documents::unreadable(path, error))?;
        let (mut spool, mut refused) = (Spool::in_folder(&std::env::temp_dir()), None);
        let record = long_from_reader::<RunRecord>(file, |task| {
            spool.add(task).map_err(|error| {
                let message = error.to_string();
                refused = Some(error);
                DocumentError::Invalid { path: "$.tasks".into(), message }
            })
        });
        if let Some(error) = refused {
            return Err(error);
        }
        let record = record.map_err(|source| WorkspaceError::Document {
            path: path.to_owned(),
            schema: RunRecord::SCHEMA,
            source,
        })?;
        let Run { seed, episodes_per_task, settings, engine, genmanip_version, .. } = record;
        Ok(Self { seed, episodes_per_task, tasks: spool.finish(), settings, engine, genmanip_version })
    }

    /// Hash of the record, 32 hexadecimal digits. Shards and datasets store it, so that they are not mistaken for those
    /// of
    /// another run.
    ///
    /// # Errors
    /// When a spooled task cannot be read again.
    pub fn hash(&self) -> Result<String, WorkspaceError> {
        let mut hasher = Hashing(Sha256::new());
        self.write(&mut hasher).map_err(|error| WorkspaceError::broken("cannot read the tasks again", error))?;
        Ok(hasher.in_hex())
    }

    /// Hash of a record on disk, see [`Run::hash`].
    ///
    /// # Errors
    /// When the file cannot be read.
    pub(crate) fn hash_of(record: &Path) -> Result<String, WorkspaceError> {
        let unreadable = |error| WorkspaceError::of_file("read", record, error);
        let mut hasher = Hashing(Sha256::new());
        let mut file = files::open_no_follow(record, limits::RUN).map_err(unreadable)?;
        io::copy(&mut file, &mut hasher).map_err(|error| WorkspaceError::file("read", record, error))?;
        Ok(hasher.in_hex())
    }
}

/// Writer that hashes its input with SHA-256.
struct Hashing(Sha256);

impl Hashing {
    /// The first 16 bytes of the hash, hexadecimal.
    fn in_hex(self) -> String {
        hexadecimal(&self.0.finalize()[..16])
    }
}

impl Write for Hashing {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Wall-clock figures, which are never part of a comparison.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Timings {
    /// Wall-clock time by phase, s.
    pub phases: BTreeMap<String, f64>,
    /// Wall-clock time by id of the attempt, s.
    pub attempts: BTreeMap<String, f64>,
}

impl Document for Timings {
    const SCHEMA: &'static str = "genmanip.timings/1";
}

/// Folder of a run on disk.
pub struct RunFolder {
    path: PathBuf,
    timings: Mutex<Timings>,
}

impl RunFolder {
    /// Begins a run, or continues one with an equal record.
    ///
    /// If several programs begin a run in the same folder at the same time, exactly one creates the record. The others
    /// continue that run if theirs is equal, or fail with the first difference.
    ///
    /// # Errors
    /// [`WorkspaceError::AnotherRun`] for a different run; also when the folder holds files of a run without its
    /// record,
    /// contains symbolic links, or cannot be written to.
    pub fn begin(path: &Path, run: &Run) -> Result<Self, WorkspaceError> {
        let file = path.join(RECORD);
        if !is_there(&file) {
            check_unowned(path)?;
            let created = files::create_with(&file, &mut |out| run.write(out));
            if created.map_err(|error| unwritable(&file, error))? {
                return Ok(Self::at(path));
            }
        }
        check_links(path)?;
        if Run::hash_of(&file)? != run.hash()? {
            let known = Run::read(&file)?;
            if known != *run {
                return Err(WorkspaceError::AnotherRun { path: path.to_owned(), difference: difference(&known, run)? });
            }
        }
        let folder = Self::at(path);
        folder.sweep()?;
        Ok(folder)
    }

    /// Begins or continues a shard. Shards in one parent folder share one record through hard links, where the file
    /// system supports them, since the record holds all tasks of the run.
    ///
    /// # Errors
    /// As [`RunFolder::begin`].
    pub(crate) fn begin_shard(path: &Path, run: &Run) -> Result<Self, WorkspaceError> {
        let file = path.join(RECORD);
        if !is_there(&file) {
            check_unowned(path)?;
            let hash = run.hash()?;
            let shared = path.with_file_name(format!(".{hash}.run.json"));
            if !is_there(&shared) {
                shared.parent().map_or(Ok(()), sweep)?;
                files::create_with(&shared, &mut |out| run.write(out)).map_err(|error| unwritable(&shared, error))?;
            }
            if Run::hash_of(&shared)? == hash {
                std::fs::create_dir_all(path).map_err(|error| WorkspaceError::file("create", path, error))?;
                if std::fs::hard_link(&shared, &file).is_ok() {
                    return Ok(Self::at(path));
                }
                // Without hard links, the record is written below; if another program has written it meanwhile, it is
                // used.
            }
        }
        Self::begin(path, run)
    }

    /// Records in `shard.json` which part of the run is in this folder, or checks that it is this part. Nothing is
    /// written for `None`, the whole run.
    ///
    /// # Errors
    /// [`WorkspaceError::AnotherRun`] if the folder holds another part; an error if `shard.json` cannot be read or
    /// written.
    pub(crate) fn claim(&self, shard: Option<Shard>) -> Result<(), WorkspaceError> {
        let describe = |shard: Option<Shard>| shard.map_or("the whole run".to_owned(), |shard| shard.to_string());
        let other = |found: Option<Shard>| {
            let difference = format!("it is {}, not {}", describe(found), describe(shard));
            Err(WorkspaceError::AnotherRun { path: self.path.clone(), difference })
        };
        let path = self.join(SHARD);
        match (Self::manifest(&self.path)?.map(|manifest| manifest.shard), shard) {
            (found, shard) if found.is_some() && found != shard => other(found),
            (None, Some(_)) if is_there(&self.join("episodes")) => other(None),
            (None, Some(shard)) => {
                let manifest = Manifest { shard, run: Run::hash_of(&self.join(RECORD))? };
                let created = files::create(&path, manifest.to_json().as_bytes());
                // If another program has created the file meanwhile, its content is checked.
                if created.map_err(|error| unwritable(&path, error))? { Ok(()) } else { self.claim(Some(shard)) }
            }
            _ => Ok(()),
        }
    }

    /// Shard in a folder; `None` for a whole run.
    ///
    /// # Errors
    /// When `shard.json` exists and is no such document.
    pub(crate) fn manifest(path: &Path) -> Result<Option<Manifest>, WorkspaceError> {
        let file = path.join(SHARD);
        is_there(&file).then(|| documents::read_document_no_follow(&file, limits::IDENTITY)).transpose()
    }

    /// Opens a part of a run whose record is known.
    ///
    /// # Errors
    /// When the folder contains symbolic links.
    pub(crate) fn open_part(path: &Path) -> Result<Self, WorkspaceError> {
        check_links(path)?;
        Ok(Self::at(path))
    }

    /// Removes unfinished files of killed programs from all folders of the run except the episode store.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub(crate) fn sweep(&self) -> Result<(), WorkspaceError> {
        ["", "scenarios", "evaluation"].iter().try_for_each(|name| sweep(&self.path.join(name)))
    }

    /// Opens an existing run.
    ///
    /// # Errors
    /// [`WorkspaceError::NoRun`] without `run.json`; also when it is no such document, or the folder contains symbolic
    /// links.
    pub fn open(path: &Path) -> Result<(Self, Run), WorkspaceError> {
        let file = path.join(RECORD);
        if !is_there(&file) {
            return Err(WorkspaceError::NoRun { path: path.to_owned() });
        }
        check_links(path)?;
        Ok((Self::at(path), Run::read(&file)?))
    }

    fn at(path: &Path) -> Self {
        // Unreadable timings are ignored, since nothing depends on them.
        let timings =
            documents::read_document_no_follow(&path.join("timings.json"), limits::TIMINGS).unwrap_or_default();
        Self { path: path.to_owned(), timings: Mutex::new(timings) }
    }

    /// Path of the run's folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of a file or folder in the run's folder.
    pub fn join(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Episode store of the run, created if necessary.
    ///
    /// # Errors
    /// When the folder `episodes` holds something else, or cannot be written to.
    pub fn store(&self) -> Result<EpisodeStore, WorkspaceError> {
        let root = self.join("episodes");
        EpisodeStore::create(&root).map_err(|error| {
            WorkspaceError::input(format!("cannot use {}", root.display()))
                .because(error)
                .with_hint("check that the folder is writable and belongs to this run")
        })
    }

    /// Survey of all attempts in the store; files of attempts that the index covers are not read.
    ///
    /// # Errors
    /// When the store cannot be listed.
    pub fn survey(&self, store: &EpisodeStore) -> Result<Survey, WorkspaceError> {
        Survey::of(&self.path, store)
    }

    /// Records the wall-clock time of an attempt, s.
    pub fn set_attempt_time(&self, id: &str, seconds: f64) {
        self.timings.lock().unwrap_or_else(PoisonError::into_inner).attempts.insert(id.to_owned(), seconds);
    }

    /// Records the wall-clock time of a phase, s.
    pub fn set_phase_time(&self, phase: &str, seconds: f64) {
        self.timings.lock().unwrap_or_else(PoisonError::into_inner).phases.insert(phase.to_owned(), seconds);
    }

    /// Adds to the wall-clock time of a phase, s, so that an interrupted run sums the times of its calls.
    pub fn add_phase_time(&self, phase: &str, seconds: f64) {
        let mut timings = self.timings.lock().unwrap_or_else(PoisonError::into_inner);
        *timings.phases.entry(phase.to_owned()).or_default() += seconds;
    }

    /// Wall-clock figures so far.
    pub fn timings(&self) -> Timings {
        self.timings.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Writes the wall-clock figures to `timings.json`.
    ///
    /// # Errors
    /// [`WorkspaceError::File`] if the file cannot be written.
    pub fn save_timings(&self) -> Result<(), WorkspaceError> {
        documents::write_file(&self.join("timings.json"), self.timings().to_json().as_bytes())
    }
}

/// File with the record of the run.
const RECORD: &str = "run.json";

/// File with the shard that the folder holds.
const SHARD: &str = "shard.json";

/// Files and folders that a run writes, besides its record.
const OWN: [&str; 12] = [
    SHARD,
    "episodes",
    "scenarios",
    "dataset",
    "dataset-depth",
    "exports",
    "evaluation",
    "damaged",
    "timings.json",
    INDEX,
    "report.html",
    "report",
];

/// Fails for a folder that holds files of a run, but no record.
fn check_unowned(path: &Path) -> Result<(), WorkspaceError> {
    match OWN.iter().find(|name| is_there(&path.join(name))) {
        // Another program may have created the record meanwhile; the files are then those of its run.
        Some(name) if !is_there(&path.join(RECORD)) => {
            let what = format!("{} holds `{name}`, but no {RECORD} of a run that made it", path.display());
            Err(WorkspaceError::input(what).with_hint("choose an empty --out folder, or move what is there away"))
        }
        _ => Ok(()),
    }
}

fn is_there(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok()
}

/// Fails if the folder contains symbolic links: writing through one would change files outside of the run's folder.
fn check_links(path: &Path) -> Result<(), WorkspaceError> {
    let inside = OWN.iter().chain([&RECORD]).map(|name| path.join(name));
    let kept = list_folders(&path.join("evaluation")).into_iter().flat_map(|label| [label.join("episodes"), label]);
    match inside.chain(kept).find(|path| path.is_symlink()) {
        Some(link) => Err(WorkspaceError::input(format!("{} is a symbolic link", link.display()))
            .with_hint("a run keeps everything in its own folder; link to the whole run instead")),
        None => Ok(()),
    }
}

/// Paths of the entries of a folder; empty if it does not exist.
fn list_folders(path: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(path)
        .map(|entries| entries.filter_map(|entry| Some(entry.ok()?.path())).collect())
        .unwrap_or_default()
}

/// Description of the first difference between two runs.
///
/// # Errors
/// When a spooled task cannot be read again.
pub(crate) fn difference(known: &Run, asked: &Run) -> Result<String, WorkspaceError> {
    if known.seed != asked.seed {
        return Ok(format!("its seed is {}, not {}", known.seed, asked.seed));
    }
    if known.episodes_per_task != asked.episodes_per_task {
        let length = |run: &Run| match run.episodes_per_task {
            0 => "a number of verified demonstrations".to_owned(),
            attempts => format!("{attempts} attempts per task"),
        };
        return Ok(format!("it has {}, not {}", length(known), length(asked)));
    }
    if known.genmanip_version != asked.genmanip_version || known.engine != asked.engine {
        return Ok(format!("made by version {} with {}", known.genmanip_version, known.engine));
    }
    let ids = |run: &Run| run.tasks.entries().iter().map(|task| task.id.clone()).collect::<Vec<_>>();
    if ids(known) != ids(asked) {
        return Ok(format!("its tasks are {}, not {}", listed(&ids(known)), listed(&ids(asked))));
    }
    for (index, (known, asked)) in known.tasks.iter().zip(asked.tasks.iter()).enumerate() {
        if let Some(difference) = differs(&format!("tasks[{index}]"), &known?, &asked?) {
            return Ok(difference);
        }
    }
    let settings = differs("settings", &known.settings, &asked.settings);
    Ok(settings.unwrap_or_else(|| "with other settings".into()))
}

/// Description of the first difference between two values, see [`first_difference`]; `None` if they are equal.
fn differs<T: PartialEq + Serialize>(place: &str, known: &T, asked: &T) -> Option<String> {
    if known == asked {
        return None;
    }
    let [known, asked] = [known, asked].map(|value| serde_json::to_value(value).unwrap_or_default());
    first_difference(place, &known, &asked)
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_workspace::task_files;

    /// Runs of thousands of tasks open: their record is read task by task.
    #[test]
    fn a_long_record_is_the_same_document() {
        let tasks = task_files::designed_tasks(2, 1, genmanip_assets::Catalogue::builtin()).unwrap();
        let many = tasks.iter().cycle().take(1000).enumerate();
        let tasks = many.map(|(index, task)| Task { id: format!("{}-{index}", task.id), ..task.clone() });
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run");
        let settings = PipelineSettings::in_world((*genmanip_assets::worlds::default_world()).clone());
        let run = Run::new(Tasks::spool(tasks, folder.path()).unwrap(), 1, settings, Seed::new(7));
        RunFolder::begin(&path, &run).unwrap();
        let text = std::fs::read_to_string(path.join(RECORD)).unwrap();
        let whole = RunRecord::from_json(&text).unwrap();
        assert_eq!(text, serde_json::to_string_pretty(&whole.to_value()).unwrap() + "\n", "streamed or not");
        assert_eq!(Run::hash_of(&path.join(RECORD)).unwrap(), run.hash().unwrap());
        assert_eq!(RunFolder::open(&path).unwrap().1, run);
        std::fs::write(path.join(RECORD), text.replacen("\"subject\"", "\"subjects\"", 1)).unwrap();
        let error = RunFolder::open(&path).err().unwrap();
        let source = std::error::Error::source(&error).unwrap().to_string();
        assert!(source.starts_with("at $.tasks[0].goal"), "{source}");
    }

    #[test]
    fn shards_beside_each_other_share_one_record() {
        use std::os::unix::fs::MetadataExt;
        let folder = tempfile::tempdir().unwrap();
        let tasks = task_files::designed_tasks(2, 1, genmanip_assets::Catalogue::builtin()).unwrap();
        let settings = PipelineSettings::in_world((*genmanip_assets::worlds::default_world()).clone());
        let run = Run::new(Tasks::spool(tasks, folder.path()).unwrap(), 1, settings, Seed::new(7));
        let paths = ["a", "b", "a"].map(|name| folder.path().join(name));
        for path in &paths {
            RunFolder::begin_shard(path, &run).unwrap();
            assert_eq!(RunFolder::open(path).unwrap().1, run);
        }
        let files = paths.map(|path| std::fs::metadata(path.join(RECORD)).unwrap().ino());
        assert!(files.iter().all(|file| *file == files[0]), "{files:?}");
        std::fs::create_dir_all(folder.path().join("c/episodes")).unwrap();
        let error = RunFolder::begin_shard(&folder.path().join("c"), &run).err().unwrap().to_string();
        assert!(error.contains("holds `episodes`"), "{error}");
    }
}
