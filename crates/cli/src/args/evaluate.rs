//! Arguments of `evaluate`, and those it shares with other verbs that may ask a model.

use genmanip_terminal::parse;
use std::path::PathBuf;

use clap::Args;
use genmanip_workspace::shard::ShardChoice;

use super::parse_values::{parse_sum, parse_yes};
use super::split::SplitArguments;

/// Settings of episodes whose policy may query a model.
#[derive(Clone, Debug, Args)]
pub struct AskingArguments {
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
    /// Maximum number of episodes in progress at the same time; an episode that waits for a model needs no core
    /// [default: at least 16 if a model is asked, else the number of workers]
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub at_once: Option<usize>,
    /// Stop asking the model once its answers have cost this much, in the currency of its settings
    #[arg(long, value_name = "SUM", value_parser = parse_sum)]
    pub max_cost: Option<f64>,
    /// Try every episode, even after three in a row that were not run because the policy raised an error or did not
    /// answer
    #[arg(long)]
    pub keep_going: bool,
}

/// Arguments of `evaluate`.
#[derive(Clone, Debug, Args)]
pub struct EvaluateArguments {
    /// Folder of a run made by `collect`, or scenario files and folders of them
    #[arg(required_unless_present = "suite", value_name = "RUN|SCENARIOS")]
    pub paths: Vec<PathBuf>,
    /// Folder of a frozen suite, or its name, instead of a run or scenarios
    #[arg(long, value_name = "NAME|DIR", conflicts_with = "paths", value_parser = genmanip_benchmark::suites::parse_folder)]
    pub suite: Option<PathBuf>,
    #[command(flatten)]
    pub layouts: SplitArguments,
    /// A policy, with arguments if it takes any; may be given several times [default: expert and do_nothing, on a
    /// run also replay]
    #[arg(long = "policy", value_name = "NAME[:KEY=VALUE,…]")]
    pub policies: Vec<String>,
    /// Folder for the results and episodes of scenarios; a run keeps its own
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Store the episodes in the run, so that `replay` can show them
    #[arg(long)]
    pub keep_episodes: bool,
    /// Cameras to use instead of the scenarios': a JSON list; the results say so
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// Number of episodes of each scenario, each with its own random stream: for policies that sample
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = parse::count)]
    pub episodes_per_scenario: usize,
    /// Time limit of every episode, simulated seconds, instead of the scenarios'; the results and their label say so
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub horizon: Option<f64>,
    /// End an episode once its goal has held for a second, with nothing held or moving; it is judged after settling as
    /// usual [default: yes for policies that never say that they are finished, else no]
    #[arg(long, value_name = "yes|no", num_args = 0..=1, require_equals = true, default_missing_value = "yes",
          value_parser = parse_yes)]
    pub stop_on_success: Option<bool>,
    /// Only the I-th of N parts of the episodes, counted from 0; `auto` or `auto/N`: the number of the task in a job
    /// array of Slurm or Kubernetes. The same call without --shard combines the results of the parts
    #[arg(long, value_name = "I/N")]
    pub shard: Option<ShardChoice>,
    /// End an episode at the first action that the arm cannot reach, instead of holding the last command and counting
    /// it
    #[arg(long)]
    pub stop_on_unreachable: bool,
    #[command(flatten)]
    pub asking: AskingArguments,
    /// Refuse scenarios that were laid out for another robot than this
    #[arg(long, value_name = "NAME")]
    pub robot: Option<String>,
}

/// Arguments of `compare`.
#[derive(Clone, Debug, Args)]
pub struct CompareArguments {
    /// Evaluation of the first policy
    #[arg(value_name = "A.json")]
    pub first: PathBuf,
    /// Evaluation of the second policy on the same scenarios
    #[arg(value_name = "B.json")]
    pub second: PathBuf,
}

/// Arguments of `sim2real`.
#[derive(Clone, Debug, Args)]
pub struct SimToRealArguments {
    /// Table of results in simulation and reality: CSV with a header row; docs/guides/sim-against-real.md
    /// names its columns
    #[arg(value_name = "TABLE.csv")]
    pub table: PathBuf,
    /// Also write a scatter plot of the policies as SVG: results in simulation on the x axis, in reality on the y axis
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// Seed of the bootstrap
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
}

/// Arguments of `leaderboard`.
#[derive(Clone, Debug, Args)]
pub struct LeaderboardArguments {
    /// Folder with evaluations, or with runs that hold some
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Also write an HTML page to this file
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
}
