//! Arguments of `data`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// Verbs for data sets.
#[derive(Debug, Subcommand)]
pub enum DataCommand {
    /// Read datasets to their last row and say what is wrong; exit 1 when anything is
    #[command(after_help = "Examples:\n  genmanip data check out/run/dataset\n  \
                      genmanip data check out/train/dataset out/test/dataset --json\n\n\
                      LeRobot v3.0 with its depth sibling, LeRobot v2.1, and zarr. Of several datasets, what the later\n\
                      share with the earlier counts as a leak: scenarios, sentences, states and actions.\n\
                      Nothing is simulated: genmanip replay --check DATASET/extras/record does that.")]
    Check(DataCheckArguments),
    /// Show what is in a dataset: kinds of tasks, lengths, success, ranges of states and actions
    #[command(after_help = "Examples:\n  genmanip data show out/run/dataset\n  \
                      genmanip data show out/run/dataset --html dataset.html")]
    Show(DataShowArguments),
}

/// Arguments of `data check`.
#[derive(Debug, Args)]
pub struct DataCheckArguments {
    /// Folders of datasets
    #[arg(required = true, value_name = "DATASET")]
    pub datasets: Vec<PathBuf>,
}

/// Arguments of `data show`.
#[derive(Debug, Args)]
pub struct DataShowArguments {
    /// Folder of a dataset
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Write a page instead of printing
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
}
