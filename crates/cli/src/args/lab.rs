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
    /// Plan a file of motion problems, test every returned path again, and time planning, timing and kinematics
    #[command(after_help = "Examples:\n  genmanip lab motion --problems problems.json --json\n  \
                      genmanip lab motion --problems problems.json --robot panda/ --json\n\n\
                      A problem holds joint positions start and goal, and obstacles (box: size; cylinder: radius, \
                      length; pos and yaw) in the robot's base frame; --robot is a folder with a URDF, its meshes and \
                      SRDF.")]
    Motion(MotionArguments),
}

/// Arguments of `lab motion`.
#[derive(Debug, Args)]
pub struct MotionArguments {
    /// Problems: {"problems": [{"start", "goal", "obstacles"}]}
    #[arg(long, value_name = "FILE")]
    pub problems: PathBuf,
    /// Folder of another robot, or its URDF; without it, the built-in Panda
    #[arg(long, value_name = "DIR")]
    pub robot: Option<PathBuf>,
    /// Link of that robot that is the tool frame
    #[arg(long, value_name = "LINK", requires = "robot")]
    pub tip: Option<String>,
    /// Seed of the searches
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write the states of every path, 0.02 rad apart, to this JSON file
    #[arg(long, value_name = "FILE")]
    pub paths: Option<PathBuf>,
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
