//! Arguments of `genmanip-lab motion`.

use std::path::PathBuf;

use clap::Args;
use genmanip_terminal::{UrdfArguments, parse};

/// Arguments of `genmanip-lab strangers`.
#[derive(Debug, Args)]
pub struct StrangersArguments {
    /// Folder with robots, objects and datasets of other people, at any depth
    pub folder: PathBuf,
    /// Kinds to try [default: all]
    #[arg(long, value_delimiter = ',', value_parser = genmanip_lab::strangers::KINDS)]
    pub kinds: Vec<String>,
    /// Random motions planned for each arm; 0 reads only
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub pairs: usize,
    /// Folders of the meshes of robots, and choices of the reader
    #[command(flatten)]
    pub urdf: UrdfArguments,
    /// Seed of the motions
    #[arg(long, default_value_t = 1, value_parser = parse::seed)]
    pub seed: u64,
}

/// Arguments of `genmanip-lab motion`.
#[derive(Debug, Args)]
pub struct MotionArguments {
    /// Problems: {"problems": [{"start", "goal", "obstacles"}]}
    #[arg(long, value_name = "FILE", required_unless_present = "generate")]
    pub problems: Option<PathBuf>,
    /// Generate problems instead: picking and placing on a table; hard ones have a shelf and taller objects
    #[arg(long, value_parser = ["easy", "hard"], conflicts_with = "problems")]
    pub generate: Option<String>,
    /// Problems to generate [default: 100], or to plan from the front of the file [default: all]
    #[arg(long, value_parser = parse::count)]
    pub count: Option<usize>,
    /// Also write the generated problems to this file
    #[arg(long, value_name = "FILE", requires = "generate")]
    pub out: Option<PathBuf>,
    /// Folder of another robot, or its URDF [default: the built-in Panda]
    #[arg(long, value_name = "DIR")]
    pub robot: Option<PathBuf>,
    /// Folders of the meshes of that robot, and choices of the reader
    #[command(flatten)]
    pub urdf: UrdfArguments,
    /// Seed of the searches and of generated problems
    #[arg(long, default_value_t = 1, value_parser = parse::seed)]
    pub seed: u64,
    /// Longest edge of the search tree, rad [default: the planner's]
    #[arg(long, value_name = "RAD", value_parser = parse::edge)]
    pub rrt_range: Option<f64>,
    /// Poses for inverse kinematics; a numeric arm uses one in 200
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = parse::count)]
    pub ik_poses: usize,
    /// Write the states of every path, 0.02 rad apart, to this JSON file
    #[arg(long, value_name = "FILE")]
    pub paths: Option<PathBuf>,
}

/// Arguments of `genmanip-lab calibrate`.
#[derive(Debug, Args)]
pub struct LabCalibrateArguments {
    /// Seed
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Sets of each mounting and noise
    #[arg(long, default_value_t = 50, value_parser = parse::count)]
    pub count: usize,
    /// Sets of each from rendered images of a board, 2 s each; with any, also 100 images without a board
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub rendered: usize,
    /// Folder for all sound sets, rendered images included, as `genmanip calibrate` reads them, with their true poses
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
