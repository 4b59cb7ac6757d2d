//! Arguments of `launch`.

use genmanip_terminal::parse;
use std::path::PathBuf;

use clap::Args;

/// Arguments of `launch`.
#[derive(Clone, Debug, Args)]
#[command(group = clap::ArgGroup::new("cluster").required(true).args(["slurm", "kubernetes", "local"]))]
pub struct LaunchArguments {
    /// Submit an array job to Slurm with sbatch
    #[arg(long)]
    pub slurm: bool,
    /// Submit an indexed job to Kubernetes with kubectl; needs --image and --claim
    #[arg(long)]
    pub kubernetes: bool,
    /// Run the shards on this machine
    #[arg(long)]
    pub local: bool,
    /// Number of shards (parts) that the work is divided into
    #[arg(long, value_parser = parse::count)]
    pub shards: usize,
    /// Number of CPU cores of each shard
    #[arg(long, default_value_t = 2, value_parser = parse::count)]
    pub cpus: usize,
    /// Maximum number of shards that run at the same time [default: all; with --local: 1]
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub at_once: Option<usize>,
    /// Container image that contains this program
    #[arg(long, requires = "kubernetes")]
    pub image: Option<String>,
    /// Persistent volume claim with inputs and output
    #[arg(long, requires = "kubernetes")]
    pub claim: Option<String>,
    /// Mount point of the claim; relative paths start there
    #[arg(long, value_name = "DIR", default_value = "/data", requires = "kubernetes")]
    pub mount: PathBuf,
    /// Measure a sample of a few attempts and print the job, but write and submit nothing
    #[arg(long)]
    pub dry_run: bool,
    /// `collect` and its arguments, without --shard and --workers
    #[arg(last = true, required = true, value_name = "collect …")]
    pub call: Vec<String>,
}
