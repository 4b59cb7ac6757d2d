//! Scenes in which the episodes of a session start.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::{Seed, Task};
use genmanip_motion::Planner;
use genmanip_rollout::Stage;
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources};
use genmanip_rollout::evaluate::Case;

use crate::evaluate::Suite;
use genmanip_benchmark::suites::SuiteAssets;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::task_files;
use genmanip_workspace::worlds;

/// Stages that are kept ready, the ones used last; a stage has a few megabytes.
const KEPT: usize = 16;

/// Scenarios, or tasks that are laid out anew for each seed; sessions share one.
pub struct SceneSource {
    origin: Origin,
    settings: PipelineSettings,
    planner: Arc<Planner>,
    /// The one used last at the end.
    ready: Mutex<Vec<Ready>>,
}

enum Origin {
    /// With the objects of a suite that was frozen with its own.
    Cases(Vec<Case>, Option<Arc<SuiteAssets>>),
    Tasks(Vec<Task>),
}

#[derive(Clone)]
struct Ready {
    index: usize,
    /// Number of the layout; 0 for scenarios.
    number: u64,
    case: Case,
    stage: Stage,
}

impl SceneSource {
    /// The episodes of a suite, as `evaluate` runs them.
    ///
    /// # Errors
    /// When there is no such robot.
    pub fn of_suite(suite: &Suite) -> Result<Self, WorkspaceError> {
        Self::new(Origin::Cases(suite.cases.clone(), suite.assets.clone()), suite.settings.clone())
    }

    /// Task files, or folders of them, laid out in a world: that of the file, or the one that comes with the program.
    ///
    /// # Errors
    /// When a file cannot be read.
    pub fn of_tasks(paths: &[PathBuf], world: Option<&Path>) -> Result<Self, WorkspaceError> {
        let tasks = task_files::read_tasks(paths)?;
        if tasks.is_empty() {
            return Err(WorkspaceError::input("there is no task").with_hint("name task files or their folder"));
        }
        Self::new(Origin::Tasks(tasks), PipelineSettings::in_world(worlds::read_world(world)?))
    }

    fn new(origin: Origin, settings: PipelineSettings) -> Result<Self, WorkspaceError> {
        let planner = worlds::planner(&settings.world, &settings.planner)?;
        Ok(Self { origin, settings, planner, ready: Mutex::default() })
    }

    /// Number of scenes.
    pub fn len(&self) -> usize {
        match &self.origin {
            Origin::Cases(cases, _) => cases.len(),
            Origin::Tasks(tasks) => tasks.len(),
        }
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Ids of the episodes or tasks, by index.
    pub fn ids(&self) -> Vec<&str> {
        match &self.origin {
            Origin::Cases(cases, _) => cases.iter().map(|case| case.id.as_str()).collect(),
            Origin::Tasks(tasks) => tasks.iter().map(|task| task.id.as_str()).collect(),
        }
    }

    /// Maximum number of objects of a scene.
    pub fn max_objects(&self) -> usize {
        match &self.origin {
            Origin::Cases(cases, _) => cases.iter().map(|case| case.scenario.objects.len()).max(),
            Origin::Tasks(tasks) => tasks.iter().map(|task| task.objects.len()).max(),
        }
        .unwrap_or_default()
    }

    /// Settings of the loop.
    pub fn settings(&self) -> &PipelineSettings {
        &self.settings
    }

    /// Planner of the robot.
    pub fn planner(&self) -> &Arc<Planner> {
        &self.planner
    }

    /// A scenario made ready, with its stream.
    ///
    /// # Errors
    /// An index that is none, a task that cannot be laid out, and objects that are not those of the scenario.
    pub fn open(&self, index: usize, seed: Option<u64>) -> Result<(Case, Stage), WorkspaceError> {
        let is_task = matches!(self.origin, Origin::Tasks(_));
        let number = seed.filter(|_| is_task).unwrap_or_default();
        let known = {
            let mut ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner);
            let place = ready.iter().position(|it| it.index == index && it.number == number);
            place.map(|place| {
                let used = ready.remove(place);
                ready.push(used.clone());
                used
            })
        };
        let Ready { mut case, stage, .. } = match known {
            Some(ready) => ready,
            None => self.made(index, number)?,
        };
        if let Some(seed) = seed.filter(|_| !is_task) {
            case.seed = Seed::new(seed).fork(&case.id);
        }
        Ok((case, stage))
    }

    fn made(&self, index: usize, number: u64) -> Result<Ready, WorkspaceError> {
        let none = || {
            let what = format!("there is no scene {index}");
            WorkspaceError::input(what).with_hint(format!("there are {}, counted from 0", self.len()))
        };
        let case = match &self.origin {
            Origin::Cases(cases, _) => cases.get(index).ok_or_else(none)?.clone(),
            Origin::Tasks(tasks) => self.laid_out(tasks.get(index).ok_or_else(none)?, number)?,
        };
        let source: &dyn AssetSource = match &self.origin {
            Origin::Cases(_, Some(own)) => own.as_ref(),
            _ => Catalogue::builtin(),
        };
        let stage = Stage::open(Arc::clone(&case.scenario), source, self.planner.robot());
        let stage = stage.map_err(|error| {
            WorkspaceError::input(format!("scenario {} cannot be set up", case.scenario.id))
                .because(error)
                .with_hint("a scenario belongs to the objects and robot it was made with; lay its task out again")
        })?;
        let made = Ready { index, number, case, stage };
        let mut ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner);
        if ready.len() >= KEPT {
            ready.remove(0);
        }
        ready.push(made.clone());
        Ok(made)
    }

    fn laid_out(&self, task: &Task, number: u64) -> Result<Case, WorkspaceError> {
        let attempt = Attempt::of(task, number, Seed::new(0));
        let resources = Resources::builtin(&self.planner);
        let scenario = attempt.scenario(resources, &self.settings.world, &self.settings.layout).map_err(|error| {
            WorkspaceError::input(format!("task {} has no layout {number}", task.id))
                .because(error)
                .with_hint("another seed gives another layout; `genmanip layout --explain` draws why")
        })?;
        let scenario = Arc::new(scenario);
        Ok(Case { id: attempt.id(), seed: scenario.seed, scenario, horizon_s: None })
    }
}

impl std::fmt::Debug for SceneSource {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("SceneSource").field("ids", &self.ids()).finish_non_exhaustive()
    }
}
