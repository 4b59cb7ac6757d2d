//! Arguments of the measurements of masks and grasps.

use genmanip_terminal::parse;
use std::path::PathBuf;

use clap::Args;

/// Arguments of `genmanip-lab segment`.
#[derive(Debug, Args)]
pub struct SegmentArguments {
    /// Seed of tasks, layouts and noise
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of scenes, each seen by two cameras; with --extents by three
    #[arg(long, default_value_t = 40, value_parser = parse::count)]
    pub count: usize,
    /// Depth camera whose noise is simulated [default: exact depth]
    #[arg(long, value_parser = ["d435"])]
    pub noise: Option<String>,
    /// Source of the masks: `rgbd` (built in, from colour and depth), `oracle` (the renderer's ground truth) or a
    /// server
    #[arg(long, default_value = "rgbd", value_name = "rgbd|oracle|http:URL")]
    pub masks: String,
    /// Locate the objects from the depth of the agent's three cameras, and compare centres and sizes with the truth
    #[arg(long, conflicts_with_all = ["fit", "out"])]
    pub extents: bool,
    /// Fit the weights of region merging to these scenes instead of measuring
    #[arg(long, conflicts_with_all = ["masks", "out"])]
    pub fit: bool,
    /// Folder to write images of the 24 worst views to: input, ground truth, masks
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `genmanip-lab grasp`.
#[derive(Debug, Args)]
pub struct GraspArguments {
    /// Seed of objects, views and noise
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of trials per class
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub count: u64,
    /// Point cloud of the target: the full surface, one noisy view, or three fused ones
    #[arg(long, default_value = "full", value_parser = ["full", "one", "three"])]
    pub view: String,
    /// Class of objects to try [default: all]
    #[arg(long, value_parser = ["compact", "utensils", "clutter"])]
    pub class: Option<String>,
    /// Source of the grasps: the sampler, or a detector behind a service, which gets clouds in the camera's frame
    #[arg(long, default_value = "rgbd", value_name = "rgbd|http:URL")]
    pub grasps: String,
    /// Candidate to execute: the best feasible one, or any feasible one at random to test the calibration
    #[arg(long, default_value = "best", value_parser = ["best", "any"])]
    pub pick: String,
    /// File to write one line of JSON per trial to
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}
