//! The published `lerobot` opens a dataset that was just collected, and trains on it.

use super::environment::environment;
use crate::problem::{Problem, Result};
use crate::process::{self, Workspace};
use std::fs;
use std::path::{Path, PathBuf};

const READER: &str = "python/tests/interop_lerobot.py";
/// Page whose training commands are run.
const GUIDE: &str = "docs/guides/train-with-lerobot.md";
/// As the guide installs it.
const PACKAGES: [&str; 1] = ["lerobot[training,diffusion]==0.6.1"];
const TASKS: [&str; 2] = ["examples/tasks/020_appearance.json", "examples/tasks/021_spatial.json"];
/// An interpreter that has the packages, in place of an environment of our own.
const INTERPRETER: &str = "GENMANIP_LEROBOT";

/// Collects two episodes, compares what `lerobot` gives with what was written, and trains as the guide says.
pub fn run(workspace: &Workspace, place: &Path) -> Result {
    let python = interpreter(workspace, place)?;
    let (run, trained) = (place.join("lerobot-run"), place.join("lerobot-trained"));
    for folder in [&run, &trained] {
        let _ = fs::remove_dir_all(folder);
    }
    let mut collect = workspace.command(workspace.genmanip()?);
    collect.args(["--quiet", "collect"]).args(TASKS).args(["--episodes", "1", "--seed", "1", "--out"]).arg(&run);
    process::output(&mut collect)?;
    let mut reader = workspace.command(python);
    // Nothing is asked of the network, and no cache of an earlier dataset of this name is read.
    reader.env("HF_HUB_OFFLINE", "1").env("WANDB_MODE", "disabled").env("HF_DATASETS_CACHE", trained.join("cache"));
    process::visible(reader.arg(READER).arg(&run).arg(GUIDE).arg(&trained))
}

fn interpreter(workspace: &Workspace, place: &Path) -> Result<PathBuf> {
    if let Some(named) = std::env::var_os(INTERPRETER) {
        return Ok(named.into());
    }
    environment(workspace, "python3.12", &place.join("lerobot"), &PACKAGES).map_err(|problem| Problem {
        hint: format!("it needs Python 3.12 and 6 GB; {INTERPRETER} may name an interpreter that has the package"),
        ..problem
    })
}
