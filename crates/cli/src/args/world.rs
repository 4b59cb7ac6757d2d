//! Arguments of `world` and `camera`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use genmanip_core::Distortion;
use genmanip_core::sensor::{MAX_SHUTTER_S, SensorPreset};

/// Subcommands of `world`.
#[derive(Debug, Subcommand)]
pub enum WorldCommand {
    /// Write the built-in world, with comments, to start from
    #[command(after_help = "Examples:\n  genmanip world init --out my_world.toml\n  \
                      genmanip world init --robot ur5e_2f85 --out ur5e.toml")]
    Init(WorldInitArguments),
    /// List all faults of a world file; exit 1 if there are any
    #[command(after_help = "Example:\n  genmanip world check my_world.toml")]
    Check(WorldFileArguments),
    /// Show a world, or the world of a scenario: surfaces, workspace, robot, cameras, hashes
    #[command(after_help = "Example:\n  genmanip world show examples/worlds/side_table.toml --picture above.png")]
    Show(WorldShowArguments),
}

/// Arguments of `world init`.
#[derive(Debug, Args)]
pub struct WorldInitArguments {
    /// File to write instead of printing; must not exist yet
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Robot instead of the Panda
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot instead of the Panda"))]
    pub robot: Option<String>,
}

/// Arguments of `world check`.
#[derive(Debug, Args)]
pub struct WorldFileArguments {
    /// World file: TOML or JSON
    pub file: PathBuf,
}

/// Arguments of `world show`.
#[derive(Debug, Args)]
pub struct WorldShowArguments {
    /// World (TOML or JSON) or scenario
    pub file: PathBuf,
    /// Also write a top view to this PNG file
    #[arg(long, value_name = "FILE.png")]
    pub picture: Option<PathBuf>,
}

/// Subcommands of `camera`.
#[derive(Debug, Subcommand)]
pub enum CameraCommand {
    /// List the cameras of a world or scenario; without a file, the presets
    #[command(after_help = "Example:\n  genmanip camera list my_world.toml")]
    List(CameraListArguments),
    /// Add a camera to a file
    #[command(
        after_help = "Example:\n  genmanip camera add my_world.toml front --preset d435 --eye 1.5,0,0.8 --target 0.5,0,0"
    )]
    Add(CameraEditArguments),
    /// Change a camera of a file; properties that are not given stay as they are
    #[command(after_help = "Example:\n  genmanip camera set my_world.toml front --size 640x360 --fov-deg 45")]
    Set(CameraEditArguments),
    /// Remove a camera from a file
    #[command(after_help = "Example:\n  genmanip camera remove my_world.toml front")]
    Remove(CameraRemoveArguments),
    /// Render the views of cameras: the robot at home, and the objects of a scenario
    #[command(after_help = "Examples:\n  genmanip camera preview my_world.toml front --out front.png\n  \
                      genmanip camera preview SCENARIO --size 640x360 --out views/")]
    Preview(CameraPreviewArguments),
}

/// Arguments of `camera list`.
#[derive(Debug, Args)]
pub struct CameraListArguments {
    /// World (TOML or JSON) or scenario
    pub file: Option<PathBuf>,
}

/// Arguments of `camera add` and `camera set`.
#[derive(Debug, Args)]
pub struct CameraEditArguments {
    /// World (TOML or JSON) or scenario; it is edited in place
    pub file: PathBuf,
    /// Name of the camera
    pub name: String,
    /// Image size and field of view of a commercial camera, see `genmanip camera list`
    #[arg(long, value_name = "PRESET")]
    pub preset: Option<String>,
    /// Image width and height, 1 to 8192 pixels each
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
    /// Vertical field of view, degrees, between 0 and 180
    #[arg(long, value_parser = parse_angle)]
    pub fov_deg: Option<f64>,
    /// Camera position: x,y,z in metres, in the robot's base frame; for a camera on the hand, in the hand's frame
    #[arg(long, requires = "target", allow_hyphen_values = true, value_parser = parse_point, value_name = "X,Y,Z")]
    pub eye: Option<[f64; 3]>,
    /// Target point: x,y,z in metres, in the same frame
    #[arg(long, requires = "eye", allow_hyphen_values = true, value_parser = parse_point, value_name = "X,Y,Z")]
    pub target: Option<[f64; 3]>,
    /// Mount the camera on the hand: where the robot has its wrist camera, or at --eye
    #[arg(long)]
    pub hand: bool,
    /// Noise, missing pixels and depth quantisation of a device's sensors, or `none`
    #[arg(long, value_name = "DEVICE", value_parser = sensor_names())]
    pub sensor: Option<String>,
    /// Shutter time for motion blur, 0 to 0.1 seconds; 0 for no blur
    #[arg(long, value_name = "SECONDS", value_parser = parse_shutter)]
    pub shutter: Option<f64>,
    /// Coefficients of the Brown-Conrady lens distortion in OpenCV's order; zeros for none
    #[arg(long, value_name = "K1,K2,P1,P2[,K3]", allow_hyphen_values = true, value_parser = parse_distortion)]
    pub distortion: Option<Distortion>,
}

/// Arguments of `camera remove`.
#[derive(Debug, Args)]
pub struct CameraRemoveArguments {
    /// World (TOML or JSON) or scenario; it is edited in place
    pub file: PathBuf,
    /// Name of the camera
    pub name: String,
}

/// Arguments of `camera preview`.
#[derive(Debug, Args)]
pub struct CameraPreviewArguments {
    /// World (TOML or JSON) or scenario
    pub file: PathBuf,
    /// Names of cameras [default: all]
    pub names: Vec<String>,
    /// Image file (.png, .jpg) with all views, or folder for one file NAME.png per camera
    #[arg(long, value_name = "PNG|DIR")]
    pub out: PathBuf,
    /// Width and height of each view, pixels [default: the camera's]; another aspect ratio crops two sides of the view
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
}

pub(super) fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once(['x', 'X', '×']).ok_or("expected WIDTHxHEIGHT, e.g. 640x360")?;
    let side = |text: &str| match text.trim().parse::<u32>() {
        Ok(pixels) if (1..=8192).contains(&pixels) => Ok(pixels),
        _ => Err(format!("expected 1 to 8192 pixels, got `{text}`")),
    };
    Ok([side(sides.0)?, side(sides.1)?])
}

/// Names of the devices with a sensor model, and `none`.
fn sensor_names() -> clap::builder::PossibleValuesParser {
    SensorPreset::names().into_iter().chain(["none"]).collect::<Vec<_>>().into()
}

pub(super) fn parse_shutter(text: &str) -> Result<f64, String> {
    let expected = || format!("expected 0 to {MAX_SHUTTER_S} seconds, got `{text}`");
    let seconds: f64 = text.parse().map_err(|_| expected())?;
    if (0.0..=MAX_SHUTTER_S).contains(&seconds) { Ok(seconds) } else { Err(expected()) }
}

pub(super) fn parse_distortion(text: &str) -> Result<Distortion, String> {
    let expected = || format!("expected four or five numbers k1,k2,p1,p2[,k3], got `{text}`");
    let numbers = text.split(',').map(|number| number.trim().parse()).collect::<Result<Vec<f64>, _>>();
    match *numbers.map_err(|_| expected())?.as_slice() {
        [k1, k2, p1, p2] => Ok(Distortion { k1, k2, p1, p2, k3: 0.0 }),
        [k1, k2, p1, p2, k3] => Ok(Distortion { k1, k2, p1, p2, k3 }),
        _ => Err(expected()),
    }
}

fn parse_angle(text: &str) -> Result<f64, String> {
    let degrees: f64 = text.parse().map_err(|_| "expected degrees".to_owned())?;
    if degrees > 0.0 && degrees < 180.0 {
        Ok(degrees)
    } else {
        Err("expected an angle between 0 and 180 degrees".into())
    }
}

fn parse_point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|number| number.trim().parse())
        .collect::<Result<_, _>>()
        .map_err(|_| format!("expected x,y,z in metres, got `{text}`"))?;
    match numbers.as_slice() {
        &[x, y, z] if [x, y, z].iter().all(|number: &f64| number.is_finite()) => Ok([x, y, z]),
        _ => Err(format!("expected three finite numbers x,y,z in metres, got `{text}`")),
    }
}
