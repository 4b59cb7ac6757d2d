//! Arguments of `agent` and `ablate`.

use genmanip_terminal::parse;
use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::evaluate::AskingArguments;

/// Subcommands of `agent`.
#[derive(Debug, Subcommand)]
pub enum AgentCommand {
    /// Plan one pick and one placement from an image; nothing moves
    #[command(
        override_usage = "genmanip agent act --rgb FILE --depth FILE --camera FILE --joints Q1,Q2,… \\\n         \
                                --instruction TEXT --vlm FILE --out DIR [OPTIONS]"
    )]
    #[command(after_help = "Example:\n  \
                      genmanip agent act --rgb rgb.png --depth depth.png --camera camera.json \\\n    \
                      --joints 0,-0.785,0,-2.356,0,1.571,0.785 --instruction \"Put the cup on the plate.\" \\\n    \
                      --vlm model.toml --out out/act\n\n\
                      Depth is 16-bit grey, millimetres; the camera is {\"intrinsics\": {…}, \"world_from_camera\": {…}}\n\
                      in the frame of the robot's base. The folder gets a picture of each stage,\n\
                      transcript.json and motions.json.")]
    Act(ActArguments),
}

/// Arguments of `agent act`.
#[derive(Debug, Args)]
pub struct ActArguments {
    /// Colour image: PNG with 8 bits per channel
    #[arg(long, value_name = "FILE")]
    pub rgb: PathBuf,
    /// Depth image: grey PNG with 16 bits, millimetres along the optical axis, 0 where nothing was measured
    #[arg(long, value_name = "FILE")]
    pub depth: PathBuf,
    /// Intrinsics of the camera and its pose in the frame of the robot's base: JSON
    #[arg(long, value_name = "FILE")]
    pub camera: PathBuf,
    /// Current joint positions of the arm from base to tool, rad
    #[arg(long, value_delimiter = ',', value_name = "Q1,Q2,…", allow_hyphen_values = true, required = true)]
    pub joints: Vec<f64>,
    /// Current opening width of the gripper, m
    #[arg(long, value_name = "M", default_value_t = 0.08)]
    pub gripper: f64,
    /// Task instruction in natural language
    #[arg(long, value_name = "TEXT")]
    pub instruction: String,
    /// Settings file of the vision-language model (TOML), see docs/guides/agent.md
    #[arg(long, value_name = "FILE")]
    pub vlm: String,
    /// Segmentation source: `rgbd` (built in, from colour and depth) or a server
    #[arg(long, default_value = "rgbd", value_name = "rgbd|http:URL")]
    pub masks: String,
    /// Grasp source: `rgbd` (built in, from the object's points) or a server
    #[arg(long, default_value = "rgbd", value_name = "rgbd|http:URL")]
    pub grasps: String,
    /// Standard deviation of measured depth at a distance of 1 m, m: 0.0036 for a RealSense D435, 0 for perfect depth
    #[arg(long, value_name = "M", default_value_t = 0.0)]
    pub depth_error: f64,
    /// Form of the model's answer for a placement: one grid cell (`p2p`), or a path over the grid with heights and
    /// rotations (`grid`)
    #[arg(long, default_value = "p2p", value_parser = ["p2p", "grid"])]
    pub path: String,
    /// Seed of grasp search and motion planning
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Output folder for the images of each stage, the transcript and the motions
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Arguments of `ablate`.
#[derive(Debug, Args)]
pub struct AblateArguments {
    /// Folder of a run made by `collect`
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Baseline agent, to compare with: arguments of the policy `agent`, see `genmanip evaluate --help`
    #[arg(long, value_name = "KEY=VALUE,…", default_value = "vlm=oracle,masks=rgbd")]
    pub agent: String,
    /// Settings to change, one at a time: ctof, path, loop, reasoning, camera, preset [default: all]
    #[arg(long, value_delimiter = ',', value_name = "SETTING")]
    pub vary: Vec<String>,
    #[command(flatten)]
    pub asking: AskingArguments,
}
