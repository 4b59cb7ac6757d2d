//! Arguments of `collect` and `merge`.

use genmanip_terminal::parse;
use std::path::PathBuf;

use clap::Args;
use genmanip_viz::render::AppearanceFactor;
use genmanip_workspace::shard::ShardChoice;

use genmanip_core::ExpertStyle;

use super::parse_values::parse_rate;
use super::split::SplitArguments;

/// Property that may be randomised per episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Part of the appearance.
    Appearance(AppearanceFactor),
    /// Friction, mass, contact damping and joint friction.
    Physics,
}

/// Name of [`Part::Physics`].
const PHYSICS: &str = "physics";

/// A part by its name.
fn parse_part(text: &str) -> Result<Part, String> {
    if text == PHYSICS {
        return Ok(Part::Physics);
    }
    super::render::parse_vary(text).map(Part::Appearance).map_err(|expected| format!("{expected}, {PHYSICS}"))
}

/// Arguments of `collect`.
#[derive(Clone, Debug, Args)]
pub struct CollectArguments {
    /// Tasks: task documents, recorded answers of language models, folders of them, or lists with a task document per
    /// line (*.jsonl)
    #[arg(required_unless_present = "suite")]
    pub tasks: Vec<PathBuf>,
    /// Suite of task distributions (folder or name) whose layouts are demonstrated, instead of tasks
    #[arg(long, value_name = "NAME|DIR", conflicts_with_all = ["tasks", "seed"], value_parser = genmanip_benchmark::suites::parse_folder)]
    pub suite: Option<PathBuf>,
    #[command(flatten)]
    pub layouts: SplitArguments,
    /// Folder of the run
    #[arg(long)]
    pub out: PathBuf,
    /// Number of attempts per task, each on its own layout [default: 2; with --suite: 1, on the frozen layout]
    #[arg(long, value_parser = parse::count)]
    pub episodes: Option<usize>,
    /// Instead of a number of attempts: make attempts of all tasks in turn until exactly N are verified. A larger N
    /// extends the run
    #[arg(long, value_name = "N", value_parser = parse::count, conflicts_with_all = ["episodes", "shard", "keep_failed"])]
    pub verified: Option<usize>,
    /// World in which layouts are made: TOML or JSON, see `genmanip world init` [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Robot instead of the world's
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot instead of the world's"))]
    pub robot: Option<String>,
    /// Seed of layouts, motion planning and randomisation
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Worker threads; results do not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
    /// Rate of images and dataset rows, Hz: 10, 15, 20, 30 or 60; states are always recorded at 60 Hz
    #[arg(long, alias = "fps", value_name = "HZ", default_value_t = 15, value_parser = parse_rate)]
    pub rate: u32,
    /// Cameras of the world whose images are rendered and exported
    #[arg(
        long,
        value_name = "NAME,…",
        value_delimiter = ',',
        default_value = "static,wrist",
        conflicts_with = "no_dataset"
    )]
    pub cameras: Vec<String>,
    /// Record episodes only: no images, no dataset
    #[arg(long)]
    pub no_dataset: bool,
    /// Randomise each episode (--vary says what); its seed is the column `variation_seed` of the dataset
    #[arg(long, value_parser = ["per-episode"])]
    pub variation: Option<String>,
    #[arg(
        long,
        value_name = "PART,…",
        value_delimiter = ',',
        value_parser = parse_part,
        requires = "variation",
        help = format!("What differs: {}, {PHYSICS} [default: all but {PHYSICS}]", super::render::looks())
    )]
    pub vary: Vec<Part>,
    /// Grasp source of the expert: `mesh` (the objects' geometry), `rgbd` (depth images of the fixed cameras), or a
    /// server that receives the point cloud
    #[arg(long, value_name = "mesh|rgbd|http:URL", default_value = "mesh")]
    pub grasps: String,
    /// Choices of the expert where several solve the task: `consistent` takes the grasp nearest to the gripper's
    /// orientation and the goal pose nearest to the middle, so that a policy can predict them
    #[arg(long, value_name = "STYLE", default_value = "default", value_parser = parse::variant(ExpertStyle::ALL, ExpertStyle::name))]
    pub expert: ExpertStyle,
    /// Skill file, or folder of them, with which the expert carries out the changes of state that it serves (same kind
    /// of manipulation and joint) instead of its own motions; may be repeated
    #[arg(long, value_name = "FILE|FOLDER", conflicts_with = "corrections")]
    pub skill: Vec<PathBuf>,
    /// Put failed attempts into the dataset too, labelled as such
    #[arg(long)]
    pub keep_failed: bool,
    /// Policy that acts first in each attempt, until it fails and the expert takes over; the column `is_correction`
    /// tells their rows apart. As `evaluate --policy`, such as openpi:url=…; without a name `clumsy`, which misses,
    /// drops or stops
    #[arg(long, value_name = "POLICY", num_args = 0..=1, require_equals = true, default_missing_value = "clumsy")]
    pub corrections: Option<String>,
    /// Make every attempt of --corrections, even after three in a row that were not run because of an error of the
    /// policy
    #[arg(long, requires = "corrections")]
    pub keep_going: bool,
    /// Move damaged episodes to damaged/ in the run, and collect them again
    #[arg(long)]
    pub repair: bool,
    /// Only the I-th of N parts, counted from 0, into a folder of its own in OUT; `auto` or `auto/N`: the number of the
    /// task in a job array of Slurm or Kubernetes. `genmanip merge` combines the parts
    #[arg(long, value_name = "I/N")]
    pub shard: Option<ShardChoice>,
    /// Print a row per task even if there are more than 30
    #[arg(long)]
    pub each: bool,
}

/// Arguments of `merge`.
#[derive(Clone, Debug, Args)]
pub struct MergeArguments {
    /// Folders of shards, or folders that hold them
    #[arg(required = true, value_name = "SHARD")]
    pub shards: Vec<PathBuf>,
    /// Folder to write the merged run to
    #[arg(long)]
    pub out: PathBuf,
    /// Make the attempts that are missing from the shards on this machine
    #[arg(long)]
    pub finish: bool,
    /// Worker threads of --finish; results do not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
    /// Print a row per task even if there are more than 30
    #[arg(long)]
    pub each: bool,
}
