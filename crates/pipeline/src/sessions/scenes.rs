//! Scenes that the episodes of a session start in.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::{Document, Seed, Task, World};
use genmanip_motion::Planner;
use genmanip_rollout::Stage;
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources};
use genmanip_rollout::evaluate::Case;
use genmanip_rollout::shaping::Milestone;

use crate::evaluate::Suite;
use genmanip_benchmark::suites::SuiteAssets;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::task_files;
use genmanip_workspace::worlds;

/// Default number of most recently used stages kept in memory; each takes a few megabytes.
pub const DEFAULT_KEPT: usize = 16;
/// Task of the curricula `reach`, `lift` and `place`: a cube is put on a plate.
const PLACE: &str = include_str!("../../data/place.json");

/// Source of scenes: scenarios, or tasks that are laid out for each seed. Several sessions may share one source.
pub struct SceneSource {
    origin: Origin,
    settings: PipelineSettings,
    planner: Arc<Planner>,
    milestone: Milestone,
    /// Maximum number of stages kept in memory.
    kept: usize,
    /// Stages in memory, most recently used last.
    ready: Mutex<Vec<Ready>>,
}

enum Origin {
    /// Cases of scenarios; with the objects of their suite, if it was frozen with its own.
    Cases(Vec<Case>, Option<Arc<SuiteAssets>>),
    Tasks(Vec<Task>),
}

#[derive(Clone)]
struct Ready {
    index: usize,
    /// Number of the task's layout; 0 for scenarios.
    number: u64,
    case: Case,
    stage: Stage,
}

impl SceneSource {
    /// Scenes of a suite, the same episodes as in `evaluate`.
    ///
    /// # Errors
    /// When the robot of the suite's world is unknown.
    pub fn of_suite(suite: &Suite) -> Result<Self, WorkspaceError> {
        Self::new(Origin::Cases(suite.cases.clone(), suite.assets.clone()), suite.settings.clone())
    }

    /// Tasks from files or folders, laid out in the world of a file, or in the built-in one if `None`.
    ///
    /// A single path `reach`, `lift` or `place` that is no file stands for the built-in task of putting a cube on a
    /// plate,
    /// where an episode succeeds once the cube is reached, lifted or placed.
    ///
    /// # Errors
    /// When a file cannot be read, there is no task, or the robot is unknown.
    pub fn of_tasks(paths: &[PathBuf], world: Option<&Path>) -> Result<Self, WorkspaceError> {
        if let Some(milestone) = curriculum(paths) {
            let unreadable = |error| WorkspaceError::broken("the built-in task cannot be read", error);
            let task = Task::from_json(PLACE).map_err(unreadable)?;
            let settings = PipelineSettings::in_world(worlds::read_world(world)?);
            return Ok(Self { milestone, ..Self::new(Origin::Tasks(vec![task]), settings)? });
        }
        let tasks = task_files::read_tasks(paths)?;
        if tasks.is_empty() {
            return Err(WorkspaceError::input("there is no task").with_hint("name task files or their folder"));
        }
        Self::new(Origin::Tasks(tasks), PipelineSettings::in_world(worlds::read_world(world)?))
    }

    fn new(origin: Origin, settings: PipelineSettings) -> Result<Self, WorkspaceError> {
        let planner = worlds::planner(&settings.world, &settings.planner)?;
        let (milestone, kept) = (Milestone::Goal, DEFAULT_KEPT);
        Ok(Self { origin, settings, planner, milestone, kept, ready: Mutex::default() })
    }

    /// Sets the maximum number of stages kept in memory, at least one.
    #[must_use]
    pub fn keeping(self, kept: usize) -> Self {
        Self { kept: kept.max(1), ..self }
    }

    /// Milestone of the task at which an episode succeeds.
    pub fn milestone(&self) -> Milestone {
        self.milestone
    }

    /// Number of scenes.
    pub fn len(&self) -> usize {
        match &self.origin {
            Origin::Cases(cases, _) => cases.len(),
            Origin::Tasks(tasks) => tasks.len(),
        }
    }

    /// True if there are no scenes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Ids of the cases or tasks, by index of the scene.
    pub fn ids(&self) -> Vec<&str> {
        match &self.origin {
            Origin::Cases(cases, _) => cases.iter().map(|case| case.id.as_str()).collect(),
            Origin::Tasks(tasks) => tasks.iter().map(|task| task.id.as_str()).collect(),
        }
    }

    /// Maximum number of objects in a scene.
    pub fn max_objects(&self) -> usize {
        match &self.origin {
            Origin::Cases(cases, _) => cases.iter().map(|case| case.scenario.objects.len()).max(),
            Origin::Tasks(tasks) => tasks.iter().map(|task| task.objects.len()).max(),
        }
        .unwrap_or_default()
    }

    /// Maximum number of joints of an object in the scenes.
    pub fn max_joints(&self) -> usize {
        let of_task = |task: &Task| {
            let nodes = task.scene_graph.nodes.iter().filter_map(|node| Catalogue::builtin().model(&node.asset).ok());
            nodes.map(|model| model.links.iter().filter(|link| link.joint.is_some()).count()).max()
        };
        let of_case = |case: &Case| case.scenario.objects.iter().map(|object| object.joint_positions.len()).max();
        match &self.origin {
            Origin::Cases(cases, _) => cases.iter().filter_map(of_case).max(),
            Origin::Tasks(tasks) => tasks.iter().filter_map(of_task).max(),
        }
        .unwrap_or_default()
    }

    /// Worlds of all scenes, in no particular order.
    pub fn worlds(&self) -> Vec<&World> {
        match &self.origin {
            Origin::Cases(cases, _) => cases.iter().map(|case| &case.scenario.world).collect(),
            Origin::Tasks(_) => vec![&self.settings.world],
        }
    }

    /// Settings of the episode loop.
    pub fn settings(&self) -> &PipelineSettings {
        &self.settings
    }

    /// Planner of the robot.
    pub fn planner(&self) -> &Arc<Planner> {
        &self.planner
    }

    /// Case and stage of scene `index`. For a task, `seed` is the number of its layout, 0 by default; for a scenario,
    /// it
    /// replaces the random stream of the episode.
    ///
    /// # Errors
    /// When the index is out of range, a task cannot be laid out, or objects or robot differ from those of the
    /// scenario.
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
        let excess = (ready.len() + 1).saturating_sub(self.kept);
        ready.drain(..excess);
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

/// Milestone of a built-in curriculum; `None` for other paths.
fn curriculum(paths: &[PathBuf]) -> Option<Milestone> {
    let [path] = paths else { return None };
    match path.to_str() {
        _ if path.exists() => None,
        Some("reach") => Some(Milestone::Reach),
        Some("lift") => Some(Milestone::Lift),
        Some("place") => Some(Milestone::Goal),
        _ => None,
    }
}

impl std::fmt::Debug for SceneSource {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("SceneSource").field("ids", &self.ids()).finish_non_exhaustive()
    }
}
