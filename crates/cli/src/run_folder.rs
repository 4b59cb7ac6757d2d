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

use crate::error::Failed;
use crate::inputs;

/// Everything a run depends on.
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
    pub fn begin(path: &Path, run: &Run) -> Result<Self, Failed> {
        let file = path.join("run.json");
        if file.exists() {
            let known: Run = inputs::read_document(&file)?;
            if known != *run {
                return Err(Failed::new(format!("{} holds another run ({})", path.display(), difference(&known, run)))
                    .hint("choose another --out folder, or repeat the command of that run to continue it"));
            }
        } else {
            if path.join("episodes").exists() {
                return Err(Failed::new(format!("{} has episodes but no run.json", path.display()))
                    .hint("choose an empty --out folder"));
            }
            inputs::write_file(&file, run.to_json().as_bytes())?;
        }
        Ok(Self::at(path))
    }

    /// Opens a run made before.
    pub fn open(path: &Path) -> Result<(Self, Run), Failed> {
        let file = path.join("run.json");
        if !file.is_file() {
            return Err(Failed::new(format!("no run at {}", path.display()))
                .hint("make one with `genmanip collect TASKS --out FOLDER`"));
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
    pub fn store(&self) -> Result<EpisodeStore, Failed> {
        let root = self.join("episodes");
        EpisodeStore::create(&root).map_err(|error| {
            Failed::because(format!("cannot use {}", root.display()), &error)
                .hint("check that the folder is writable and belongs to this run")
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
    pub fn save_timings(&self) -> Result<(), Failed> {
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
