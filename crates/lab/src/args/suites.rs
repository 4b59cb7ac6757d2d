//! Arguments of the measurements on suites and runs.

use std::path::PathBuf;

use clap::Args;
use genmanip_benchmark::suites;
use genmanip_terminal::parse;

/// Arguments of `genmanip-lab suite`.
#[derive(Debug, Args)]
pub struct LabSuiteArguments {
    /// Folder of the suite, or its name
    #[arg(long, value_name = "NAME|DIR", value_parser = suites::parse_folder)]
    pub suite: PathBuf,
    /// Number of episodes per scenario
    #[arg(long, value_name = "K", default_value_t = 5, value_parser = parse::count)]
    pub episodes: usize,
    /// Seed of the episodes
    #[arg(long, default_value_t = 1, value_parser = parse::seed)]
    pub seed: u64,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}

/// Arguments of `genmanip-lab readers`.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("about").required(true).args(["suite", "ends"])))]
#[command(group(clap::ArgGroup::new("do").required(true).args(["out", "answers"])))]
pub struct LabReadersArguments {
    /// Folder or name of a suite: readers identify the intended objects in its initial scenes
    #[arg(long, value_name = "NAME|DIR", value_parser = suites::parse_folder)]
    pub suite: Option<PathBuf>,
    /// Folder of evaluations with kept episodes: readers judge if their final scenes fulfil the instruction
    #[arg(long, value_name = "DIR")]
    pub ends: Option<PathBuf>,
    /// Number of episodes, half of them successes if possible
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = parse::count)]
    pub count: usize,
    /// Folder to write the cards to
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Answers of readers, one file each
    #[arg(long, value_name = "FILE,…", value_delimiter = ',')]
    pub answers: Vec<PathBuf>,
    /// Seed of the order of the cards, and of the choice of episodes
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
}

/// Arguments of `genmanip-lab scale`.
#[derive(Debug, Args)]
pub struct ScaleArguments {
    /// Folder of the run whose finished episodes are copied
    #[arg(long, value_name = "DIR")]
    pub run: PathBuf,
    /// Total number of copies
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub episodes: usize,
    /// Empty or new folder for the copies; about 0.5 MB per episode
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Arguments of `genmanip-lab studio`.
#[derive(Debug, Args)]
pub struct LabStudioArguments {
    /// World in which tasks are laid out: TOML or JSON [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Seed of tasks, layouts and operations
    #[arg(long, default_value_t = 1, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of random operations, by two authors
    #[arg(long, value_name = "N", default_value_t = 500)]
    pub operations: usize,
    /// Number of faults to plant
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub faults: usize,
    /// Number of sound scenarios to judge
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub sound: usize,
}
