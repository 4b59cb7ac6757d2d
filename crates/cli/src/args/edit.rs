//! Arguments of `edit`.

use std::path::PathBuf;

use clap::{ArgGroup, Args};

/// Arguments of `edit`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
                  genmanip edit my.json --op '{\"op\": \"swap\", \"args\": {\"object\": \"020\", \"uid\": \"027\"}}'\n  \
                  genmanip edit my.json --verdict\n  \
                  genmanip edit my.json --repair --author ada\n  \
                  genmanip edit my.json --undo\n  \
                  genmanip edit my.json --history --json\n  \
                  genmanip edit suites/genmanip-200-rc/scenarios/009_appearance-000.json --copy-to mine --verdict\n\n\
                  Operations: place, state, add, remove, duplicate, swap, instruction, goal, edges, kind, camera,\n\
                  remove_camera; docs/formats/edits.md has their arguments.")]
#[command(override_usage = "genmanip edit [OPTIONS] <SCENARIO> <ACTION>…")]
#[command(group(ArgGroup::new("action").required(true).multiple(true).args([
    "op", "undo", "redo", "revert", "repair", "snapshot", "history", "verdict", "difference", "copy_to",
])))]
pub struct EditArguments {
    /// Scenario; its edits are kept in NAME.edits.jsonl beside it
    pub scenario: PathBuf,
    /// Operation as JSON, or @FILE; may be repeated
    #[arg(long, value_name = "JSON|@FILE")]
    pub op: Vec<String>,
    /// Name of the author that is kept with the changes
    #[arg(long, value_name = "NAME", default_value = "cli")]
    pub author: String,
    /// Undo the author's last command
    #[arg(long, conflicts_with_all = ["op", "redo", "revert", "repair"])]
    pub undo: bool,
    /// Redo the command that the author undid last
    #[arg(long, conflicts_with_all = ["op", "revert", "repair"])]
    pub redo: bool,
    /// Undo the command of a revision, or redo it if it is undone
    #[arg(long, value_name = "REVISION", conflicts_with_all = ["op", "repair"])]
    pub revert: Option<u64>,
    /// Repair all problems that can be repaired, after the operations
    #[arg(long)]
    pub repair: bool,
    /// Name for the revision after the changes
    #[arg(long, value_name = "NAME")]
    pub snapshot: Option<String>,
    /// List all commands with revision, author and time
    #[arg(long)]
    pub history: bool,
    /// List the problems of the scenario, after the changes; exit 1 if it cannot be used
    #[arg(long)]
    pub verdict: bool,
    /// Compare two revisions
    #[arg(long, value_name = "BEFORE,AFTER", value_parser = revisions)]
    pub difference: Option<(u64, u64)>,
    /// Copy the scenario into a folder and edit the copy; for scenarios of suites and runs, which are never changed
    #[arg(long, value_name = "FOLDER")]
    pub copy_to: Option<PathBuf>,
}

/// `BEFORE,AFTER` as two revisions.
fn revisions(text: &str) -> Result<(u64, u64), String> {
    let parsed = text.split_once(',').and_then(|(before, after)| Some((before.parse().ok()?, after.parse().ok()?)));
    parsed.ok_or_else(|| "expected two revisions, such as 0,8".into())
}
