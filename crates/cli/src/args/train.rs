//! Command-line arguments of `genmanip train`, which trains a policy on demonstrations.

use std::path::PathBuf;

use clap::Args;
use genmanip_pipeline::learn::{Head, Preset};
use genmanip_terminal::parse;

use super::sources::SourceArguments;

/// Source, length and output of a training; one of `--steps`, `--budget` and `--check` is required.
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("length").required(true).args(["steps", "budget", "check"]))]
pub struct TrainArguments {
    /// Run made by `collect` (folder), to train on its verified episodes; or suite of task distributions (folder or
    /// name): first collects as many demonstrations as --demos says, from the suite's split `train`
    #[arg(value_name = "RUN|SUITE", value_parser = genmanip_benchmark::suites::parse_folder)]
    pub source: PathBuf,
    /// Number of verified demonstrations of the suite, over all its distributions; missing ones are collected into the
    /// folder DIR-demonstrations (DIR: --out), as by `collect --expert consistent`
    #[arg(long, value_name = "N", value_parser = parse::count, conflicts_with_all = ["check", "sources"])]
    pub demos: Option<usize>,
    #[command(flatten)]
    pub sources: SourceArguments,
    /// Only this distribution of a suite
    #[arg(long, value_name = "NAME", requires = "demos")]
    pub distribution: Option<String>,
    /// Inputs and sizes: `state` sees the poses of the objects as the simulator knows them (privileged), no images;
    /// `tiny` sees two cameras and reads the instruction; `act` sees the same through a residual network, as ACT, and
    /// needs no simulator labels
    #[arg(long, value_name = "PRESET", value_parser = parse::variant(Preset::ALL, Preset::name))]
    pub preset: Preset,
    /// Output of the network: `l1` predicts one chunk of actions, the median of the demonstrations; `flow` draws one
    /// from their distribution (conditional flow matching), for demonstrations that do the same thing in several ways
    #[arg(long, value_name = "HEAD", default_value = Head::L1.name(), conflicts_with = "check",
          value_parser = parse::variant(Head::ALL, Head::name))]
    pub head: Head,
    /// Number of optimiser steps
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub steps: Option<usize>,
    /// Wall-clock time instead of a number of steps, such as 90s, 30m or 2h; after 50 steps their speed converts it to
    /// a fixed number of steps, which a resumed training keeps
    #[arg(long, value_name = "TIME", value_parser = parse::time)]
    pub budget: Option<u64>,
    /// Train nothing: execute recorded actions as if a learned policy had predicted them (normalisation, chunks, action
    /// contract), and fail unless that solves 95 % of their layouts
    #[arg(long, conflicts_with_all = ["seed", "out", "sources"])]
    pub check: bool,
    /// Maximum number of demonstrations that --check replays
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = parse::count, requires = "check")]
    pub count: usize,
    /// Seed of initial weights and samples
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Train without simulator labels: `tiny` otherwise also learns to predict where the goal's objects are
    #[arg(long, conflicts_with = "check")]
    pub no_labels: bool,
    /// Folder to write the policy to
    #[arg(long, value_name = "DIR", required_unless_present = "check")]
    pub out: Option<PathBuf>,
    /// Worker threads; results do not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}
