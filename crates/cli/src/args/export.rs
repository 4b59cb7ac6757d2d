//! Arguments of `export`.

use genmanip_terminal::parse;
use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use genmanip_data::export::choice::{ACTIONS, COLUMNS, ROTATIONS};
use genmanip_pipeline::export::Format;

use super::parse_values::parse_rate;
use super::sources::SourceArguments;

/// Arguments of `export`.
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("format").required(true).args(["to", "mjcf", "glb", "usd"]))]
pub struct ExportArguments {
    /// Folder of a run made by `collect`; with --mjcf, --glb or --usd a scenario file
    #[arg(value_name = "RUN|SCENARIO")]
    pub source: PathBuf,
    /// Format of the dataset
    #[arg(long, value_name = "FORMAT", value_parser = PossibleValuesParser::new(Format::ALL.map(Format::name)))]
    pub to: Option<String>,
    /// Export the scenario as MuJoCo XML
    #[arg(long, conflicts_with_all = ["dataset", "sources"])]
    pub mjcf: bool,
    /// Export the scenario as binary glTF for Blender and other modelling programs: surfaces, robot, objects and
    /// cameras at the start, with materials and textures; needs --out
    #[arg(long, conflicts_with_all = ["dataset", "sources"], requires = "out")]
    pub glb: bool,
    /// Export the scenario as OpenUSD text (usda) with UsdPhysics: surfaces, robot and objects as rigid bodies with
    /// colliders, masses and joints, materials, cameras; textures lie in a folder beside it; needs --out
    #[arg(long, conflicts_with_all = ["dataset", "sources"], requires = "out")]
    pub usd: bool,
    /// Output path [default: RUN/exports/…; with --mjcf stdout]
    #[arg(long)]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub dataset: DatasetArguments,
    #[command(flatten)]
    pub sources: SourceArguments,
}

/// Contents of a dataset.
#[derive(Debug, Args)]
#[group(id = "dataset", multiple = true)]
pub struct DatasetArguments {
    /// Contents of the `action` column [default: joint]
    #[arg(long, value_name = "ACTION", value_parser = PossibleValuesParser::new(ACTIONS.map(|(name, _)| name)))]
    pub action: Option<String>,
    /// Representation of rotations in the actions ee and ee_delta [default: 6d]
    #[arg(long, value_name = "ROTATION", value_parser = PossibleValuesParser::new(ROTATIONS.map(|(name, _)| name)))]
    pub rotation: Option<String>,
    /// Rows per second: 10, 15, 20, 30 or 60 [default: 15]
    #[arg(long, alias = "fps", value_name = "HZ", value_parser = parse_rate)]
    pub rate: Option<u32>,
    /// Cameras of the scenario [default: static,wrist]
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', conflicts_with = "no_images")]
    pub cameras: Vec<String>,
    /// Further columns: `sim` for poses and speeds of the objects and which one is held, as `sim.object_…`; `boxes` for
    /// bounding boxes in each image, as `sim.box.…`; `masks` for the object that each pixel shows, beside the depth
    /// images
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = PossibleValuesParser::new(COLUMNS.map(|(name, _)| name)))]
    pub columns: Vec<String>,
    /// Omit images
    #[arg(long)]
    pub no_images: bool,
    /// Omit depth images
    #[arg(long)]
    pub no_depth: bool,
    /// Also export recorded failed attempts, labelled as such
    #[arg(long)]
    pub keep_failed: bool,
    /// Worker threads; the result does not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}
