//! Arguments of `transfer` and `worth`.

use std::path::PathBuf;

use clap::Args;
use genmanip_skills::Verb;
use genmanip_terminal::parse;

/// Examples and conditions of `genmanip-lab transfer`.
pub(super) const TRANSFER_HELP: &str = "Examples:\n  \
    genmanip-lab transfer --seed 5 --skills pull,push,turn,lift,press --source-demos 5 --count 100 --json\n  \
    genmanip-lab transfer --seed 5 --skills pull --count 10 --out out/transfer\n\n\
    One thread. Takes are those of a scripted operator at virtual devices; COUNT scenes of the\n\
    instance of the takes and COUNT of other instances, each with all arms.";

/// Arguments of `genmanip-lab transfer`.
#[derive(Debug, Args)]
pub struct TransferArguments {
    /// Seed of scenes, operators and policies
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Kinds of manipulation
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "pull,push,turn,lift,press",
          value_parser = skill)]
    pub skills: Vec<Verb>,
    /// Source demonstrations per skill
    #[arg(long, value_name = "COUNT", default_value_t = 5, value_parser = parse::count)]
    pub source_demos: usize,
    /// Scenes of the instance of the takes, and as many of other instances
    #[arg(long, default_value_t = 100, value_parser = parse::count)]
    pub count: usize,
    /// Measure the transfer without each of its ingredients too
    #[arg(long)]
    pub ablate: bool,
    /// Keep takes and transferred episodes in this new folder, an episode store
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Examples and conditions of `genmanip-lab worth`.
pub(super) const WORTH_HELP: &str = "Example:\n  \
    genmanip-lab worth --seed 5 --skills pull,press --source-demos 5 --count 200 --steps 3000 --json\n\n\
    Needs a build with learned policies: cargo xtask install --learn. One thread. Each policy reads\n\
    simulator poses (preset `state`); all have the same number of steps and the same unseen layouts.";

/// Arguments of `genmanip-lab worth`.
#[derive(Debug, Args)]
pub struct WorthArguments {
    /// Seed of scenes, operators and policies
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Kinds of manipulation
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "pull,press", value_parser = skill)]
    pub skills: Vec<Verb>,
    /// Source demonstrations per skill
    #[arg(long, value_name = "COUNT", default_value_t = 5, value_parser = parse::count)]
    pub source_demos: usize,
    /// Generated demonstrations, and as many of the analytic expert
    #[arg(long, default_value_t = 200, value_parser = parse::count)]
    pub count: usize,
    /// Unseen layouts per skill
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = parse::count)]
    pub layouts: usize,
    /// Optimiser steps of each training
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub steps: usize,
    /// New folder for demonstrations and policies [default: a temporary one, which is removed]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

fn skill(name: &str) -> Result<Verb, String> {
    Verb::named(name).ok_or_else(|| {
        let known: Vec<&str> = Verb::ALL.iter().map(|verb| verb.name()).collect();
        format!("expected one of {}", known.join(", "))
    })
}
