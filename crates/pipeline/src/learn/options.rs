//! Options and results of training and of its check.

use std::path::PathBuf;

use genmanip_benchmark::statistics::Rate;
use genmanip_core::Seed;
use genmanip_policy::Preset;
use serde::{Deserialize, Serialize};

/// Activity that a training tells its progress, a unit per step.
pub const TRAINING: &str = "training";

/// Length of a training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Length {
    /// Number of steps.
    Steps(u64),
    /// Wall-clock time, s; becomes a number of steps once, after the first 50, which is kept with the training.
    BudgetS(u64),
}

/// Options of [`super::train`].
#[derive(Clone, Debug)]
pub struct TrainOptions {
    /// Folder of the run with the demonstrations.
    pub run: PathBuf,
    /// Inputs and sizes.
    pub preset: Preset,
    /// Number of steps or time.
    pub length: Length,
    /// Seed of initial weights and samples.
    pub seed: Seed,
    /// Simulator labels in training, where the inputs hold no simulator truth: positions of the objects of the goal.
    pub labels: bool,
    /// Folder of the policy.
    pub out: PathBuf,
    /// Threads; the weights do not depend on them.
    pub threads: usize,
}

/// Result of a training.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trained {
    /// Folder of the policy.
    pub policy: PathBuf,
    /// Preset.
    pub preset: Preset,
    /// True if the policy reads simulator ground truth.
    pub privileged: bool,
    /// True if simulator labels were used in training.
    pub labels: bool,
    /// Number of demonstrations.
    pub demonstrations: usize,
    /// Number of their rows.
    pub rows: usize,
    /// Number of samples seen.
    pub samples: u64,
    /// Number of steps.
    pub steps: u64,
    /// Number of parameters.
    pub parameters: usize,
    /// L1 error of normalised actions at the end, on samples of the training.
    pub final_l1: f64,
    /// SHA-256 of the tensors.
    pub tensors_sha256: String,
    /// Steps that an earlier call had finished; `None` if there was none.
    pub resumed_from: Option<u64>,
    /// Wall-clock time of the steps of this call, s.
    pub seconds: f64,
}

/// Options of [`super::demonstrate`].
#[derive(Clone, Debug)]
pub struct SuiteDemonstrations {
    /// Folder of a suite of task distributions.
    pub suite: PathBuf,
    /// Name of the only distribution; `None` for all, in turn.
    pub distribution: Option<String>,
    /// Number of verified demonstrations.
    pub count: usize,
    /// Folder of the run.
    pub run: PathBuf,
    /// Threads; the demonstrations do not depend on them.
    pub workers: usize,
}

/// Options of [`super::check`].
#[derive(Clone, Debug)]
pub struct CheckOptions {
    /// Folder of the run with the demonstrations.
    pub run: PathBuf,
    /// Inputs and sizes.
    pub preset: Preset,
    /// Number of demonstrations that are replayed; all where there are fewer.
    pub demonstrations: usize,
    /// Cores that are used.
    pub workers: usize,
}

/// Result of [`super::check`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Checked {
    /// Number of demonstrations replayed.
    pub demonstrations: usize,
    /// Share of their layouts solved by the recorded rows on the way of a learned policy's output.
    pub replay_success: Rate,
    /// Least share that is accepted.
    pub expected: f64,
}
