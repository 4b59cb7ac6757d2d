//! Tasks to train on for a suite: designed of objects for training alone, sharing nothing with what is tested.

use genmanip_workspace::documents;
use genmanip_workspace::scenarios;
use genmanip_workspace::task_files;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::suite::Stage;
use genmanip_assets::Catalogue;
use genmanip_assets::metadata::Split;
use genmanip_core::{Document, ObjectCard, Scenario, Seed, Task};
use genmanip_tasks::designer::{DesignSettings, Series};
use serde::{Deserialize, Serialize};

use super::{KINDS, open, scenario_file};
use genmanip_workspace::Progress;
use genmanip_workspace::RunError;
use genmanip_workspace::designed_tasks;

/// Designs of a kind for each task that is wanted, before the kind is given up.
const DESIGNS_PER_TASK: usize = 8;

/// What is designed, and where it is written.
#[derive(Clone, Debug)]
pub struct TrainingOptions {
    /// Folder of the suite that is tested on.
    pub suite: PathBuf,
    /// Folder of the tasks.
    pub out: PathBuf,
    /// Tasks of each kind.
    pub per_kind: usize,
    /// Seed of the series of each kind.
    pub seed: Seed,
}

/// The file `training.json` beside the tasks: how they can be made again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Training {
    /// Name of the suite.
    pub suite: String,
    /// Hash of its scenarios.
    pub suite_hash: String,
    /// Seed of the series of each kind.
    pub seed: Seed,
    /// Tasks of each kind that were asked for.
    pub per_kind: usize,
    /// Version of the program.
    pub genmanip_version: String,
    /// Objects that tasks may be about.
    pub objects: usize,
    /// Tasks of each kind, and why others were left out.
    pub funnel: Stage,
}

impl Document for Training {
    const SCHEMA: &'static str = "genmanip.training/1";
}

/// Designs tasks of the suite's kinds about objects for training, and writes those that share neither sentence nor scene
/// graph with the suite into `out/tasks`, and `out/training.json` last.
///
/// # Errors
/// When there is no suite, a kind has too few such tasks, the folder holds others, or a file cannot be written.
pub fn training(options: &TrainingOptions, progress: &dyn Progress) -> Result<Training, RunError> {
    let file = options.out.join("training.json");
    let tasks = options.out.join("tasks");
    // Without the file tasks are what an interrupted call left, perhaps of another seed.
    if let Some(there) = [&file, &tasks].into_iter().find(|path| path.exists()) {
        return Err(RunError::input(format!("{} exists", there.display())).with_hint("choose another --out folder"));
    }
    let suite = open(&options.suite)?;
    let tested = Tested::of(&scenarios(&options.suite)?);
    let catalogue = Catalogue::full();
    let is_for_training = |card: &&ObjectCard| catalogue.split(&card.uid) == Split::Train;
    let cards: Vec<ObjectCard> = catalogue.cards().iter().filter(is_for_training).cloned().collect();
    let settings = DesignSettings::default();
    let mut funnel = Stage::new("share no sentence, no scene graph and no unseen object with the suite");
    progress.begin("designing", options.per_kind * KINDS.len());
    for kind in KINDS {
        let kinds = [kind];
        let mut series = Series::new(&kinds, &cards, options.seed.fork("training"), &settings, false)
            .map_err(|error| RunError::broken("the designer gave up", error))?;
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
            return Err(RunError::input(what).with_hint("ask for fewer tasks, and collect more episodes of each"));
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

/// What tasks share with a suite that they must not, a line each.
///
/// # Errors
/// When there is no suite, or a task cannot be read.
pub fn shared(suite: &Path, tasks: &[PathBuf]) -> Result<Vec<String>, RunError> {
    let tested = Tested::of(&scenarios(suite)?);
    let tasks = task_files::read_tasks(tasks)?;
    Ok(tasks.iter().filter_map(|task| Some(format!("task {}: {}", task.id, tested.shared(task)?))).collect())
}

fn scenarios(folder: &Path) -> Result<Vec<Scenario>, RunError> {
    let entries = open(folder)?.scenarios;
    entries.iter().map(|entry| scenarios::read_scenario(&scenario_file(folder, &entry.id))).collect()
}

/// What must not be trained on.
struct Tested {
    sentences: BTreeSet<String>,
    graphs: BTreeSet<String>,
}

impl Tested {
    fn of(scenarios: &[Scenario]) -> Self {
        let tasks = || scenarios.iter().map(|scenario| &scenario.task);
        Self { sentences: tasks().map(sentence).collect(), graphs: tasks().map(graph).collect() }
    }

    /// Why a task must not be trained on.
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

/// Objects and how they stand to each other, whatever the order.
fn graph(task: &Task) -> String {
    let mut lines: Vec<String> = task.scene_graph.nodes.iter().map(|node| node.id.clone()).collect();
    lines.extend(task.scene_graph.edges.iter().map(|edge| serde_json::to_string(edge).unwrap_or_default()));
    lines.sort();
    lines.join("\n")
}
