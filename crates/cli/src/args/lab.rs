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
    /// Let the expert (oracle) try tasks, each on fresh layouts until an attempt is verified
    #[command(after_help = "Example:\n  genmanip lab expert --tasks examples/tasks --seed 2000 --json\n\n\
                      One thread; processor time covers layout, planning, physics and checks.")]
    Expert(ExpertArguments),
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
    /// Attempts at a task before it counts as not solved
    #[arg(long, default_value_t = 5)]
    pub tries: u64,
    /// Tasks: recorded answers, task documents or folders of them
    #[arg(long, value_name = "PATH", required = true)]
    pub tasks: Vec<PathBuf>,
}
