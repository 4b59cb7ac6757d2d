//! Scenarios to evaluate on: those of a run, a frozen suite, or scenario files.

use genmanip_workspace::documents;
use genmanip_workspace::scenarios;
use genmanip_workspace::task_files;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_assets::worlds::default_world;
use genmanip_assets::{AssetSource, Catalogue};
use genmanip_benchmark::distributions::{Distributions, DrawnTask, SplitChoice, layout_hash};
use genmanip_benchmark::statistics::Traits;
use genmanip_benchmark::suite_format::{Perturbation, SuiteEntry};
use genmanip_benchmark::{reference_paths_m, suite_hash};
use genmanip_core::world::camera_faults;
use genmanip_core::{Atom, Camera, Document, DocumentError, Episode, Scenario, Seed, Task, json, limits};
use genmanip_data::{DataError, EpisodeStore};
use genmanip_rollout::collect::{PipelineSettings, Resources, in_parallel};
use genmanip_rollout::evaluate::Case;

use crate::folder::{Run, RunFolder};
use crate::policies::label;
use genmanip_benchmark::suites;
use genmanip_benchmark::suites::SuiteAssets;
use genmanip_workspace::task_spool::Tasks;
use genmanip_workspace::worlds;
use genmanip_workspace::{Cause, Progress, WorkspaceError};

/// Separator between the id of a scenario's first episode and the number of a further episode.
const AGAIN: char = '+';

/// Scenarios with the random streams of their episodes.
pub struct Suite {
    /// Name of the suite or run.
    pub name: String,
    /// Scenarios with unchanged cameras and world, ordered by id.
    pub scenarios: Vec<Arc<Scenario>>,
    /// Episodes to run, one per scenario unless more are requested.
    pub cases: Vec<Case>,
    /// Reference path length of the tool by scenario id, m.
    pub reference_paths_m: BTreeMap<String, f64>,
    /// Traits of the scenarios of a frozen suite; empty for others.
    pub traits: Traits,
    /// Settings of the episode loop.
    pub settings: PipelineSettings,
    /// Change of the original suite; `None` if it is not a perturbed suite.
    pub perturbation: Option<Perturbation>,
    /// Name of the file whose cameras replace those of the scenarios; `None` for the scenarios' own.
    pub cameras: Option<String>,
    /// Messages about episodes of a run that are omitted since they are damaged or foreign.
    pub left_out: Vec<String>,
    /// Objects of a frozen suite with stored objects; `None` for those of the catalogue.
    pub assets: Option<Arc<SuiteAssets>>,
    /// Store with recorded episodes on the same scenarios; `None` if there are none.
    store: Option<EpisodeStore>,
    /// True if the scenarios are those of a run, in whose folder evaluations are then written.
    is_of_run: bool,
}

impl Suite {
    /// Suite of cases and their scenarios, without reference paths, traits and recordings.
    fn of_cases(name: String, cases: Vec<Case>, settings: PipelineSettings) -> Self {
        let mut scenarios: Vec<Arc<Scenario>> = cases.iter().map(|case| Arc::clone(&case.scenario)).collect();
        scenarios.sort_by(|a, b| a.id.cmp(&b.id));
        Self {
            name,
            scenarios,
            cases,
            reference_paths_m: BTreeMap::new(),
            traits: Traits::new(),
            settings,
            perturbation: None,
            cameras: None,
            left_out: Vec::new(),
            assets: None,
            store: None,
            is_of_run: false,
        }
    }

    /// Opens a frozen suite, a run, or scenario files, whatever the path is.
    ///
    /// # Errors
    /// As [`Suite::frozen`], [`Suite::of_run`] and [`Suite::of_scenarios`].
    pub fn at(path: &Path) -> Result<Self, WorkspaceError> {
        match &*suites::folder_of(path) {
            path if path.join("suite.json").is_file() => Self::frozen(path),
            path if path.join("run.json").is_file() || !path.exists() => Self::of_run(path),
            path => Self::of_scenarios(&[path.to_owned()]),
        }
    }

    /// Scenarios of a run: those of all its recorded attempts, or, without any, those in `scenarios/`.
    ///
    /// # Errors
    /// When there is no run, or it has no scenario.
    pub fn of_run(path: &Path) -> Result<Self, WorkspaceError> {
        let (folder, run) = RunFolder::open(path)?;
        let store = folder.store()?;
        let help = "collect again with --repair: what is damaged is set aside and made anew";
        let unreadable = |error: DataError| WorkspaceError::broken("cannot read the episodes", error).with_hint(help);
        let name = name_of_folder(path);
        let survey = folder.survey(&store)?;
        let mut left_out = survey.notes();
        let (mut cases, mut results) = (Vec::new(), Vec::new());
        for id in survey.sound.into_iter().map(|known| known.id) {
            // The index may list an attempt as intact that was damaged later without a change of its size.
            let read = store.read_attempt(&id).and_then(|attempt| Ok((attempt, store.read_scenario(&id)?)));
            let ((result, is_recorded), scenario) = match read {
                Err(error) if error.is_damage() => {
                    left_out.push(format!("episode {id} is damaged and left out: {error}"));
                    continue;
                }
                read => read.map_err(unreadable)?,
            };
            if let Some(scenario) = scenario.filter(|_| is_recorded) {
                cases.push(Case { id, scenario: Arc::new(scenario), seed: result.seed, horizon_s: None });
            }
            results.push(result);
        }
        let given = folder.join("scenarios");
        if cases.is_empty() && given.is_dir() {
            let is_of_run = true;
            return Ok(Self { settings: run.settings, name, left_out, is_of_run, ..Self::of_scenarios(&[given])? });
        }
        if cases.is_empty() {
            return Err(WorkspaceError::input(format!("{} has no scenario to evaluate on", path.display()))
                .with_hint("collect episodes first"));
        }
        let reference_paths_m = reference_paths_m(&results);
        let suite = Self::of_cases(name, cases, run.settings);
        Ok(Self { reference_paths_m, left_out, store: Some(store), is_of_run: true, ..suite })
    }

    /// Scenarios from files or folders, with default settings; each episode has the random stream of its layout.
    ///
    /// # Errors
    /// When a file cannot be read, or two scenarios have the same id.
    pub fn of_scenarios(paths: &[PathBuf]) -> Result<Self, WorkspaceError> {
        let mut scenarios: Vec<Arc<Scenario>> = Vec::new();
        let mut known = BTreeSet::new();
        for path in task_files::expand(paths)? {
            let scenario = scenarios::read_scenario(&path)?;
            if !known.insert(scenario.id.clone()) {
                let twin = format!("two scenarios are called `{}` (the second: {})", scenario.id, path.display());
                return Err(WorkspaceError::input(twin).with_hint("scenario ids name episodes, so they must differ"));
            }
            scenarios.push(Arc::new(scenario));
        }
        let name = match paths {
            [only] if only.is_dir() => name_of_folder(only),
            [only] => documents::stem(only),
            _ => format!("{} scenarios", scenarios.len()),
        };
        Self::of_loaded(name, scenarios)
    }

    /// Scenarios in memory, each with its own id, with default settings; each episode has the random stream of its
    /// layout.
    ///
    /// # Errors
    /// When there are none, or they have different robots.
    pub fn of_loaded(name: String, mut scenarios: Vec<Arc<Scenario>>) -> Result<Self, WorkspaceError> {
        scenarios.sort_by(|a, b| a.id.cmp(&b.id));
        let Some(world) = scenarios.first().map(|scenario| scenario.world.clone()) else {
            return Err(WorkspaceError::input("there is no scenario to evaluate on").with_hint("name scenario files"));
        };
        if let Some(other) = scenarios.iter().find(|scenario| !scenario.world.robot.is_same(&world.robot)) {
            let (ours, theirs) = (&world.robot.name, &other.world.robot.name);
            let what = format!("scenario {} has robot `{theirs}` or its home, the others `{ours}`", other.id);
            return Err(WorkspaceError::input(what).with_hint("evaluate the scenarios of one robot and home at a time"));
        }
        let case = |scenario: &Arc<Scenario>| Case {
            id: scenario.id.clone(),
            scenario: Arc::clone(scenario),
            seed: scenario.seed,
            horizon_s: None,
        };
        let cases = scenarios.iter().map(case).collect();
        Ok(Self::of_cases(name, cases, PipelineSettings::in_world(world)))
    }

    /// A frozen suite: every scenario has the time limit of the suite and the expert's shortest path as reference.
    ///
    /// # Errors
    /// When the suite does not exist, or a scenario differs from the frozen one.
    pub fn frozen(folder: &Path) -> Result<Self, WorkspaceError> {
        let file = suites::open(folder)?;
        let paths: Vec<PathBuf> = file.scenarios.iter().map(|entry| suites::scenario_file(folder, &entry.id)).collect();
        let mut suite = Self::of_scenarios(&paths)?;
        if suite_hash(&suite.scenarios) != file.suite_hash {
            return Err(WorkspaceError::input(format!(
                "the scenarios of {} are not those that were frozen",
                folder.display()
            ))
            .with_hint(format!("`genmanip suite check {}` names what differs", folder.display())));
        }
        for case in &mut suite.cases {
            if let Some(entry) = file.scenarios.iter().find(|entry| entry.id == case.scenario.id) {
                case.horizon_s = Some(entry.horizon_s);
                suite.reference_paths_m.insert(entry.id.clone(), entry.certificate.shortest_path_m);
                suite.traits.insert(entry.id.clone(), traits(entry, &case.scenario.task));
            }
        }
        suite.assets = suites::SuiteAssets::of(folder, &file).map(Arc::new);
        suite.name = file.name;
        suite.perturbation = file.perturbation;
        Ok(suite)
    }

    /// Layouts of a suite of task distributions, laid out again in the built-in world; each scenario has the time limit
    /// of its distribution. `None` if interrupted.
    ///
    /// # Errors
    /// When a layout does not exist in the suite, or cannot be made.
    pub fn of_split(
        suite: &Distributions,
        choice: &SplitChoice,
        workers: usize,
        progress: &dyn Progress,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, WorkspaceError> {
        let drawn = suite.draw(choice)?;
        let settings = PipelineSettings::in_world(suite.judged_in(&default_world()));
        let planner = worlds::planner(&settings.world, &settings.planner)?;
        progress.begin("laying out", drawn.len());
        let one = |drawn: &DrawnTask| {
            let made = suite.lay_out(&drawn.task, Resources::builtin(&planner), &settings.world);
            progress.advance();
            made.map_err(|error| WorkspaceError::broken(format!("layout {} cannot be made", drawn.task.id), error))
        };
        let made = in_parallel(&drawn, workers, stop, &one)?;
        progress.end();
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let is_other = |(scenario, drawn): &(&Scenario, &DrawnTask)| {
            drawn.hash.as_ref().is_some_and(|hash| *hash != layout_hash(scenario))
        };
        let others = made.iter().zip(&drawn).filter(is_other).count();
        if others > 0 {
            progress.note(&format!(
                "{others} of {} layouts are not as they were frozen; `genmanip suite check` names some",
                made.len()
            ));
        }
        let (mut cases, mut traits) = (Vec::new(), Traits::new());
        for (scenario, drawn) in made.into_iter().zip(drawn) {
            let (id, seed, horizon_s) = (scenario.id.clone(), scenario.seed, Some(drawn.horizon_s));
            traits.insert(id.clone(), BTreeMap::from([("distribution".to_owned(), vec![drawn.distribution])]));
            cases.push(Case { id, scenario: Arc::new(scenario), seed, horizon_s });
        }
        let of = choice.distribution.as_ref().map_or_else(String::new, |name| format!("/{name}"));
        let name = format!("{}/{}{of}", suite.file.name, choice.split.name());
        Ok(Some(Self { traits, ..Self::of_cases(name, cases, settings) }))
    }

    /// Source of the scenarios' objects.
    pub fn source(&self) -> &dyn AssetSource {
        self.assets.as_deref().map_or(Catalogue::builtin(), |own| own)
    }

    /// The same suite with the cameras of a file: each replaces the scenarios' camera of the same name, or is added.
    /// The results and the label of the evaluation then name the file.
    ///
    /// # Errors
    /// When the file does not hold a list of cameras.
    pub fn with_cameras(mut self, file: &Path) -> Result<Self, WorkspaceError> {
        let text = documents::read_text(file, limits::CAMERAS)?;
        let no_list = |error: Cause| {
            WorkspaceError::input(format!("{} is no list of cameras", file.display())).because(error).with_hint(
                "expected a JSON list of cameras as in a scenario: name, mount, mount_from_camera, intrinsics",
            )
        };
        json::parse(&text).map_err(|error| match error {
            DocumentError::NotJson { hint, .. } => no_list(error.into()).with_hint(hint),
            _ => no_list(error.into()),
        })?;
        let cameras: Vec<Camera> = serde_json::from_str(&text).map_err(|error| no_list(error.into()))?;
        if let Some(fault) = camera_faults(&cameras).into_iter().next() {
            return Err(no_list(fault.to_string().into()));
        }
        for case in &mut self.cases {
            let mut scenario = (*case.scenario).clone();
            for camera in &cameras {
                match scenario.world.cameras.iter_mut().find(|own| own.name == camera.name) {
                    Some(own) => own.clone_from(camera),
                    None => scenario.world.cameras.push(camera.clone()),
                }
            }
            case.scenario = Arc::new(scenario);
        }
        self.cameras = Some(documents::stem(file));
        Ok(self)
    }

    /// The same suite with `count` episodes per scenario, each with a seed of its own, for stochastic policies. The
    /// first episode has the same id and random stream as without this call.
    #[must_use]
    pub fn with_episodes(mut self, count: usize) -> Self {
        let again = |case: &Case, number: usize| match number {
            0 => case.clone(),
            _ => Case {
                id: format!("{}{AGAIN}{number}", case.id),
                scenario: Arc::clone(&case.scenario),
                seed: case.seed.fork(&format!("episode {number}")),
                horizon_s: case.horizon_s,
            },
        };
        self.cases = self.cases.iter().flat_map(|case| (0..count.max(1)).map(|number| again(case, number))).collect();
        self
    }

    /// The same suite with random streams derived from this seed.
    #[must_use]
    pub fn with_seed(mut self, seed: Seed) -> Self {
        for case in &mut self.cases {
            case.seed = seed.fork(&case.id);
        }
        self
    }

    /// True if there are recorded episodes on the scenarios; damage shows only when one is read.
    pub fn is_recorded(&self) -> bool {
        self.store.is_some()
    }

    /// Label of a policy's evaluation on this suite, usable as a file name.
    pub(super) fn label(&self, policy: &str) -> String {
        let cameras = self.cameras.as_ref().map_or_else(String::new, |cameras| format!("@{cameras}"));
        label(&format!("{policy}{cameras}"))
    }

    /// Recorded episode on the scenario of a case; `None` if the suite has no recordings.
    pub(super) fn recorded(&self, id: &str) -> Result<Option<Episode>, DataError> {
        let is_case = |id: &&str| self.cases.iter().any(|case| case.id == *id);
        let first = id.rsplit_once(AGAIN).filter(|(_, n)| n.parse::<usize>().is_ok()).map(|(first, _)| first);
        let id = first.filter(is_case).unwrap_or(id);
        self.store.as_ref().map(|store| store.read(id)).transpose()
    }

    /// Run folder that evaluations are written to: that of the suite's run, or one that is created from the scenarios.
    pub(super) fn folder(&self, out: &Path) -> Result<RunFolder, WorkspaceError> {
        if self.is_of_run {
            return Ok(RunFolder::open(out)?.0);
        }
        let mut tasks: Vec<Task> = Vec::new();
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        for scenario in &self.scenarios {
            let count = counts.entry(&scenario.task.id).or_default();
            if *count == 0 {
                tasks.push(scenario.task.clone());
            }
            *count += 1;
        }
        let most = counts.into_values().max().unwrap_or_default();
        let seed = self.scenarios.first().map_or(Seed::new(0), |scenario| scenario.seed);
        let tasks = Tasks::spool(tasks, &std::env::temp_dir())?;
        let folder = RunFolder::begin(out, &Run::new(tasks, most, self.settings.clone(), seed))?;
        for scenario in &self.scenarios {
            let path = folder.join("scenarios").join(format!("{}.json", scenario.id));
            if !path.exists() {
                documents::write_file(&path, scenario.to_json().as_bytes())?;
            }
        }
        Ok(folder)
    }
}

/// Traits of a scenario for tables: those of the entry, the source of the task, and the categories of moved objects.
fn traits(entry: &SuiteEntry, task: &Task) -> BTreeMap<String, Vec<String>> {
    let moved = task.goal.alternatives.iter().flatten().map(Atom::subject);
    let mut things: Vec<String> = moved.filter_map(|id| Some(task.card(id)?.category.clone())).collect();
    things.sort();
    things.dedup();
    // Only the first two words: sources of recorded answers end with a name of their own.
    let source = entry.source.split_whitespace().take(2).collect::<Vec<_>>().join(" ");
    let more = [("source".to_owned(), vec![source]), ("object".to_owned(), things)];
    entry.traits.clone().into_iter().chain(more).collect()
}

/// Name of the folder that a path leads to, also for paths such as `.` and `run/..`.
fn name_of_folder(path: &Path) -> String {
    let whole = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    whole.file_name().map_or_else(|| "suite".into(), |name| name.to_string_lossy().into_owned())
}
