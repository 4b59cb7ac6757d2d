//! Arguments of `studio`.

use std::path::PathBuf;

use clap::Args;

use super::review::ReviewInputArguments;

/// Default TCP port of the studio.
const PORT: &str = "8097";

/// Arguments of `studio`.
#[derive(Debug, Args)]
pub struct StudioArguments {
    /// Scenario files, folders of them, runs, suites by name or folder; tasks, which are laid out first
    /// [default: the scenarios in --out, else six designed tasks]
    #[arg(value_name = "RUN|SUITE|TASKS|SCENARIO")]
    pub paths: Vec<PathBuf>,
    /// Folder for layouts of tasks, and for copies of scenarios that are never edited in place: of suites and runs
    #[arg(long, default_value = "studio")]
    pub out: PathBuf,
    /// TCP port to listen on; 0 picks a free one
    #[arg(long, default_value = PORT)]
    pub port: u16,
    /// Print the address instead of opening the page in the browser
    #[arg(long)]
    pub no_open: bool,
    /// Accept connections from other machines too; each must open the printed address, which contains a secret token
    #[arg(long)]
    pub allow_others: bool,
    /// Episode of a named run to play back at once: its id, after the label of its evaluation and a slash if it has one
    #[arg(long, value_name = "[LABEL/]ID")]
    pub episode: Option<String>,
    /// A policy that the page may run beside the built-in ones, with its arguments; may be given several times.
    /// Everyone who can open the page can then run it
    #[arg(long = "policy", value_name = "NAME[:KEY=VALUE,…]")]
    pub policies: Vec<String>,
    /// Folder of questions (`[folder]` in a model's settings) that are answered in the page, in place of a model
    #[arg(long, value_name = "FOLDER")]
    pub questions: Option<PathBuf>,
    #[command(flatten)]
    pub review: ReviewInputArguments,
    /// Name under which changes are logged, unless the page is given another one [default: that of git, or the user's]
    #[arg(long, value_name = "NAME")]
    pub author: Option<String>,
}
