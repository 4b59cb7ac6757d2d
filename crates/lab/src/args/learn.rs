//! Arguments of the measurements of learned policies.

use std::path::PathBuf;

use clap::Args;
use genmanip_benchmark::suites;
use genmanip_pipeline::learn::{Head, Preset};
use genmanip_terminal::parse;

/// Arguments of `genmanip-lab learn`.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("length").required(true).args(["steps", "budget"])))]
pub struct LabLearnArguments {
    /// Distribution of genmanip-learn-10, whose split `train` is demonstrated and whose split `familiar` is the test
    #[arg(long, value_name = "NAME", default_value = "into")]
    pub distribution: String,
    /// Seed of initial weights and samples
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Preset of inputs and network size
    #[arg(long, value_name = "PRESET", value_parser = parse::variant(Preset::ALL, Preset::name))]
    pub preset: Preset,
    /// Output of the network, as `genmanip train --head`
    #[arg(long, value_name = "HEAD", default_value = Head::L1.name(), value_parser = parse::variant(Head::ALL, Head::name))]
    pub head: Head,
    /// Number of verified demonstrations
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub demos: usize,
    /// Number of optimiser steps
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub steps: Option<usize>,
    /// Wall-clock time of the training instead of a number of steps, such as 90s, 30m or 2h
    #[arg(long, value_name = "TIME", value_parser = parse::time)]
    pub budget: Option<u64>,
    /// Train without simulator labels, as `genmanip train --no-labels`
    #[arg(long)]
    pub no_labels: bool,
    /// Number of unseen layouts to evaluate on, the first of the split
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = parse::count)]
    pub layouts: usize,
    /// New folder for run, policy and layouts [default: a temporary one, which is removed]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}

/// Arguments of `genmanip-lab learned-controls`.
#[derive(Debug, Args)]
pub struct LabControlArguments {
    /// Folder of a policy made by `genmanip train`
    #[arg(value_name = "POLICY")]
    pub policy: PathBuf,
    /// Folder of the run that the policy was trained on
    #[arg(long, value_name = "RUN")]
    pub run: PathBuf,
    /// Suite of task distributions, folder or name, whose split `familiar` has the layouts
    #[arg(long, value_name = "NAME|DIR", default_value = "genmanip-learn-10", value_parser = suites::parse_folder)]
    pub suite: PathBuf,
    /// Only this distribution of the suite
    #[arg(long, value_name = "NAME")]
    pub distribution: Option<String>,
    /// Number of unseen layouts of each distribution, the first of the split
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = parse::count)]
    pub layouts: usize,
    /// Evaluate only these controls, such as no_images or execute_4 [default: all]
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub only: Vec<String>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}
