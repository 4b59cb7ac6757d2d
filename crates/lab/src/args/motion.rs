//! Arguments of the measurement of the planner.

use std::path::PathBuf;

use clap::Args;
use genmanip_terminal::parse;

/// Arguments of `genmanip-lab motion`.
#[derive(Debug, Args)]
pub struct MotionArguments {
    /// Problems: {"problems": [{"start", "goal", "obstacles"}]}
    #[arg(long, value_name = "FILE", required_unless_present = "generate")]
    pub problems: Option<PathBuf>,
    /// Make problems instead: picking and placing on a table, hard ones with a shelf and taller things
    #[arg(long, value_parser = ["easy", "hard"], conflicts_with = "problems")]
    pub generate: Option<String>,
    /// Problems to make, 100 without it; or how many of the file are planned, from its first on, all without it
    #[arg(long, value_parser = parse::count)]
    pub count: Option<usize>,
    /// Also write the problems that were made to this file
    #[arg(long, value_name = "FILE", requires = "generate")]
    pub out: Option<PathBuf>,
    /// Folder of another robot, or its URDF; without it, the built-in Panda
    #[arg(long, value_name = "DIR")]
    pub robot: Option<PathBuf>,
    /// Link of that robot that is the tool frame
    #[arg(long, value_name = "LINK", requires = "robot")]
    pub tip: Option<String>,
    /// Seed of the searches, and of the problems that are made
    #[arg(long, default_value_t = 1, value_parser = parse::seed)]
    pub seed: u64,
    /// Longest edge of the search tree, rad; without it, the planner's own
    #[arg(long, value_name = "RAD", value_parser = parse::edge)]
    pub rrt_range: Option<f64>,
    /// Poses at which the inverse kinematics are measured; a numeric arm gets one for 200 of them
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = parse::count)]
    pub ik_poses: usize,
    /// Write the states of every path, 0.02 rad apart, to this JSON file
    #[arg(long, value_name = "FILE")]
    pub paths: Option<PathBuf>,
}
