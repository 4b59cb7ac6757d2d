//! What the user may type after `lab`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// Measurements that take data the project has not seen.
#[derive(Debug, Subcommand)]
pub enum LabCommand {
    /// Compare a compatibility profile with recorded verdicts of the evaluator it reproduces
    #[command(after_help = "Example:\n  genmanip lab relations --cases cases.json --profile genmanip-0.9 --json\n\n\
                      The clouds are read from the archive beside the file: cases.npz.")]
    Relations(RelationsArguments),
    /// Try grasps from points in physics: lift, shake, hold
    #[command(after_help = "Example:\n  genmanip lab grasp --seed 2000 --count 100 --view one --json\n\n\
                      Things of three classes (compact, utensils, clutter), COUNT each, drawn by seed;\n\
                      docs/concepts/grasps.md says what is measured.")]
    Grasp(GraspArguments),
    /// Let the expert (oracle) try tasks, each on fresh layouts until an attempt is verified
    #[command(after_help = "Example:\n  genmanip lab expert --seed 2000 --count 60 --json\n\n\
                      One thread; processor time covers layout, planning, physics and checks.")]
    Expert(ExpertArguments),
    /// Let the rule-based designer compose tasks and judge them: validity, variety, quotas, references
    #[command(after_help = "Example:\n  genmanip lab design --seed 7 --count 2000 --json")]
    Design(DesignArguments),
}

/// Arguments of `lab design`.
#[derive(Debug, Args)]
pub struct DesignArguments {
    /// Seed
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Tasks, the six kinds in turn
    #[arg(long, default_value_t = 300, value_parser = super::parse_count)]
    pub count: usize,
}

/// Arguments of `lab grasp`.
#[derive(Debug, Args)]
pub struct GraspArguments {
    /// Seed of things, views and noise
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Trials per class
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub count: u64,
    /// Cloud of the target: full surface, one noisy view, or three fused ones
    #[arg(long, default_value = "full", value_parser = ["full", "one", "three"])]
    pub view: String,
    /// Class to try, all without
    #[arg(long, value_parser = ["compact", "utensils", "clutter"])]
    pub class: Option<String>,
    /// Candidate to carry out: the best, or any, for judging the scores
    #[arg(long, default_value = "best", value_parser = ["best", "any"])]
    pub pick: String,
    /// File for one line of JSON per trial
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Arguments of `lab relations`.
#[derive(Debug, Args)]
pub struct RelationsArguments {
    /// Recorded cases; the archive of clouds beside it has the ending .npz
    #[arg(long, value_name = "FILE")]
    pub cases: PathBuf,
    /// Evaluator: genmanip-0.9 or suite-0.2.3
    #[arg(long)]
    pub profile: String,
}

/// Arguments of `lab expert`.
#[derive(Debug, Args)]
pub struct ExpertArguments {
    /// Seed of tasks, layouts and attempts
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Tasks of the rule-based designer, the six kinds in turn
    #[arg(long, default_value_t = 60, value_parser = super::parse_count)]
    pub count: usize,
    /// Attempts at a task before it counts as not solved
    #[arg(long, default_value_t = 5)]
    pub tries: u64,
    /// Tasks of your own instead of designed ones: files or folders
    #[arg(long, value_name = "PATH")]
    pub tasks: Vec<PathBuf>,
}
