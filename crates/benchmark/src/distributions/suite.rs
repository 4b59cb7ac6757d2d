//! Suite of task distributions, and selection of its layouts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use genmanip_core::{Document, RelationSettings, Scenario, Seed, Task, World, limits};
use genmanip_layout::{LayoutError, LayoutSettings};
use genmanip_rollout::collect::{Attempt, Resources};
use genmanip_workspace::{WorkspaceError, documents};
use serde::Deserialize;

use super::draw::{Place, draw, layout_seed};
use super::format::{Distribution, DistributionsFile, Split};
use super::frozen::{FrozenLayout, FrozenLayouts, from_text};

/// A suite of task distributions with its frozen layouts.
#[derive(Clone, Debug)]
pub struct Distributions {
    /// Document of the suite.
    pub file: DistributionsFile,
    /// Frozen layouts by name of the distribution.
    frozen: BTreeMap<String, FrozenLayouts>,
}

/// Selection of layouts of a suite.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SplitChoice {
    /// Split to use.
    pub split: Split,
    /// Name of the only distribution; `None` for all.
    pub distribution: Option<String>,
    /// Number of layouts of each distribution, from the front; `None` for all.
    pub first: Option<u64>,
}

/// Task of a selected layout.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnTask {
    /// The task; its layout is attempt 0 of a run with [`Distributions::seed`].
    pub task: Task,
    /// Name of the task's distribution.
    pub distribution: String,
    /// Simulated time available to a policy, s.
    pub horizon_s: f64,
    /// Frozen hash of the layout; `None` if it is not frozen.
    pub hash: Option<String>,
}

impl Distributions {
    /// Reads a suite's folder.
    ///
    /// # Errors
    /// If there is no such suite, or one of its files is damaged.
    pub fn open(folder: &Path) -> Result<Self, WorkspaceError> {
        let path = folder.join(SUITE);
        let file: DistributionsFile = documents::read_document(&path, limits::SUITE)?;
        if let Some(fault) = file.fault() {
            return Err(WorkspaceError::input(format!("{} is no suite of task distributions", path.display()))
                .because(fault)
                .with_hint("docs/formats/suite.md describes its keys"));
        }
        let mut frozen = BTreeMap::new();
        for Distribution { name, .. } in &file.distributions {
            let path = layouts_file(folder, name);
            if path.is_file() {
                let layouts = from_text(&documents::read_text(&path, limits::SUITE)?).map_err(|fault| {
                    WorkspaceError::input(format!("{} holds no frozen layouts", path.display()))
                        .because(fault)
                        .with_hint("take the file of the release, or remove it and freeze the suite again")
                })?;
                frozen.insert(name.clone(), layouts);
            }
        }
        Ok(Self { file, frozen })
    }

    /// Seed of a run whose first attempts (number 0) give the layouts.
    pub fn seed(&self) -> Seed {
        layout_seed(&self.file)
    }

    /// The world with *between* interpreted as in the suite.
    pub fn judged_in(&self, world: &World) -> World {
        let relations = RelationSettings { between: self.file.between, ..world.relations };
        World { relations, ..world.clone() }
    }

    /// The selected layouts: the first of every distribution, then the second of every distribution, and so on.
    ///
    /// # Errors
    /// If the distribution does not exist, or a distribution has fewer layouts than requested.
    pub fn draw(&self, choice: &SplitChoice) -> Result<Vec<DrawnTask>, WorkspaceError> {
        let SplitChoice { split, distribution, first } = choice;
        let names: Vec<&str> = self.file.distributions.iter().map(|it| it.name.as_str()).collect();
        if let Some(name) = distribution.as_ref().filter(|name| !names.contains(&name.as_str())) {
            return Err(WorkspaceError::unknown("distribution", "distributions", name, &names));
        }
        let size = self.file.size(*split);
        let count = first.unwrap_or(size);
        if count > size {
            let what = format!("split `{}` of {} has {size} layouts per distribution", split.name(), self.file.name);
            return Err(WorkspaceError::input(what).with_hint(format!("--first takes 1 to {size}")));
        }
        let wanted = |it: &&Distribution| distribution.as_ref().is_none_or(|name| it.name == *name);
        let wanted: Vec<&Distribution> = self.file.distributions.iter().filter(wanted).collect();
        let numbers = (0..count).flat_map(|number| wanted.iter().map(move |it| (*it, number)));
        Ok(numbers.map(|(distribution, number)| self.layout(distribution, *split, number)).collect())
    }

    /// Task of layout `number` (from 0) of a split.
    pub(super) fn layout(&self, distribution: &Distribution, split: Split, number: u64) -> DrawnTask {
        let frozen = self.frozen_layouts(&distribution.name, split).get(number as usize);
        let attempt = frozen.map_or(1, |frozen| frozen.attempt);
        DrawnTask {
            task: draw(&self.file, distribution, Place { split, number, attempt }),
            distribution: distribution.name.clone(),
            horizon_s: distribution.horizon_s,
            hash: frozen.map(|frozen| frozen.hash.clone()),
        }
    }

    /// Frozen layouts of a split, in their order; empty if it is not frozen.
    pub fn frozen_layouts(&self, distribution: &str, split: Split) -> &[FrozenLayout] {
        self.frozen.get(distribution).and_then(|it| it.get(&split)).map_or(&[], Vec::as_slice)
    }

    /// Lays out a task of the suite.
    ///
    /// # Errors
    /// If no layout is found.
    pub fn lay_out(&self, task: &Task, resources: Resources, world: &World) -> Result<Scenario, LayoutError> {
        Attempt::of(task, 0, self.seed()).scenario(resources, world, &LayoutSettings::default())
    }
}

/// Layouts that a command selects by suite, split, distribution and number; `None` for a suite of scenarios, which
/// has no splits.
///
/// # Errors
/// If a suite of distributions is named without a split or a suite of scenarios with one, or the suite does not exist.
pub fn choose(
    folder: &Path,
    split: Option<Split>,
    distribution: Option<&str>,
    first: Option<usize>,
) -> Result<Option<(Distributions, SplitChoice)>, WorkspaceError> {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    match (is_of_distributions(folder), split) {
        (true, Some(split)) => {
            let distribution = distribution.map(str::to_owned);
            let choice = SplitChoice { split, distribution, first: first.map(|first| first as u64) };
            Ok(Some((Distributions::open(folder)?, choice)))
        }
        (true, None) => {
            let file = Distributions::open(folder)?.file;
            let sizes = Split::ALL.map(|split| format!("{} ({})", split.name(), file.size(split))).join(", ");
            let names: Vec<&str> = file.distributions.iter().map(|it| it.name.as_str()).collect();
            let hint = format!("--split takes {sizes} layouts each of the distributions {}", names.join(", "));
            Err(WorkspaceError::input(format!("{name} is a suite of task distributions: choose a split"))
                .with_hint(hint))
        }
        (false, Some(_)) if folder.join(SUITE).is_file() => {
            Err(WorkspaceError::input(format!("{name} is a suite of frozen scenarios, which has no splits"))
                .with_hint("omit --split; `genmanip suite train` designs tasks to train on for such a suite"))
        }
        (false, _) => Ok(None),
    }
}

/// True if a folder is a suite of task distributions; false for every other folder.
pub fn is_of_distributions(folder: &Path) -> bool {
    #[derive(Deserialize)]
    struct Tagged {
        schema: String,
    }
    let bytes = documents::read_bytes(&folder.join(SUITE), limits::SUITE);
    let tagged = bytes.ok().and_then(|bytes| serde_json::from_slice::<Tagged>(&bytes).ok());
    tagged.is_some_and(|tagged| tagged.schema == DistributionsFile::SCHEMA)
}

/// Name of the document in a suite's folder.
const SUITE: &str = "suite.json";

/// Path of the file with a distribution's frozen layouts.
pub(super) fn layouts_file(folder: &Path, distribution: &str) -> PathBuf {
    folder.join("layouts").join(format!("{distribution}.txt"))
}
