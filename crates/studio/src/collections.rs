//! Collection of the scenarios that the studio shows: from files, folders, runs and suites, and from tasks that it lays
//! out first.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use genmanip_assets::Catalogue;
use genmanip_assets::worlds::default_world;
use genmanip_benchmark::suites;
use genmanip_core::{Scenario, Seed, Task, limits};
use genmanip_layout::LayoutSettings;
use genmanip_pipeline::folder::RunFolder;
use genmanip_pipeline::layouts::{LayoutOutput, lay_out};
use genmanip_workspace::scenarios::{parse_scenario, read_scenario};
use genmanip_workspace::{Progress, WorkspaceError, documents, task_files, workers};
use serde::Deserialize;

use crate::edit::{EditLog, EditedScenario};

/// Number of tasks designed when no path is given and the studio's folder is empty: one of each kind.
const DESIGNED: usize = 6;
/// Depth at which copies lie below the studio's folder: RUN/EPISODE.
const COPY_DEPTH: usize = 2;
/// File name of the scenario in the folder of a recorded episode.
const RECORDED: &str = "scenario.json";
/// Maximum number of scenarios that one call of the studio may show.
const MAX_SCENARIOS: usize = 20_000;

/// A scenario that the studio shows.
#[derive(Clone, Debug)]
pub struct Listed {
    /// Key of the scenario in URLs.
    pub key: String,
    /// File of the scenario.
    pub path: PathBuf,
    /// Collection that it belongs to, e.g. `suite genmanip-200-rc`.
    pub source: String,
    /// Folder for the copy if the scenario is read-only, relative to the studio's folder, e.g. the name of its suite;
    /// `None`
    /// if it is edited in place.
    pub copies: Option<PathBuf>,
    /// The scenario as it was when the studio started.
    pub summary: Summary,
}

/// Row of a scenario in a list.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Id of the scenario.
    pub id: String,
    /// Kind of the scenario's task.
    pub kind: genmanip_core::TaskKind,
    /// Instruction of the scenario's task.
    pub instruction: String,
    /// Number of objects, distractors included.
    pub objects: usize,
}

/// Scenarios by key.
#[derive(Debug, Default)]
pub struct Collection {
    listed: BTreeMap<String, Listed>,
    paths: BTreeSet<PathBuf>,
    /// Messages about files that could not be read, one per file.
    pub left_out: Vec<String>,
}

impl Collection {
    /// Collects the scenarios of the given paths: files, folders of files, runs, and suites by name or folder. Tasks
    /// are
    /// laid out into `out`; scenarios that are already in `out` are listed too.
    ///
    /// # Errors
    /// When a path is none of these, or a task cannot be laid out.
    pub fn open(paths: &[PathBuf], out: &Path, progress: &dyn Progress) -> Result<Self, WorkspaceError> {
        let mut own = Self::default();
        let mut tasks = Vec::new();
        for path in paths {
            own.add_path(&suites::folder_of(path), &mut tasks)?;
        }
        own.add_edited(out, COPY_DEPTH);
        if paths.is_empty() && own.listed.is_empty() {
            let designed = task_files::designed_tasks(DESIGNED, 0, Catalogue::builtin())?;
            progress.note(&format!("nothing is named: {} tasks are designed into {}", designed.len(), out.display()));
            tasks = designed;
        }
        if !tasks.is_empty() {
            own.add_tasks(&tasks, out, progress)?;
        }
        Ok(own)
    }

    /// Scenario with a key; `None` if there is none.
    pub fn get(&self, key: &str) -> Option<&Listed> {
        self.listed.get(key)
    }

    /// Key of the scenario in a file; `None` if the file is not listed.
    pub fn key_of(&self, path: &Path) -> Option<String> {
        self.listed.values().find(|listed| listed.path == path).map(|listed| listed.key.clone())
    }

    /// All scenarios, sorted by key.
    pub fn iter(&self) -> impl Iterator<Item = &Listed> {
        self.listed.values()
    }

    /// Adds a scenario and returns its key; a file that is already listed keeps its key.
    pub fn add(&mut self, path: &Path, source: &str, copies: Option<&Path>, scenario: &Scenario) -> String {
        if let Some(known) = self.key_of(path) {
            return known;
        }
        let key = self.free_key(&scenario.id);
        self.paths.insert(path.to_owned());
        let listed = Listed {
            key: key.clone(),
            path: path.to_owned(),
            source: source.to_owned(),
            copies: copies.map(Path::to_owned),
            summary: Summary::of(scenario),
        };
        self.listed.insert(key.clone(), listed);
        key
    }

    fn free_key(&self, id: &str) -> String {
        let others = (2..).map(|number| format!("{id}~{number}"));
        let mut keys = std::iter::once(id.to_owned()).chain(others);
        keys.find(|key| !self.listed.contains_key(key)).unwrap_or_else(|| id.to_owned())
    }

    fn add_path(&mut self, path: &Path, tasks: &mut Vec<Task>) -> Result<(), WorkspaceError> {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        if path.join("suite.json").is_file() {
            let file = suites::open(path)?;
            for entry in &file.scenarios {
                self.add_file(
                    &suites::scenario_file(path, &entry.id),
                    &format!("suite {}", file.name),
                    Some(file.name.as_ref()),
                )?;
            }
            return Ok(());
        }
        if path.join("run.json").is_file() {
            return self.add_run(path, &name);
        }
        for file in task_files::expand(&[path.to_owned()])? {
            let source = if path.is_dir() { name.clone() } else { "files".to_owned() };
            if task_files::is_list(&file) {
                tasks.extend(task_files::read_tasks(&[file])?);
            } else if self.paths.contains(&file) {
                continue;
            } else if let Some(scenario) = scenario_in(&file)? {
                self.add_within_limit(&file, &source, copies_of(&file).as_deref(), &scenario)?;
            } else {
                tasks.push(task_files::read_task(&file)?);
            }
        }
        Ok(())
    }

    /// Adds the scenarios of a run's episodes, or those that the run was started with if it has none.
    fn add_run(&mut self, path: &Path, name: &str) -> Result<(), WorkspaceError> {
        let (folder, _) = RunFolder::open(path)?;
        let before = self.listed.len();
        let episodes = folder.join("episodes");
        for id in sorted_names(&episodes) {
            let file = episodes.join(id).join(RECORDED);
            if file.is_file() {
                self.add_or_leave_out(&file, &format!("run {name}"), copies_of(&file).as_deref());
            }
        }
        let given = folder.join("scenarios");
        if self.listed.len() == before && given.is_dir() {
            for file in task_files::expand(&[given])? {
                self.add_or_leave_out(&file, &format!("run {name}"), Some(name.as_ref()));
            }
        }
        if self.listed.len() == before {
            return Err(WorkspaceError::input(format!("the run at {} has no scenario", path.display()))
                .with_hint("collect episodes first"));
        }
        Ok(())
    }

    /// Scenarios in the studio's folder and in the folders of copies inside it.
    fn add_edited(&mut self, folder: &Path, depth: usize) {
        for file in sorted_names(folder).into_iter().map(|name| folder.join(name)) {
            // A suite built from reviewed scenarios holds further copies of them, so it is skipped.
            if file.is_dir() && depth > 0 && !file.join("suite.json").is_file() {
                self.add_edited(&file, depth - 1);
            } else if file.extension().is_some_and(|ending| ending == "json") && !self.paths.contains(&file) {
                let added = scenario_in(&file).and_then(|scenario| match scenario {
                    Some(scenario) => self.add_within_limit(&file, "studio", None, &scenario),
                    None => Ok(()),
                });
                self.note_left_out(&file, added);
            }
        }
    }

    fn add_tasks(&mut self, tasks: &[Task], out: &Path, progress: &dyn Progress) -> Result<(), WorkspaceError> {
        // A task whose scenario file exists is not laid out again: it may have been edited.
        let file = |task: &Task| out.join(format!("{}-000.json", task.id));
        let is_edited = |task: &Task| EditLog::path_of(&file(task)).is_file();
        let (edited, others): (Vec<Task>, Vec<Task>) = tasks.iter().cloned().partition(is_edited);
        for task in &edited {
            self.add_or_leave_out(&file(task), "studio", None);
        }
        let output = LayoutOutput { folder: out.to_owned(), explain: false };
        let (settings, seed, never) = (LayoutSettings::default(), Seed::new(0), AtomicBool::new(false));
        let world = default_world();
        let mut made = Vec::new();
        let workers = workers::workers(None);
        let mut each = |row: &genmanip_pipeline::layouts::LaidOut| made.push(row.clone());
        lay_out(&others, 1, &world, &settings, seed, &output, workers, progress, &never, &mut each)?;
        for row in made {
            match (row.scenario, row.refused) {
                (Some(file), _) => self.add_file(Path::new(&file), "studio", None)?,
                (None, refused) => {
                    self.left_out.push(format!("task {} has no layout: {}", row.task, refused.unwrap_or_default()));
                }
            }
        }
        Ok(())
    }

    fn add_file(&mut self, path: &Path, source: &str, copies: Option<&Path>) -> Result<(), WorkspaceError> {
        if self.paths.contains(path) {
            return Ok(());
        }
        self.add_within_limit(path, source, copies, &read_scenario(path)?)
    }

    fn add_within_limit(
        &mut self,
        path: &Path,
        source: &str,
        copies: Option<&Path>,
        scenario: &Scenario,
    ) -> Result<(), WorkspaceError> {
        if self.listed.len() >= MAX_SCENARIOS {
            return Err(WorkspaceError::input(format!("more than {MAX_SCENARIOS} scenarios"))
                .with_hint("name fewer of them, such as some files of the folder"));
        }
        self.add(path, source, copies, scenario);
        Ok(())
    }

    fn add_or_leave_out(&mut self, path: &Path, source: &str, copies: Option<&Path>) {
        let added = self.add_file(path, source, copies);
        self.note_left_out(path, added);
    }

    fn note_left_out(&mut self, path: &Path, added: Result<(), WorkspaceError>) {
        if let Err(error) = added {
            self.left_out.push(format!("{} is left out: {error}", path.display()));
        }
    }
}

impl Summary {
    /// Summary of a scenario.
    pub fn of(scenario: &Scenario) -> Self {
        Self {
            id: scenario.id.clone(),
            kind: scenario.task.kind,
            instruction: scenario.task.instruction.clone(),
            objects: scenario.objects.len(),
        }
    }
}

/// Folder for the copy of a file that is never edited in place (one of a suite, a run or a recorded episode), relative
/// to
/// the studio's folder; `None` for other files.
fn copies_of(file: &Path) -> Option<PathBuf> {
    let names: Vec<_> = std::path::absolute(file).ok()?.iter().map(|name| name.to_owned()).collect();
    let name = |from_end: usize| names.get(names.len().checked_sub(from_end)?);
    if name(1)? == RECORDED {
        // The path is RUN/episodes/ID/scenario.json; the copy's folder is RUN/ID.
        return Some(Path::new(name(4)?).join(name(2)?)).filter(|folder| folder.is_relative());
    }
    EditedScenario::read_only_reason(file).and_then(|_| Some(PathBuf::from(name(3)?)))
}

/// Scenario in a file; `None` if the file holds another type of document.
fn scenario_in(path: &Path) -> Result<Option<Scenario>, WorkspaceError> {
    /// Key that names the type of a document; all other keys are skipped.
    #[derive(Deserialize)]
    struct Head {
        schema: String,
    }
    let bytes = documents::read_bytes(path, limits::SCENARIO)?;
    let head = serde_json::from_slice::<Head>(&bytes).ok();
    let is_scenario = head.is_some_and(|head| head.schema.starts_with("genmanip.scenario/"));
    is_scenario.then(|| parse_scenario(path, &bytes)).transpose()
}

/// Names of a folder's entries; none if it cannot be listed.
pub(crate) fn sorted_names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut names: Vec<String> =
        entries.filter_map(|entry| Some(entry.ok()?.file_name().to_string_lossy().into_owned())).collect();
    names.sort();
    names
}
