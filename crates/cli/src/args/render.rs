//! Arguments of `render`, and parsers of appearance factors and overlays.

use genmanip_terminal::parse;
use std::path::PathBuf;

use clap::Args;
use genmanip_viz::render::{AppearanceFactor, AppearanceSeed, Overlay};

/// Arguments of `render`.
#[derive(Debug, Args)]
pub struct RenderArguments {
    /// Scenario file, episode folder, folder of episodes, or run
    pub source: PathBuf,
    /// Output folder, with a subfolder per episode
    #[arg(long)]
    pub out: PathBuf,
    /// Cameras of the scenario [default: all]
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub cameras: Vec<String>,
    /// Width and height of the images, pixels [default: each camera's own]
    #[arg(long, value_name = "WxH", value_parser = super::world::parse_size)]
    pub size: Option<[u32; 2]>,
    /// Seed of the appearance randomisation, or `episode` for that of `collect --variation per-episode`
    #[arg(long, value_name = "SEED", value_parser = parse_look_seed)]
    pub variation: Option<AppearanceSeed>,
    /// Randomised parts of the appearance: light, background, material, objects, camera [default: all]
    #[arg(long, value_name = "PART,…", value_delimiter = ',', value_parser = parse_vary, requires = "variation")]
    pub vary: Vec<AppearanceFactor>,
    /// Image channels
    #[arg(
        long,
        value_name = "CHANNEL,…",
        value_delimiter = ',',
        default_value = "rgb",
        value_parser = ["rgb", "depth", "ids", "normals", "boxes", "clouds"]
    )]
    pub channels: Vec<String>,
    /// Overlays on the colour images: masks, grid, boxes, path, grasps, contacts, frames, numbers
    #[arg(long, value_name = "WHAT,…", value_delimiter = ',', value_parser = parse_overlay)]
    pub overlay: Vec<Overlay>,
    /// Draw instruction, step, time and outcome over the lower edge of colour images
    #[arg(long)]
    pub captions: bool,
    /// Number of images of a turntable video around the scenario, instead of those of its cameras
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=3600))]
    pub turntable: Option<u32>,
    /// Sensor model of a device (image noise; depth noise, quantisation and holes), instead of the cameras' own
    #[arg(long, value_name = "DEVICE", value_parser = genmanip_core::sensor::SensorPreset::names())]
    pub sensor: Option<String>,
    /// Shutter time for motion blur, 0 to 0.1 seconds, in place of the cameras' own
    #[arg(long, value_name = "SECONDS", value_parser = super::world::parse_shutter)]
    pub shutter: Option<f64>,
    /// Coefficients of the Brown-Conrady lens distortion in OpenCV's order, in place of the cameras' own
    #[arg(
        long,
        value_name = "K1,K2,P1,P2[,K3]",
        allow_hyphen_values = true,
        value_parser = super::world::parse_distortion
    )]
    pub distortion: Option<genmanip_core::Distortion>,
    /// Image rate of the video of an episode or of a turntable, Hz: 10, 15, 20, 30 or 60
    #[arg(long, alias = "fps", value_name = "HZ", default_value_t = 15, value_parser = super::parse_values::parse_rate)]
    pub rate: u32,
    /// Renderer: `fast` is the rasteriser, `reference` a path tracer for comparison, thousands of times slower
    #[arg(long, default_value = "fast", value_parser = ["fast", "reference"])]
    pub quality: String,
    /// Number of light paths per pixel of `--quality reference`
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub paths: u32,
    /// Refuse scenarios that were laid out for another robot than this
    #[arg(long, value_name = "NAME")]
    pub robot: Option<String>,
    /// Worker threads; the images do not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}

/// Appearance factor by its name.
pub(super) fn parse_vary(text: &str) -> Result<AppearanceFactor, String> {
    let found = AppearanceFactor::ALL.into_iter().find(|part| part.name() == text);
    found.ok_or_else(|| format!("expected one of {}", looks()))
}

/// Names of all appearance factors, separated by commas.
pub(super) fn looks() -> String {
    AppearanceFactor::ALL.map(AppearanceFactor::name).join(", ")
}

/// Overlay by its name.
fn parse_overlay(text: &str) -> Result<Overlay, String> {
    let found = Overlay::ALL.into_iter().find(|overlay| overlay.name() == text);
    found.ok_or_else(|| format!("expected one of {}", Overlay::ALL.map(Overlay::name).join(", ")))
}

fn parse_look_seed(text: &str) -> Result<AppearanceSeed, String> {
    match text {
        "episode" => Ok(AppearanceSeed::Episode),
        number => parse::seed(number)
            .map(|seed| AppearanceSeed::Number(genmanip_core::Seed::new(seed)))
            .map_err(|expected| format!("{expected}, or `episode`")),
    }
}
