//! Arguments of `train`.

use std::path::PathBuf;

use clap::Args;
use genmanip_pipeline::learn::Preset;
use genmanip_terminal::parse;

/// Arguments of `train`.
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("length").required(true).args(["steps", "budget", "check"]))]
pub struct TrainArguments {
    /// Folder of a run made by `collect`, whose verified episodes are learned from; or a suite of task distributions,
    /// folder or name, of whose split `train` --demos demonstrations are collected first
    #[arg(value_name = "RUN|SUITE", value_parser = genmanip_benchmark::suites::parse_folder)]
    pub source: PathBuf,
    /// Demonstrations of a suite; those that are missing are collected into DIR-demonstrations, with `--expert
    /// consistent`
    #[arg(long, value_name = "N", value_parser = parse::count, conflicts_with = "check")]
    pub demos: Option<usize>,
    /// Only this distribution of a suite
    #[arg(long, value_name = "NAME", requires = "demos")]
    pub distribution: Option<String>,
    /// Inputs and sizes: `state` sees the poses of the objects as the simulator knows them (privileged), no images;
    /// `tiny` sees two cameras and reads the instruction
    #[arg(long, value_name = "PRESET", value_parser = parse::variant(Preset::ALL, Preset::name))]
    pub preset: Preset,
    /// Number of steps
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub steps: Option<usize>,
    /// Time instead of a number of steps, such as 90s, 30m or 2h; it becomes a number of steps once, after the first 50
    #[arg(long, value_name = "TIME", value_parser = parse::time)]
    pub budget: Option<u64>,
    /// Train nothing: replay recorded rows on the way of a learned policy's output, which must solve 95 % of their
    /// layouts
    #[arg(long, conflicts_with_all = ["seed", "out"])]
    pub check: bool,
    /// Demonstrations that --check replays, at most
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = parse::count, requires = "check")]
    pub count: usize,
    /// Seed of initial weights and samples
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Train without simulator labels: `tiny` otherwise also learns to predict where the goal's objects are
    #[arg(long, conflicts_with = "check")]
    pub no_labels: bool,
    /// Folder of the policy
    #[arg(long, value_name = "DIR", required_unless_present = "check")]
    pub out: Option<PathBuf>,
    /// Worker threads; results do not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}
