//! Python environments of published packages, made once.

use crate::problem::{OnPath, Result};
use crate::process::{self, Workspace};
use std::fs;
use std::path::{Path, PathBuf};

/// An environment of this Python with these packages, made once; gives its interpreter. What an installation that was
/// cut off left is made anew.
pub fn environment(workspace: &Workspace, program: &str, folder: &Path, packages: &[&str]) -> Result<PathBuf> {
    let (python, whole) = (folder.join("bin/python"), folder.join("genmanip-packages.txt"));
    let wanted = packages.join("\n");
    if !fs::read_to_string(&whole).is_ok_and(|installed| installed == wanted) {
        eprintln!("interop: installing {}", packages.join(", "));
        process::output(workspace.command(program).args(["-m", "venv", "--clear"]).arg(folder))?;
        let mut pip = workspace.command(&python);
        process::output(pip.args(["-m", "pip", "install", "--quiet", "--only-binary=:all:"]).args(packages))?;
        fs::write(&whole, wanted).on("write", &whole)?;
    }
    Ok(python)
}
