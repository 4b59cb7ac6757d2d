//! Arguments of `assets`.

use genmanip_assets::CATALOGUES;
use genmanip_core::AssetUid;
use genmanip_terminal::parse;
use std::path::PathBuf;

use clap::{Args, Subcommand};

/// Subcommands of `assets`.
#[derive(Debug, Subcommand)]
pub enum AssetsCommand {
    /// List objects: uid, name, category, size
    #[command(after_help = "Example:\n  genmanip assets list --catalog full color:red container:yes")]
    List(SearchArguments),
    /// Find objects by words and filters, best first
    #[command(after_help = "Examples:\n  genmanip assets search \"something to drink from that is not red\"\n  \
                      genmanip assets search wooden container:yes max-size:0.15 --json\n\n\
                      \"not\", \"no\" and \"without\" exclude what follows, -word excludes. Filters: color: material: \
                      category: affordance: container: graspable: articulated: split: (train, unseen_instance, \
                      unseen_family) min-size: max-size: (m) licence:")]
    Search(SearchArguments),
    /// Show one object: words, parts, joints, stable poses, grasps; with --picture from four sides
    #[command(after_help = "Example:\n  genmanip assets show mug-3 --picture mug.png")]
    Show(ShowAssetArguments),
    /// Draw a contact sheet
    #[command(after_help = "Examples:\n  genmanip assets sheet --out sheet.png --catalog full category:food\n  \
                      genmanip assets sheet --family mug --seed 100 --count 12 --out mugs.png\n  \
                      genmanip assets sheet --families my-families/ --family \"garden gnome\" --count 8 --out g.png")]
    Sheet(SheetArguments),
    /// Write one object as OBJ and MTL, MJCF and JSON
    #[command(after_help = "Example:\n  genmanip assets export mug-3 --out out/mug-3")]
    Export(ExportAssetArguments),
    /// Look for implausible density, friction, size, texture, roughness and reflectivity
    #[command(after_help = "Example:\n  genmanip assets audit --catalog full --json\n\nExit 1 when anything is found.")]
    Audit(AuditArguments),
    /// Import objects from files into a pack: USD, GLB, glTF, OBJ, STL, MSH, URDF, MJCF
    #[command(after_help = "Examples:\n  genmanip assets import mug.glb --pack kitchen\n  \
                      genmanip assets import gadget.usdz --category \"garlic press\"\n  \
                      genmanip assets import scans/ --pack scans --scale 0.001 --up z --licence CC-BY-4.0\n  \
                      genmanip assets list --catalog imported\n\n\
                      Every guess and every repair is listed. Each object is put on a table, and tried in the hand. \
                      Exit 1 when a file is refused; the others are imported.")]
    Import(ImportArguments),
    /// Select the generated objects of the catalogue again, after a change of the families
    #[command(hide = true)]
    Freeze(FreezeArguments),
}

/// Catalogue selection.
#[derive(Debug, Args)]
pub struct CatalogArguments {
    /// Objects: `builtin` (64 made by hand), `full` (with those that families make, 1,120 in all), `imported` (of
    /// --packs) or `all`
    #[arg(long, value_name = "NAME", default_value = "full", value_parser = CATALOGUES)]
    pub catalog: String,
}

/// Arguments of `assets list` and `assets search`.
#[derive(Debug, Args)]
pub struct SearchArguments {
    /// Words and filters, such as `color:red`
    #[arg(value_name = "QUERY")]
    pub query: Vec<String>,
    /// Maximum number of objects to list [default: 20 for `search`, all for `list`]
    #[arg(long, value_name = "N")]
    pub limit: Option<usize>,
    /// Catalogue
    #[command(flatten)]
    pub catalog: CatalogArguments,
}

/// Arguments of `assets show`.
#[derive(Debug, Args)]
pub struct ShowAssetArguments {
    /// Uid of the object
    pub uid: AssetUid,
    /// Write an image of the object from four sides, PNG or JPEG
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
}

/// Arguments of `assets sheet`.
#[derive(Debug, Args)]
pub struct SheetArguments {
    /// Words and filters of the objects to draw
    #[arg(value_name = "QUERY")]
    pub query: Vec<String>,
    /// Image to write, PNG or JPEG
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Draw new objects of this family instead; `all` for new objects of every family, `random` for families chosen at
    /// random from --seed
    #[arg(long, value_name = "NAME")]
    pub family: Option<String>,
    /// Folder with the data files of families that replace the built-in ones
    #[arg(long, value_name = "DIR", requires = "family")]
    pub families: Option<PathBuf>,
    /// Seed of the first new object of a family, from which the next ones count; with `random`, seed of the choice
    #[arg(long, default_value_t = 1, value_parser = parse::seed)]
    pub seed: u64,
    /// Maximum number of objects to draw [default: all]; with --family, number of new objects of each family [default:
    /// 1]
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub count: Option<usize>,
    /// Images per row
    #[arg(long, default_value_t = 10, value_parser = parse::count)]
    pub columns: usize,
    /// Pixels per side of an image
    #[arg(long, default_value_t = 160, value_parser = clap::value_parser!(u32).range(16..=1024))]
    pub cell: u32,
    /// Catalogue
    #[command(flatten)]
    pub catalog: CatalogArguments,
}

/// Arguments of `assets export`.
#[derive(Debug, Args)]
pub struct ExportAssetArguments {
    /// Uid of the object
    pub uid: AssetUid,
    /// Folder to write the files to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Arguments of `assets audit`.
#[derive(Debug, Args)]
pub struct AuditArguments {
    /// Write a contact sheet of the objects with findings, in the order of the findings: PNG or JPEG
    #[arg(long, value_name = "FILE")]
    pub sheet: Option<PathBuf>,
    /// Catalogue
    #[command(flatten)]
    pub catalog: CatalogArguments,
}

/// Arguments of `assets import`.
#[derive(Debug, Args)]
pub struct ImportArguments {
    /// Files, or folders of them
    #[arg(value_name = "PATH", required = true)]
    pub paths: Vec<PathBuf>,
    /// Folder that must hold the files and all files they refer to, such as textures [default: the folder given as
    /// PATH, or that of the file]
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// Name of the pack that the objects are added to
    #[arg(long, value_name = "NAME", default_value = "imported")]
    pub pack: String,
    /// Length unit of the files in metres, 1e-6 to 1e6, instead of a guess
    #[arg(long, value_name = "METRES", value_parser = super::parse_values::parse_scale)]
    pub scale: Option<f64>,
    /// Up axis of the files, instead of a guess
    #[arg(long, value_name = "AXIS", value_parser = ["y", "z"])]
    pub up: Option<String>,
    /// Category of the objects, singular and in lower case, e.g. `water bottle`, instead of a guess by their names
    #[arg(long, value_name = "NOUN", value_parser = super::parse_values::parse_category)]
    pub category: Option<String>,
    /// Licence of the files that do not name one
    #[arg(long, value_name = "TEXT")]
    pub licence: Option<String>,
    /// Skip the grasp trials
    #[arg(long)]
    pub no_grasps: bool,
    /// Robot whose gripper is used in the grasp trials
    #[arg(long, value_name = "NAME", default_value = "panda")]
    pub robot: String,
    /// Seed of the grasp trials
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Worker threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub workers: Option<usize>,
}

/// Arguments of `assets freeze`.
#[derive(Debug, Args)]
pub struct FreezeArguments {
    /// File to write
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Folder with the data files of families that replace the built-in ones
    #[arg(long, value_name = "DIR")]
    pub families: Option<PathBuf>,
    /// Number of rigid objects, the built-in ones included
    #[arg(long, default_value_t = 1000)]
    pub rigid: usize,
    /// Number of articulated objects, the built-in ones included
    #[arg(long, default_value_t = 120)]
    pub articulated: usize,
}
