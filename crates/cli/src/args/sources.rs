//! Selection of episodes by who gave their commands: shared by `export`, `data filter` and `train`.

use clap::Args;
use genmanip_data::Provenance;
use genmanip_terminal::parse;

/// Selection of episodes by who gave their commands.
#[derive(Clone, Debug, Args)]
pub struct SourceArguments {
    /// Only episodes whose commands came from one of these: `expert`, `teleop` (a person), `scripted_teleop` (a program
    /// at a virtual device), `transfer` (a skill), `correction` (a person or the expert took over) or `policy`
    #[arg(id = "sources", long = "source", value_name = "NAME,…", value_delimiter = ',', hide_possible_values = true,
          value_parser = parse::variant(Provenance::ALL, Provenance::name))]
    pub names: Vec<Provenance>,
}
