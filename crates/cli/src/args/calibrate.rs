//! Arguments of `calibrate`.

use std::path::PathBuf;

use clap::builder::TypedValueParser;
use clap::{Args, Subcommand};
use genmanip_terminal::parse;

/// Arguments of `calibrate`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct CalibrateArguments {
    /// Subcommand
    #[command(subcommand)]
    pub command: Option<CalibrateCommand>,
    /// Robot states and detected corners of a board: docs/guides/calibrate-a-camera.md describes the file
    #[arg(value_name = "VIEWS.json", required = true)]
    pub views: Option<PathBuf>,
    /// World file that gets the camera, edited in place
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot of joint positions in the file"))]
    pub robot: Option<String>,
    /// Accuracy of the arm's positions, standard deviation per axis, mm
    #[arg(long, value_name = "MM", default_value_t = 0.1, value_parser = parse::number)]
    pub hand_mm: f64,
    /// Accuracy of its orientations, standard deviation about each axis, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 0.05, value_parser = parse::number)]
    pub hand_deg: f64,
}

/// Subcommands of `calibrate`.
#[derive(Debug, Subcommand)]
pub enum CalibrateCommand {
    /// Propose poses of the arm that are reachable, free and well-conditioned, and the accuracy to expect
    #[command(after_help = "Examples:\n  genmanip calibrate plan --camera wrist --board-at 0.5,0,0 --json\n  \
                      genmanip calibrate plan --world world.toml --camera static --board-at 0,0,0.1 --count 20\n\n\
                      --board-at is the middle of the board: on the table, in the robot's base, for a camera on the hand;\n\
                      in the frame of the hand for a camera beside the robot. Approximate poses are enough.")]
    Plan(CalibratePlanArguments),
}

/// Arguments of `calibrate plan`.
#[derive(Debug, Args)]
pub struct CalibratePlanArguments {
    /// World with the robot and an approximate pose of the camera: TOML or JSON [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Camera of the world
    #[arg(long, value_name = "NAME")]
    pub camera: String,
    /// Middle of the board, metres
    #[arg(long, value_name = "X,Y,Z", value_delimiter = ',', allow_hyphen_values = true, value_parser = parse::number,
          num_args = 1)]
    pub board_at: Vec<f64>,
    /// Corners in a row of the board
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u32).range(2..=100))]
    pub columns: u32,
    /// Rows of corners
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(2..=100))]
    pub rows: u32,
    /// Distance of neighbouring corners, metres
    #[arg(long, value_name = "M", default_value_t = 0.025, value_parser = parse::number)]
    pub spacing: f64,
    /// Poses
    #[arg(long, default_value_t = 18, value_parser = clap::value_parser!(u8).range(3..=100).map(usize::from))]
    pub count: usize,
}
