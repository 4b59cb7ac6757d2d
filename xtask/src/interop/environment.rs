//! Python environments of published packages, made once.

use crate::problem::{OnPath, Result};
use crate::process::{self, Workspace};
use std::fs;
use std::path::{Path, PathBuf};

/// An environment of this Python with these packages, made once; gives its interpreter. What an installation that was
/// cut off left is made anew.
pub fn environment(workspace: &Workspace, program: &str, folder: &Path, packages: &[&str]) -> Result<PathBuf> {
    installed(workspace, program, folder, &packages.join("\n"), packages)
}

/// An environment with the packages of a requirements file that gives the hash of each, without what they depend on.
pub fn hashed_environment(workspace: &Workspace, folder: &Path, requirements: &str) -> Result<PathBuf> {
    let list = workspace.root.join(requirements);
    let wanted = fs::read_to_string(&list).on("read", &list)?;
    installed(workspace, "python3", folder, &wanted, &["--no-deps", "--require-hashes", "--requirement", requirements])
}

/// An environment for which pip was given these arguments; `wanted` names its content.
fn installed(workspace: &Workspace, program: &str, folder: &Path, wanted: &str, arguments: &[&str]) -> Result<PathBuf> {
    let (python, whole) = (folder.join("bin/python"), folder.join("genmanip-packages.txt"));
    if !fs::read_to_string(&whole).is_ok_and(|installed| installed == wanted) {
        eprintln!("installing {}", arguments.join(" "));
        process::output(workspace.command(program).args(["-m", "venv", "--clear"]).arg(folder))?;
        let mut pip = workspace.command(&python);
        process::output(pip.args(["-m", "pip", "install", "--quiet", "--only-binary=:all:"]).args(arguments))?;
        fs::write(&whole, wanted).on("write", &whole)?;
    }
    Ok(python)
}
