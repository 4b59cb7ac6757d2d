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
    /// File of robot states with detected corners, or with the names of images beside it; or a folder with such a file,
    /// views.json. Its format: docs/guides/calibrate-a-camera.md
    #[arg(value_name = "VIEWS", required = true)]
    pub views: Option<PathBuf>,
    /// World file that gets the camera, edited in place
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot of joint positions in the file"))]
    pub robot: Option<String>,
    /// Accuracy of the arm's positions, standard deviation per axis, mm
    #[arg(long, value_name = "MM", default_value_t = 0.1, value_parser = parse::number)]
    pub hand_mm: f64,
    /// Accuracy of the arm's orientations, standard deviation about each axis, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 0.05, value_parser = parse::number)]
    pub hand_deg: f64,
}

/// Subcommands of `calibrate`.
#[derive(Debug, Subcommand)]
pub enum CalibrateCommand {
    /// Propose reachable, collision-free and well-conditioned poses of the hand, and predict the accuracy
    #[command(after_help = "Examples:\n  genmanip calibrate plan --camera wrist --board-at 0.5,0,0 --json\n  \
                      genmanip calibrate plan --world world.toml --camera static --board-at 0,0,0.1 --count 20\n\n\
                      --board-at is the middle of the board: on the table, in the robot's base, for a camera on the hand;\n\
                      in the frame of the hand for a camera beside the robot. Approximate poses are enough.")]
    Plan(CalibratePlanArguments),
    /// Write a board of AprilTags to print, and its description for a file of views beside it
    #[command(after_help = "Examples:\n  genmanip calibrate board --out board.svg\n  \
                      genmanip calibrate board --out small.png --columns 7 --rows 5 --square-mm 25 --tag-mm 19\n\n\
                      A ChArUco board has tags in the white squares of a chessboard, whose crossings are found to a few\n\
                      hundredths of a pixel; OpenCV reads it too (DICT_APRILTAG_36h11). Print it at 100 % and measure it.")]
    Board(CalibrateBoardArguments),
}

/// Arguments of `calibrate board`.
#[derive(Debug, Args)]
pub struct CalibrateBoardArguments {
    /// Image to write: a page (SVG), or the pattern with a border at 600 dpi (PNG); the description is written beside
    /// it, as .json
    #[arg(long, value_name = "FILE.svg|FILE.png")]
    pub out: PathBuf,
    /// Pattern: chessboard with tags, or tags alone
    #[arg(long, default_value = "charuco", value_parser = ["charuco", "tags"])]
    pub pattern: String,
    /// Number of squares per row; of tags with --pattern tags
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub columns: u32,
    /// Number of rows of squares; of tags with --pattern tags
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub rows: u32,
    /// Side length of a square, or centre distance of neighbouring tags with --pattern tags, mm
    #[arg(long, value_name = "MM", default_value_t = 30.0, value_parser = parse::number)]
    pub square_mm: f64,
    /// Side length of a tag with its black border, mm
    #[arg(long, value_name = "MM", default_value_t = 22.5, value_parser = parse::number)]
    pub tag_mm: f64,
    /// Id of the first tag; different ids distinguish boards
    #[arg(long, value_name = "ID", default_value_t = 0)]
    pub first_id: u32,
    /// Paper size of an SVG
    #[arg(long, default_value = "a4", value_parser = ["a4", "a3", "letter"])]
    pub page: String,
}

/// Arguments of `calibrate plan`.
#[derive(Debug, Args)]
pub struct CalibratePlanArguments {
    /// World with the robot and an approximate pose of the camera: TOML or JSON [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Name of the camera in the world
    #[arg(long, value_name = "NAME")]
    pub camera: String,
    /// Middle of the board, metres: in the frame of the robot's base for a camera on the hand, of the hand for a fixed
    /// camera
    #[arg(long, value_name = "X,Y,Z", value_delimiter = ',', allow_hyphen_values = true, value_parser = parse::number,
          num_args = 1)]
    pub board_at: Vec<f64>,
    /// Number of corners per row of the board
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u32).range(2..=100))]
    pub columns: u32,
    /// Number of rows of corners
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(2..=100))]
    pub rows: u32,
    /// Spacing of neighbouring corners, metres
    #[arg(long, value_name = "M", default_value_t = 0.025, value_parser = parse::number)]
    pub spacing: f64,
    /// Number of poses to propose
    #[arg(long, default_value_t = 18, value_parser = clap::value_parser!(u8).range(3..=100).map(usize::from))]
    pub count: usize,
}
