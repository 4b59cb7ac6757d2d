//! The folder of a run: what it holds and where.
//!
//! ```text
//! run.json          what the run depends on; a folder never mixes two runs
//! scenarios/        one file per laid-out attempt
//! episodes/         the episode store
//! dataset/          LeRobotDataset v3.0, with its depth sibling dataset-depth/
//! evaluation/       one file per policy
//! timings.json      wall-clock figures, apart from everything that is reproducible
//! report.html
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use genmanip_core::{Document, Seed, Task, Upgrade, upgrade};
use genmanip_data::EpisodeStore;
use genmanip_rollout::collect::CollectSettings;
use serde::{Deserialize, Serialize};

use crate::error::RunError;
use crate::inputs;

/// Everything a run depends on: its input, settings and seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Seed of all attempts.
    pub seed: Seed,
    /// Attempts per task.
    pub episodes_per_task: usize,
    /// The tasks.
    pub tasks: Vec<Task>,
    /// Settings of every stage.
    pub settings: CollectSettings,
    /// Physics engine.
    pub engine: String,
    /// Version of this program.
    pub genmanip_version: String,
}

impl Document for Run {
    const SCHEMA: &'static str = "genmanip.run/2";
    const PREVIOUS: Option<Upgrade> = Some(upgrade::run::FROM_1);
}

impl Run {
    /// A run of this program with the engine it is linked to.
    pub fn new(tasks: Vec<Task>, episodes_per_task: usize, settings: CollectSettings, seed: Seed) -> Self {
        let (engine, genmanip_version) = (genmanip_sim::engine_version(), env!("CARGO_PKG_VERSION").into());
        Self { seed, episodes_per_task, tasks, settings, engine, genmanip_version }
    }
}

/// Wall-clock figures; never part of anything that is compared.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Timings {
    /// Seconds per phase.
    pub phases: BTreeMap<String, f64>,
    /// Seconds per attempt.
    pub attempts: BTreeMap<String, f64>,
}

impl Document for Timings {
    const SCHEMA: &'static str = "genmanip.timings/1";
}

/// A run on disk.
pub struct RunFolder {
    path: PathBuf,
    timings: Mutex<Timings>,
}

impl RunFolder {
    /// Begins a run, or continues the very same one.
    ///
    /// # Errors
    /// [`RunError::AnotherRun`]; when there are episodes without a run, or the folder cannot be written.
    pub fn begin(path: &Path, run: &Run) -> Result<Self, RunError> {
        let file = path.join("run.json");
        if file.exists() {
            let known: Run = inputs::read_document(&file)?;
            if known != *run {
                return Err(RunError::AnotherRun { path: path.to_owned(), difference: difference(&known, run) });
            }
        } else {
            if path.join("episodes").exists() {
                return Err(RunError::input(format!("{} has episodes but no run.json", path.display()))
                    .with_hint("choose an empty --out folder"));
            }
            inputs::write_file(&file, run.to_json().as_bytes())?;
        }
        Ok(Self::at(path))
    }

    /// Opens a run made before.
    ///
    /// # Errors
    /// [`RunError::NoRun`], or when `run.json` is no such document.
    pub fn open(path: &Path) -> Result<(Self, Run), RunError> {
        let file = path.join("run.json");
        if !file.is_file() {
            return Err(RunError::NoRun { path: path.to_owned() });
        }
        Ok((Self::at(path), inputs::read_document(&file)?))
    }

    fn at(path: &Path) -> Self {
        let timings = inputs::read_document(&path.join("timings.json")).unwrap_or_default();
        Self { path: path.to_owned(), timings: Mutex::new(timings) }
    }

    /// A path inside the run.
    pub fn join(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Its episodes.
    ///
    /// # Errors
    /// When the folder of episodes holds something else or cannot be written.
    pub fn store(&self) -> Result<EpisodeStore, RunError> {
        let root = self.join("episodes");
        EpisodeStore::create(&root).map_err(|error| {
            RunError::input(format!("cannot use {}", root.display()))
                .because(error)
                .with_hint("check that the folder is writable and belongs to this run")
        })
    }

    /// Notes how long an attempt took.
    pub fn time_attempt(&self, id: &str, seconds: f64) {
        self.timings.lock().unwrap_or_else(PoisonError::into_inner).attempts.insert(id.to_owned(), seconds);
    }

    /// Notes how long a phase took.
    pub fn time_phase(&self, phase: &str, seconds: f64) {
        self.timings.lock().unwrap_or_else(PoisonError::into_inner).phases.insert(phase.to_owned(), seconds);
    }

    /// The figures so far.
    pub fn timings(&self) -> Timings {
        self.timings.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Writes the figures.
    ///
    /// # Errors
    /// [`RunError::File`].
    pub fn save_timings(&self) -> Result<(), RunError> {
        inputs::write_file(&self.join("timings.json"), self.timings().to_json().as_bytes())
    }
}

fn difference(known: &Run, asked: &Run) -> String {
    if known.seed != asked.seed {
        return format!("its seed is {}, not {}", known.seed, asked.seed);
    }
    if known.episodes_per_task != asked.episodes_per_task {
        return format!("it has {} attempts per task, not {}", known.episodes_per_task, asked.episodes_per_task);
    }
    if known.genmanip_version != asked.genmanip_version || known.engine != asked.engine {
        return format!("made by version {} with {}", known.genmanip_version, known.engine);
    }
    if known.tasks != asked.tasks {
        return "with other tasks".into();
    }
    "with other settings".into()
}
