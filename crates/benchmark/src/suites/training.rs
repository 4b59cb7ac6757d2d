//! Training tasks for a suite: only about objects of the training split, without overlap with the suite.

use genmanip_workspace::documents;
use genmanip_workspace::scenarios;
use genmanip_workspace::task_files;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::suite_format::BuildStep;
use genmanip_assets::Catalogue;
use genmanip_assets::metadata::Split;
use genmanip_core::{Document, ObjectCard, Scenario, Seed, Task};
use genmanip_tasks::designer::{DesignSettings, Series};
use serde::{Deserialize, Serialize};

use super::{KINDS, open, scenario_file};
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::designed_tasks;

/// Maximum number of designed tasks of a kind per wanted task.
const DESIGNS_PER_TASK: usize = 8;

/// Options of [`training`].
#[derive(Clone, Debug)]
pub struct TrainingOptions {
    /// Folder of the suite used for testing.
    pub suite: PathBuf,
    /// Folder to write the tasks to.
    pub out: PathBuf,
    /// Number of tasks per kind.
    pub per_kind: usize,
    /// Seed of the designer's series of each kind.
    pub seed: Seed,
}

/// Document `training.json` beside the tasks: everything needed to reproduce them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Training {
    /// Name of the suite.
    pub suite: String,
    /// [`crate::suite_hash`] of the suite's scenarios.
    pub suite_hash: String,
    /// Seed of the designer's series of each kind.
    pub seed: Seed,
    /// Number of tasks requested per kind.
    pub per_kind: usize,
    /// Version of this program.
    pub genmanip_version: String,
    /// Number of objects of the training split, which the tasks are about.
    pub objects: usize,
    /// Number of tasks per kind, and of rejected ones by reason.
    pub funnel: BuildStep,
}

impl Document for Training {
    const SCHEMA: &'static str = "genmanip.training/1";
}

/// Designs tasks of the suite's kinds about objects of the training split. Those that share neither sentence nor scene
/// graph with the suite are written to `out/tasks`; `out/training.json` is written last.
///
/// # Errors
/// If the suite does not exist, a kind has too few such tasks, the folder already has tasks, or a file cannot be
/// written.
pub fn training(options: &TrainingOptions, progress: &dyn Progress) -> Result<Training, WorkspaceError> {
    let file = options.out.join("training.json");
    let tasks = options.out.join("tasks");
    // Tasks without `training.json` are left from an interrupted call, perhaps with another seed.
    if let Some(there) = [&file, &tasks].into_iter().find(|path| path.exists()) {
        return Err(
            WorkspaceError::input(format!("{} exists", there.display())).with_hint("choose another --out folder")
        );
    }
    let suite = open(&options.suite)?;
    let tested = Tested::of(&scenarios(&options.suite)?);
    let catalogue = Catalogue::full();
    let is_for_training = |card: &&ObjectCard| catalogue.split(&card.uid) == Split::Train;
    let cards: Vec<ObjectCard> = catalogue.cards().iter().filter(is_for_training).cloned().collect();
    let settings = DesignSettings::default();
    let mut funnel = BuildStep::new("share no sentence, no scene graph and no unseen object with the suite");
    progress.begin("designing", options.per_kind * KINDS.len());
    for kind in KINDS {
        let kinds = [kind];
        let mut series = Series::new(&kinds, &cards, options.seed.fork("training"), &settings, false)
            .map_err(|error| WorkspaceError::broken("the designer gave up", error))?;
        let mut made = 0;
        for _ in 0..options.per_kind * DESIGNS_PER_TASK {
            if made == options.per_kind {
                break;
            }
            match series.compose().map_err(|missing| missing.why.to_string()) {
                Err(why) => funnel.refuse(format!("{}: {why}", kind.name())),
                Ok(task) => match tested.shared(&task) {
                    Some(shared) => funnel.refuse(format!("{}: {shared}", kind.name())),
                    None => {
                        designed_tasks::write(&task, &tasks)?;
                        funnel.pass(kind);
                        made += 1;
                        progress.advance();
                    }
                },
            }
        }
        if made < options.per_kind {
            let what = format!("{made} of {} tasks of kind {} could be designed", options.per_kind, kind.name());
            return Err(WorkspaceError::input(what).with_hint("ask for fewer tasks, and collect more episodes of each"));
        }
    }
    progress.end();
    let training = Training {
        suite: suite.name,
        suite_hash: suite.suite_hash,
        seed: options.seed,
        per_kind: options.per_kind,
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
        objects: cards.len(),
        funnel,
    };
    documents::write_file(&file, training.to_json().as_bytes())?;
    Ok(training)
}

/// Reasons why tasks must not be used for training beside a suite (an object kept for testing, or a sentence or scene
/// graph of the suite): one text per such task.
///
/// # Errors
/// If the suite does not exist, or a task cannot be read.
pub fn shared(suite: &Path, tasks: &[PathBuf]) -> Result<Vec<String>, WorkspaceError> {
    let tested = Tested::of(&scenarios(suite)?);
    let tasks = task_files::read_tasks(tasks)?;
    Ok(tasks.iter().filter_map(|task| Some(format!("task {}: {}", task.id, tested.shared(task)?))).collect())
}

fn scenarios(folder: &Path) -> Result<Vec<Scenario>, WorkspaceError> {
    let entries = open(folder)?.scenarios;
    entries.iter().map(|entry| scenarios::read_scenario(&scenario_file(folder, &entry.id))).collect()
}

/// Content of a suite that training tasks must not share.
struct Tested {
    sentences: BTreeSet<String>,
    graphs: BTreeSet<String>,
}

impl Tested {
    fn of(scenarios: &[Scenario]) -> Self {
        let tasks = || scenarios.iter().map(|scenario| &scenario.task);
        Self { sentences: tasks().map(sentence).collect(), graphs: tasks().map(graph).collect() }
    }

    /// Reason why a task must not be used for training; `None` if it may.
    fn shared(&self, task: &Task) -> Option<&'static str> {
        let is_unseen = |card: &ObjectCard| Catalogue::full().split(&card.uid) != Split::Train;
        match () {
            () if task.scene_graph.nodes.iter().any(|node| task.card(&node.id).is_some_and(is_unseen)) => {
                Some("an object of it is kept for testing")
            }
            () if self.sentences.contains(&sentence(task)) => Some("its sentence is one of the suite"),
            () if self.graphs.contains(&graph(task)) => Some("its scene graph is one of the suite"),
            () => None,
        }
    }
}

fn sentence(task: &Task) -> String {
    task.instruction.trim().to_lowercase()
}

/// Objects and relations of a scene graph as text, independent of their order.
fn graph(task: &Task) -> String {
    let mut lines: Vec<String> = task.scene_graph.nodes.iter().map(|node| node.id.to_string()).collect();
    lines.extend(task.scene_graph.edges.iter().map(|edge| serde_json::to_string(edge).unwrap_or_default()));
    lines.sort();
    lines.join("\n")
}
