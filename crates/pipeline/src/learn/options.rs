//! Options and results of training, of collecting demonstrations for it, and of its check.

use std::path::PathBuf;

use genmanip_benchmark::statistics::Rate;
use genmanip_core::Seed;
use genmanip_data::Provenance;
use genmanip_policy::{Head, Preset};
use serde::{Deserialize, Serialize};

/// Name of the activity that training reports to its progress, one unit per optimiser step.
pub const TRAINING: &str = "training";

/// Length of a training run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Length {
    /// Number of optimiser steps.
    Steps(u64),
    /// Wall-clock time, s. It is converted to a number of steps once, after the first 50 steps; a resumed run keeps
    /// this number.
    BudgetS(u64),
}

/// Options of [`super::train`].
#[derive(Clone, Debug)]
pub struct TrainOptions {
    /// Folder of the run with the demonstrations.
    pub run: PathBuf,
    /// Only demonstrations whose commands came from one of these; empty for all.
    pub sources: Vec<Provenance>,
    /// Preset of inputs and network size.
    pub preset: Preset,
    /// Output of the network, with its loss.
    pub head: Head,
    /// Number of steps, or time.
    pub length: Length,
    /// Seed of the initial weights and of the sampling.
    pub seed: Seed,
    /// True for an auxiliary loss on simulator labels (positions of the goal's objects); only for presets whose inputs
    /// contain no simulator truth.
    pub labels: bool,
    /// Folder to write the policy to.
    pub out: PathBuf,
    /// Number of threads; the weights do not depend on it.
    pub threads: usize,
}

/// Result of a training run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trained {
    /// Folder of the trained policy.
    pub policy: PathBuf,
    /// Preset of inputs and network size.
    pub preset: Preset,
    /// True if the policy reads simulator ground truth.
    pub privileged: bool,
    /// True if an auxiliary loss used simulator labels.
    pub labels: bool,
    /// Number of demonstrations trained on.
    pub demonstrations: usize,
    /// Number of rows (control steps) of all demonstrations.
    pub rows: usize,
    /// Number of samples processed, repetitions included.
    pub samples: u64,
    /// Number of optimiser steps.
    pub steps: u64,
    /// Number of trainable scalars of the network.
    pub parameters: usize,
    /// Mean L1 error of normalised actions after the last step, on training samples.
    pub final_l1: f64,
    /// SHA-256 of the weights, hexadecimal.
    pub tensors_sha256: String,
    /// Number of steps that an earlier call had finished; `None` if there was none.
    pub resumed_from: Option<u64>,
    /// Wall-clock time of the steps of this call, s.
    pub seconds: f64,
}

/// Options of [`super::demonstrate`].
#[derive(Clone, Debug)]
pub struct SuiteDemonstrations {
    /// Folder of the suite of task distributions.
    pub suite: PathBuf,
    /// Name of the only distribution to use; `None` for all, in turn.
    pub distribution: Option<String>,
    /// Number of verified demonstrations to collect.
    pub count: usize,
    /// Folder of the run to write.
    pub run: PathBuf,
    /// Number of threads; the demonstrations do not depend on it.
    pub workers: usize,
}

/// Options of [`super::check`].
#[derive(Clone, Debug)]
pub struct CheckOptions {
    /// Folder of the run with the demonstrations.
    pub run: PathBuf,
    /// Preset of inputs and network size.
    pub preset: Preset,
    /// Number of demonstrations to replay; all if there are fewer.
    pub demonstrations: usize,
    /// Number of cores to use.
    pub workers: usize,
}

/// Result of [`super::check`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Checked {
    /// Number of demonstrations replayed.
    pub demonstrations: usize,
    /// Success rate on the layouts of the demonstrations, when the recorded rows are executed like predictions of a
    /// learned policy.
    pub replay_success: Rate,
    /// Minimum success rate for the check to pass, 0 to 1.
    pub expected: f64,
}
