//! What the user may type after `camera`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// Verbs for cameras of world and scenario files.
#[derive(Debug, Subcommand)]
pub enum CameraCommand {
    /// List the cameras of a world or scenario; without a file those of the built-in world, and the presets
    #[command(after_help = "Examples:\n  genmanip camera list\n  genmanip camera list world.toml --json")]
    List(ListCamerasArguments),
    /// Add a camera to a world or scenario
    #[command(after_help = "Examples:\n  genmanip camera add world.toml top --preset d435 --eye 0.5,0,1.4 --target \
                      0.55,0,0\n  genmanip camera add SCENARIO close --fov-deg 60 --size 640x480 --mount hand")]
    Add(AddCameraArguments),
    /// Change a camera of a world or scenario; what is not named stays
    #[command(after_help = "Example:\n  genmanip camera set world.toml top --size 640x360")]
    Set(SetCameraArguments),
    /// Remove a camera from a world or scenario
    #[command(after_help = "Example:\n  genmanip camera remove world.toml top")]
    Remove(RemoveCameraArguments),
    /// Draw what cameras see: table and robot at its start, with the objects of a scenario
    #[command(after_help = "Examples:\n  genmanip camera preview world.toml --out out/views\n  \
                      genmanip camera preview SCENARIO static wrist --size 640x360 --out views.png")]
    Preview(PreviewArguments),
}

/// Arguments of `camera list`.
#[derive(Debug, Args)]
pub struct ListCamerasArguments {
    /// World (TOML or JSON) or scenario
    pub file: Option<PathBuf>,
}

/// Arguments of `camera add`.
#[derive(Debug, Args)]
pub struct AddCameraArguments {
    /// World (TOML or JSON) or scenario; it is changed in place
    pub file: PathBuf,
    /// Name of the new camera
    pub name: String,
    /// The camera itself
    #[command(flatten)]
    pub camera: CameraArguments,
}

/// Arguments of `camera set`.
#[derive(Debug, Args)]
pub struct SetCameraArguments {
    /// World (TOML or JSON) or scenario; it is changed in place
    pub file: PathBuf,
    /// Name of the camera
    pub name: String,
    /// What changes
    #[command(flatten)]
    pub camera: CameraArguments,
}

/// What a camera is.
#[derive(Debug, Args)]
pub struct CameraArguments {
    /// A camera that can be bought; `genmanip camera list` shows them
    #[arg(long, value_name = "NAME")]
    pub preset: Option<String>,
    /// Vertical field of view, degrees, instead of a preset
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true)]
    pub fov_deg: Option<f64>,
    /// Width and height, pixels; a preset is cut to their ratio
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
    /// Where it is, metres, in the frame of its mount
    #[arg(long, value_name = "X,Y,Z", value_delimiter = ',', allow_hyphen_values = true)]
    pub eye: Option<Vec<f64>>,
    /// A point it looks at, metres, in the frame of its mount
    #[arg(long, value_name = "X,Y,Z", value_delimiter = ',', allow_hyphen_values = true)]
    pub target: Option<Vec<f64>>,
    /// What it is fixed to: world, or hand (without --eye where the robot has its wrist camera)
    #[arg(long, value_name = "MOUNT", value_parser = ["world", "hand"])]
    pub mount: Option<String>,
}

/// Arguments of `camera remove`.
#[derive(Debug, Args)]
pub struct RemoveCameraArguments {
    /// World (TOML or JSON) or scenario; it is changed in place
    pub file: PathBuf,
    /// Name of the camera
    pub name: String,
}

/// Arguments of `camera preview`.
#[derive(Debug, Args)]
pub struct PreviewArguments {
    /// World (TOML or JSON) or scenario
    pub file: PathBuf,
    /// Cameras [default: all]
    pub names: Vec<String>,
    /// A picture (.png, .jpg) with all views, or a folder for one each
    #[arg(long, value_name = "PNG|DIR")]
    pub out: PathBuf,
    /// Width and height of each view, pixels [default: the camera's]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
}

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    sides.ok_or_else(|| "expected width x height in pixels, e.g. 640x360".into())
}
