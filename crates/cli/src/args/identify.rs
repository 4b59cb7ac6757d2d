//! Arguments of `identify`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use genmanip_core::sensor::SensorPreset;
use genmanip_terminal::parse;

/// Arguments of `identify`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct IdentifyArguments {
    /// Subcommand
    #[command(subcommand)]
    pub command: Option<IdentifyCommand>,
    /// Recordings of the arm: docs/formats/recording.md
    #[arg(value_name = "RECORDING", required = true)]
    pub recordings: Vec<PathBuf>,
    /// Recording of another free motion, to measure the tracking error on; may be repeated [default: the last quarter
    /// of each free motion]
    #[arg(long, value_name = "FILE")]
    pub held_out: Vec<PathBuf>,
    /// World with the robot, TOML or JSON [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot of the recordings"))]
    pub robot: Option<String>,
    /// File to write the world with the identified parameters to
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Subcommands of `identify`.
#[derive(Debug, Subcommand)]
pub enum IdentifyCommand {
    /// Propose a motion that shows parameters: inside the limits, free of collisions, the most informative of several
    #[command(after_help = "Examples:\n  genmanip identify excite --out motion.json\n  \
                      genmanip identify excite --for payload --payload-at 0,0,0.1 --out loaded.json\n  \
                      genmanip identify excite --for table-friction --block-mm 80,80,50 --block-kg 2 --out push.json\n\n\
                      Execute the commands on the arm at their times, and add what was measured to the file.")]
    Excite(ExciteArguments),
    /// Execute a motion on a simulated arm with noisy sensors, to rehearse an identification with known truth
    #[command(
        after_help = "Example:\n  genmanip identify rehearse motion.json --world truth.toml --out recording.json"
    )]
    Rehearse(RehearseArguments),
    /// Find the noise of a camera from repeated images of a still scene
    #[command(after_help = "Example:\n  genmanip identify camera --camera static --sensor d435 --color still/*.jpg \
                      --depth still/*.png --out measured.toml\n\n\
                      Nothing may move, and the light should be steady. Twenty images of bright and dark matt surfaces\n\
                      are good. JPEG images hold less noise than the sensor: record without compression.")]
    Camera(IdentifyCameraArguments),
}

/// Arguments of `identify camera`.
#[derive(Debug, Args)]
pub struct IdentifyCameraArguments {
    /// Camera of the world that took the images
    #[arg(long, value_name = "NAME")]
    pub camera: String,
    /// Colour images, PNG or JPEG
    #[arg(long, value_name = "FILE", num_args = 1.., required_unless_present = "depth")]
    pub color: Vec<PathBuf>,
    /// Depth images, 16-bit PNG in millimetres
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub depth: Vec<PathBuf>,
    /// World with the camera, TOML or JSON [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Device of the camera, whose other properties are kept [default: the sensor in the world]
    #[arg(long, value_name = "DEVICE", value_parser = SensorPreset::names())]
    pub sensor: Option<String>,
    /// File to write the world with the camera's noise to
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Arguments of `identify excite`.
#[derive(Debug, Args)]
pub struct ExciteArguments {
    /// Parameters to show
    #[arg(long = "for", value_name = "WHAT", default_value = "arm",
          value_parser = ["arm", "payload", "table-friction", "pad-friction", "restitution"])]
    pub shown: String,
    /// File to write the motion to
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// World with the robot, TOML or JSON [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot that moves"))]
    pub robot: Option<String>,
    /// Seed of the random motions
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Duration of a free motion, s
    #[arg(long, value_name = "S", default_value_t = 8.0, value_parser = parse::number)]
    pub duration: f64,
    /// Share of the joints' maximum velocity and acceleration that a free motion uses
    #[arg(long, value_name = "SHARE", default_value_t = 0.5, value_parser = parse::number)]
    pub effort: f64,
    /// Joints of a free motion that move, counted from 1 at the base [default: all]
    #[arg(long, value_name = "N,N", value_delimiter = ',')]
    pub joints: Vec<usize>,
    /// Number of random free motions, of which the most informative one is written; about 3 s each
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = parse::count)]
    pub candidates: usize,
    /// Noise of the joint sensors for the prediction, standard deviation in rad
    #[arg(long, value_name = "RAD", default_value_t = 1e-4, value_parser = parse::number)]
    pub noise: f64,
    /// Centre of mass of the payload in the frame of the hand, m
    #[arg(long, value_name = "X,Y,Z", value_delimiter = ',', allow_hyphen_values = true, value_parser = parse::number,
          default_value = "0,0,0.1")]
    pub payload_at: Vec<f64>,
    /// Radius of gyration of the payload, mm
    #[arg(long, value_name = "MM", default_value_t = 30.0, value_parser = parse::number)]
    pub payload_gyration_mm: f64,
    /// Extents of the block, mm
    #[arg(long, value_name = "X,Y,Z", value_delimiter = ',', value_parser = parse::number, default_value = "40,30,80")]
    pub block_mm: Vec<f64>,
    /// Mass of the block, kg
    #[arg(long, value_name = "KG", default_value_t = 0.5, value_parser = parse::number)]
    pub block_kg: f64,
    /// Place of the block on the table, m
    #[arg(long, value_name = "X,Y", value_delimiter = ',', allow_hyphen_values = true, value_parser = parse::number,
          default_value = "0.4,0")]
    pub block_at: Vec<f64>,
    /// Height from which the block is dropped, mm
    #[arg(long, value_name = "MM", default_value_t = 150.0, value_parser = parse::number)]
    pub drop_mm: f64,
    /// Speed of the push, m/s
    #[arg(long, value_name = "M_S", default_value_t = 0.5, value_parser = parse::number)]
    pub speed: f64,
}

/// Arguments of `identify rehearse`.
#[derive(Debug, Args)]
pub struct RehearseArguments {
    /// Motion to execute
    #[arg(value_name = "MOTION")]
    pub motion: PathBuf,
    /// World that holds the truth, TOML or JSON [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// File to write the recording to
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Mass of the payload of a motion with payload, kg
    #[arg(long, value_name = "KG", default_value_t = 1.0, value_parser = parse::number)]
    pub payload_kg: f64,
    /// Noise of the joint sensors, standard deviation in rad
    #[arg(long, value_name = "RAD", default_value_t = 1e-4, value_parser = parse::number)]
    pub noise: f64,
    /// Resolution of the joint sensors, rad
    #[arg(long, value_name = "RAD", default_value_t = 2e-5, value_parser = parse::number)]
    pub step: f64,
    /// Noise of the block's position, standard deviation in mm
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = parse::number)]
    pub block_noise_mm: f64,
    /// Seed of the noise
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
}
