//! Arguments of `plan`.

use std::path::PathBuf;

use clap::Args;
use genmanip_terminal::{UrdfArguments, parse};

/// Arguments of `plan`.
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("goal").required(true))]
pub struct PlanArguments {
    /// Scenario file, as `layout` and `collect` write them; without one, the arm moves in the built-in world without
    /// objects
    #[arg(required_unless_present_any = ["robot", "world"])]
    pub scenario: Option<PathBuf>,
    /// World whose tables and walls the arm avoids: TOML or JSON [default without a scenario: the built-in one]
    #[arg(long, value_name = "FILE", conflicts_with = "scenario")]
    pub world: Option<PathBuf>,
    /// Goal: a grasp of this object, given by uid or name
    #[arg(long, value_name = "OBJECT", group = "goal")]
    pub pick: Option<String>,
    /// Goal: a point between the fingertips in the robot's base frame, metres, with the hand pointing down (for a URDF:
    /// z of the tool frame)
    #[arg(long, value_name = "X,Y,Z", group = "goal", value_delimiter = ',', allow_hyphen_values = true,
          value_parser = parse::number)]
    pub to: Option<Vec<f64>>,
    /// Goal: joint positions, rad
    #[arg(long, value_name = "Q1,…", group = "goal", value_delimiter = ',', allow_hyphen_values = true,
          value_parser = parse::number)]
    pub joints: Option<Vec<f64>>,
    /// Rotation of the hand about the vertical axis for --to, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_hyphen_values = true, value_parser = parse::number)]
    pub yaw: f64,
    /// Joint positions to start from, rad [default: the robot's home]
    #[arg(long, value_name = "Q1,…", value_delimiter = ',', allow_hyphen_values = true, value_parser = parse::number)]
    pub from: Option<Vec<f64>>,
    /// Opening of the gripper, metres; --pick opens it as the grasp needs [default: 0.08, or the largest opening if
    /// that is less]
    #[arg(long, value_name = "WIDTH", value_parser = parse::number)]
    pub gripper: Option<f64>,
    /// Seed of the search
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Maximum edge length of the RRT's search tree, rad [default: the planner's]
    #[arg(long, value_name = "RAD", value_parser = parse::edge)]
    pub rrt_range: Option<f64>,
    /// Draw the motion: the arm at several moments and the path of the hand, PNG or JPEG
    #[arg(long, alias = "image", value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// Record the motion as a video, MP4
    #[arg(long, value_name = "FILE")]
    pub animation: Option<PathBuf>,
    /// Camera of image and video, one of the scenario's [default: a view of the whole arm]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Name of the robot to plan for without a scenario, or URDF of any arm; a scenario laid out for another robot is
    /// refused
    #[arg(long, value_name = "NAME")]
    pub robot: Option<String>,
    /// Folders of the meshes of a URDF, and choices of its reader
    #[command(flatten)]
    pub urdf: UrdfArguments,
}
