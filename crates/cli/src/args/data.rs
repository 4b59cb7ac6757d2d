//! Arguments of `data`.

use genmanip_terminal::parse;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use genmanip_dataset_tools::edit::Condition;
use genmanip_viz::render::AppearanceFactor;

use super::sources::SourceArguments;

/// Subcommands of `data`.
#[derive(Debug, Subcommand)]
pub enum DataCommand {
    /// Check datasets down to their last row and list all faults; exit 1 if there are any
    #[command(after_help = "Examples:\n  genmanip data check out/run/dataset\n  \
                      genmanip data check out/train/dataset out/test/dataset --json\n\n\
                      LeRobot v3.0 with its depth sibling, LeRobot v2.1, and zarr. Of several datasets, what the later\n\
                      share with the earlier counts as a leak: scenarios, sentences, states and actions.\n\
                      --replays 10 also simulates ten episodes of extras/record again, evenly chosen, bit for bit.")]
    Check(DataCheckArguments),
    /// Show the contents of a dataset: tasks with lengths and success, ranges of states and actions; images with --html
    #[command(after_help = "Examples:\n  genmanip data show out/run/dataset\n  \
                      genmanip data show out/run/dataset --html dataset.html\n  \
                      genmanip data show --learnability out/run")]
    Show(DataShowArguments),
    /// Merge the episodes of several datasets into one
    #[command(after_help = "Example:\n  genmanip data merge out/a/dataset out/b/dataset --out out/both\n\n\
                      LeRobot v3.0 datasets of this program with the same columns. Nothing is encoded again: pictures are\n\
                      copied frame by frame, with the depth sibling, all columns and extras/record. Episodes of two runs\n\
                      with the same name get a number behind it.")]
    Merge(DataMergeArguments),
    /// Divide a dataset into parts, such as train and test
    #[command(after_help = "Examples:\n  genmanip data split out/run/dataset --out out/parts\n  \
                      genmanip data split DATASET --fractions train=0.8,val=0.1,test=0.1 --by episode --seed 7 --out out/parts\n\n\
                      By task, all episodes of a sentence go to one part: what is tested was not trained on.")]
    Split(DataSplitArguments),
    /// Keep only the episodes of a dataset that meet all conditions
    #[command(after_help = "Examples:\n  genmanip data filter DATASET --where success=true --out out/good\n  \
                      genmanip data filter DATASET --where kind=spatial --where object=017 --out out/mugs\n\n\
                      object: a thing in the scene; kind, task, seed, policy, failure or any column of meta/episodes.\n\
                      --source transfer,teleop: who gave the commands, as the column `source` says.")]
    Filter(DataFilterArguments),
    /// Remove some episodes from a dataset
    #[command(after_help = "Example:\n  genmanip data delete DATASET --episodes 3,7-9 --out out/rest")]
    Delete(DataDeleteArguments),
    /// Convert a dataset of another program for these commands: LeRobot v3.0 and v2.1, the original GenManip
    #[command(after_help = "Examples:\n  genmanip data import ~/data/pusht --out out/pusht\n  \
                      genmanip data import ~/data/aloha --ffmpeg ffmpeg --out out/aloha\n  \
                      genmanip data import ~/GenManip/saved/demonstrations/put_mug --out out/mug\n\n\
                      Numbers, names and sentences stay; H.264 pictures are copied as they are. With --ffmpeg, video of other\n\
                      codecs, such as AV1, is decoded by that program and encoded anew. Depth goes into OUT-depth.\n\
                      Of the original GenManip, folders with meta_info.pkl and lmdb/; pickles are read, never executed.\n\
                      check, show, filter, split, merge and delete then work on it.")]
    Import(DataImportArguments),
    /// Convert a dataset to LeRobot v2.1, for readers of that version such as GR00T and openpi
    #[command(after_help = "Example:\n  genmanip data convert out/run/dataset --to lerobot-v2.1 --out out/old\n\n\
                      Takes LeRobot v3.0 and v2.1 of any program. Columns, pictures, steps, outcomes and the action contract stay;\n\
                      depth has no place there. The way back is data import.")]
    Convert(DataConvertArguments),
    /// Render the images of a dataset again with other light, materials, background or cameras; rows and physics stay
    #[command(after_help = "Examples:\n  genmanip data rerender out/run/dataset --out out/second\n  \
                      genmanip data rerender out/run/dataset --look 2 --vary light,background --out out/lights\n  \
                      genmanip data rerender out/run/dataset --plain --cameras left,wrist --out out/left\n\n\
                      Pictures are drawn from extras/record. Interrupted, the same call goes on; the seed of each episode's\n\
                      look is its variation_seed.")]
    Rerender(DataRerenderArguments),
    /// Rewrite the card of a dataset (contents, seeds, licences) and croissant.json, its metadata for data catalogues
    #[command(after_help = "Example:\n  genmanip data card out/run/dataset")]
    Card(DataCardArguments),
    /// Upload a folder, such as a run or a dataset, to S3 storage; only files that are missing or different there
    #[command(after_help = "Example:\n  genmanip data push out/run s3://my-bucket/runs/monday\n\n\
                      Keys, region and server: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN, AWS_REGION,\n\
                      AWS_ENDPOINT_URL. A failed transfer is repeated for about a minute; the same call goes on where it\n\
                      stopped, also while the run still grows. A list of all files is written last.")]
    Push(DataPushArguments),
    /// Download a folder that was pushed to S3 storage; only files that are missing or different here
    #[command(after_help = "Example:\n  genmanip data pull s3://my-bucket/runs/monday out/run\n\n\
                      Every file is compared with the hash it had when it was pushed.")]
    Pull(DataPullArguments),
}

/// Arguments of `data push`.
#[derive(Debug, Args)]
pub struct DataPushArguments {
    /// Folder to upload
    pub folder: PathBuf,
    /// Destination: s3://BUCKET/PREFIX
    pub address: String,
    /// Number of files uploaded at the same time
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = parse::count)]
    pub at_once: usize,
}

/// Arguments of `data pull`.
#[derive(Debug, Args)]
pub struct DataPullArguments {
    /// Source: s3://BUCKET/PREFIX
    pub address: String,
    /// Folder to download into
    pub folder: PathBuf,
    /// Number of files downloaded at the same time
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = parse::count)]
    pub at_once: usize,
}

/// Arguments of `data check`.
#[derive(Debug, Args)]
pub struct DataCheckArguments {
    /// Folders of datasets
    #[arg(required = true, value_name = "DATASET")]
    pub datasets: Vec<PathBuf>,
    /// Number of recorded episodes to simulate again, evenly chosen; their final states must be the recorded ones
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub replays: usize,
}

/// Arguments of `data rerender`.
#[derive(Debug, Args)]
pub struct DataRerenderArguments {
    /// Folder of a LeRobot v3.0 dataset of this program
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Folder of the new dataset
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Index of the random appearance of each episode; 0 is the one that `collect --variation per-episode` renders
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub look: u64,
    #[arg(
        long,
        value_name = "PART,…",
        value_delimiter = ',',
        value_parser = super::render::parse_vary,
        help = format!("What differs from the usual look: {} [default: all]", super::render::looks())
    )]
    pub vary: Vec<AppearanceFactor>,
    /// Render the default appearance, without randomisation
    #[arg(long, conflicts_with = "vary")]
    pub plain: bool,
    /// Cameras of the scenarios [default: those of the dataset]
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub cameras: Vec<String>,
    /// Worker threads; the result does not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}

/// Arguments of `data show`.
#[derive(Debug, Args)]
pub struct DataShowArguments {
    /// Folder of a dataset; with --learnability also of a run
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Write an HTML page to this file instead of printing
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
    /// Show how well a policy could predict the demonstrations: spread of the first grasps, what the object's pose
    /// explains of them, and how well similar states predict the next second. Needs the recorded episodes
    #[arg(long, conflicts_with = "html")]
    pub learnability: bool,
}

/// Arguments of `data merge`.
#[derive(Debug, Args)]
pub struct DataMergeArguments {
    /// Folders of datasets, in the order of their episodes
    #[arg(required = true, value_name = "DATASET")]
    pub datasets: Vec<PathBuf>,
    /// Folder of the new dataset
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Arguments of `data split`.
#[derive(Debug, Args)]
pub struct DataSplitArguments {
    /// Folder of a dataset
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Folder to write a dataset per part to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Names of the parts and their shares of the episodes
    #[arg(long, value_name = "NAME=SHARE,…", value_delimiter = ',', value_parser = parse_share, default_value = "train=0.9,test=0.1")]
    pub fractions: Vec<(String, f64)>,
    /// Seed of the random split
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Unit of the split: task (all episodes of a sentence) or episode
    #[arg(long, value_name = "WHAT", default_value = "task", value_parser = ["task", "episode"])]
    pub by: String,
}

/// Arguments of `data filter`.
#[derive(Debug, Args)]
pub struct DataFilterArguments {
    /// Folder of a dataset
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Column of the episodes and the value it must have, such as success=true; if given several times, all must hold
    #[arg(long = "where", required_unless_present = "sources", value_name = "COLUMN=VALUE")]
    pub conditions: Vec<Condition>,
    #[command(flatten)]
    pub sources: SourceArguments,
    /// Folder of the new dataset
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Arguments of `data import`.
#[derive(Debug, Args)]
pub struct DataImportArguments {
    /// Folder of a LeRobot dataset, or of episodes of the original GenManip
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Folder of the new dataset
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Program (ffmpeg) that decodes video other than H.264
    #[arg(long, value_name = "PROGRAM")]
    pub ffmpeg: Option<PathBuf>,
}

/// Arguments of `data convert`.
#[derive(Debug, Args)]
pub struct DataConvertArguments {
    /// Folder of a LeRobot dataset
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Format of the new dataset
    #[arg(long, value_name = "FORMAT", value_parser = ["lerobot-v2.1"])]
    pub to: String,
    /// Folder of the new dataset
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Program (ffmpeg) that decodes video other than H.264
    #[arg(long, value_name = "PROGRAM")]
    pub ffmpeg: Option<PathBuf>,
}

/// Arguments of `data card`.
#[derive(Debug, Args)]
pub struct DataCardArguments {
    /// Folder of a LeRobot v3.0 dataset of this program
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
}

/// Arguments of `data delete`.
#[derive(Debug, Args)]
pub struct DataDeleteArguments {
    /// Folder of a dataset
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Indices of the episodes to remove, and ranges of them, such as 3,7-9
    #[arg(long, value_name = "N,N-N,…")]
    pub episodes: String,
    /// Folder of the new dataset
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

fn parse_share(text: &str) -> Result<(String, f64), String> {
    let share = text.split_once('=').and_then(|(name, share)| Some((name.to_owned(), share.parse::<f64>().ok()?)));
    share.filter(|(_, share)| *share > 0.0 && *share <= 1.0).ok_or_else(|| "expected NAME=SHARE, as train=0.9".into())
}
