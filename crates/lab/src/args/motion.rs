//! Arguments of `genmanip-lab strangers`, `motion` and `calibrate`.

use std::path::PathBuf;

use clap::Args;
use genmanip_terminal::{UrdfArguments, parse};

/// Arguments of `genmanip-lab strangers`.
#[derive(Debug, Args)]
pub struct StrangersArguments {
    /// Folder with robots, objects and datasets of other people, at any depth
    pub folder: PathBuf,
    /// Kinds of files to try [default: all]
    #[arg(long, value_delimiter = ',', value_parser = genmanip_lab::strangers::KINDS)]
    pub kinds: Vec<String>,
    /// Number of random motions planned for each arm; 0 to only read the files
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
    /// File of motion problems, JSON: {"problems": [{"start", "goal", "obstacles"}]}
    #[arg(long, value_name = "FILE", required_unless_present = "generate")]
    pub problems: Option<PathBuf>,
    /// Generate problems instead: picking and placing on a table; hard ones have a shelf and taller objects
    #[arg(long, value_parser = ["easy", "hard"], conflicts_with = "problems")]
    pub generate: Option<String>,
    /// Number of problems to generate [default: 100], or to take from the beginning of the file [default: all]
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
    /// Maximum edge length of the RRT's search tree, rad [default: the planner's]
    #[arg(long, value_name = "RAD", value_parser = parse::edge)]
    pub rrt_range: Option<f64>,
    /// Number of poses for inverse kinematics; arms without closed-form inverse kinematics use one in 200
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = parse::count)]
    pub ik_poses: usize,
    /// JSON file to write the states of every path to, at most 0.02 rad per joint apart
    #[arg(long, value_name = "FILE")]
    pub paths: Option<PathBuf>,
}

/// Examples and conditions of `genmanip-lab bridge`.
pub(super) const BRIDGE_HELP: &str = "Examples:\n  genmanip-lab bridge --seed 7 --count 10000 --json\n  \
    genmanip-lab bridge --count 0 --suite suites/genmanip-200-rc --scenes 50 --policy expert\n  \
    genmanip-lab bridge --count 0 --robot tcp://127.0.0.1:4757 --motions 20 --drills free\n\n\
    The simulated connection has 20 +- 10 ms of delay and loses 1 % of the commands and states.";

/// Arguments of `genmanip-lab bridge`.
#[derive(Debug, Args)]
pub struct BridgeArguments {
    /// Seed of the streams
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of streams
    #[arg(long, default_value_t = 1000)]
    pub count: usize,
    /// Suite, run or scenario whose scenes are run behind the bridge and directly
    #[arg(long, value_name = "PATH", requires = "policies")]
    pub suite: Option<PathBuf>,
    /// Number of scenes
    #[arg(long, default_value_t = 20, value_parser = parse::count)]
    pub scenes: usize,
    /// A policy for them; may be given several times
    #[arg(long = "policy", value_name = "NAME[:KEY=VALUE,…]", requires = "suite")]
    pub policies: Vec<String>,
    /// Judge the ends of these episodes by depth images, too, as `real run --judge points`
    #[arg(long, requires = "suite")]
    pub points: bool,
    /// Number of episodes per action space of a policy whose chunks of actions come after 80 ms
    #[arg(long, default_value_t = 3)]
    pub chunks: usize,
    /// Address of a running bridge, to which planned motions are streamed
    #[arg(long, value_name = "URL")]
    pub robot: Option<String>,
    /// Number of motions
    #[arg(long, default_value_t = 20)]
    pub motions: usize,
    /// Drills on it: starts and resumes, and the gripper; or the gripper and a collision with a post between its fingers
    #[arg(long, value_name = "WHERE", value_parser = ["free", "post"], requires = "robot")]
    pub drills: Option<String>,
}

/// Examples and conditions of `genmanip-lab identify`.
pub(super) const IDENTIFY_HELP: &str = "Example:\n  genmanip-lab identify --seed 7 --count 200 --json\n\n\
    A quarter of the hidden arms has an effect that the model lacks: backlash, Stribeck friction or\n\
    another time step. Joint sensors have noise of 0.02 to 0.2 mrad and steps of 0.01 to 0.1 mrad.";

/// Arguments of `genmanip-lab identify`.
#[derive(Debug, Args)]
pub struct LabIdentifyArguments {
    /// Seed of hidden arms, motions and noise
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of hidden arms
    #[arg(long, default_value_t = 20, value_parser = parse::count)]
    pub count: usize,
    /// Number of the first hidden arm, to measure a series in parts
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub first: usize,
}

/// Arguments of `genmanip-lab calibrate`.
#[derive(Debug, Args)]
pub struct LabCalibrateArguments {
    /// Seed of setups, views and noise
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of sets of each mounting and noise, and number of degenerate sets
    #[arg(long, default_value_t = 50, value_parser = parse::count)]
    pub count: usize,
    /// Number of sets of each mounting and noise from rendered images of a board, about 2 s each; if above 0, the
    /// detector is also run on 100 images without a board
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub rendered: usize,
    /// Folder to write all sound sets to, rendered images included, in the format of `genmanip calibrate`, with their
    /// true poses
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Examples and conditions of `genmanip-lab match`.
pub(super) const MATCH_HELP: &str = "Examples:\n  genmanip-lab match --seed 7 --count 30 --json\n  \
    genmanip-lab match --count 3 --out images\n\n\
    One thread. Of ten worlds, two hold nothing that throws a shadow, one of them without a colour chart;\n\
    every fifth is path-traced, with a tone curve that the matched response cannot have.";

/// Arguments of `genmanip-lab match`.
#[derive(Debug, Args)]
pub struct LabMatchArguments {
    /// Seed of the hidden worlds
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of hidden worlds; every fifth is path-traced, which takes most of the time
    #[arg(long, default_value_t = 30, value_parser = parse::count)]
    pub count: usize,
    /// Folder for images of the held-out views: truth, default world, matched world
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
