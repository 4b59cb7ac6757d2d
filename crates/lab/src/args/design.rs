//! Arguments of `design` and `wording`.

use clap::Args;
use genmanip_assets::CATALOGUES;
use genmanip_terminal::parse;

/// Arguments of `genmanip-lab design`.
#[derive(Debug, Args)]
pub struct DesignArguments {
    /// Seed of the tasks
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of tasks to design, the six kinds in turn
    #[arg(long, default_value_t = 300, value_parser = parse::count)]
    pub count: usize,
    /// Objects: `builtin` (64 made by hand), `full` (with those that families make, 1,120 in all), `imported` (of
    /// --packs) or `all`
    #[arg(long, value_name = "NAME", default_value = "builtin", value_parser = CATALOGUES)]
    pub catalog: String,
}
