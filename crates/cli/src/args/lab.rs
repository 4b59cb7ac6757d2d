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
    /// Lay designed tasks out, once each, and audit what comes of it
    #[command(after_help = "Example:\n  genmanip lab layout --seed 2000 --count 1000 --json\n\n\
                      One thread; the audit (every edge, state and goal again, 2 s of physics with sleep off, \
                      visibility) is not timed.")]
    Layout(LabLayoutArguments),
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

/// Arguments of `lab layout`.
#[derive(Debug, Args)]
pub struct LabLayoutArguments {
    /// Seed of tasks and layouts
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Tasks to design and lay out; with --tasks: layouts of each
    #[arg(long, default_value_t = 100)]
    pub count: usize,
    /// Tasks instead of designed ones: recorded answers, task documents or folders of them
    #[arg(long, value_name = "PATH")]
    pub tasks: Vec<PathBuf>,
    /// Unmentioned objects to add to each scene
    #[arg(long, default_value_t = 0)]
    pub distractors: usize,
}
