//! `cargo xtask setup`: what cargo cannot fetch, verified and put where the build and the tests look for it.

use crate::problem::{OnPath, Result};
use crate::process::Workspace;
use crate::{assembler, mujoco, python};
use std::fs::{self, File};
use std::path::PathBuf;

/// Both parts; the second is tried even when the first fails, so that one run names everything that is missing.
pub fn run(workspace: &Workspace) -> Result {
    let simulator = simulator(workspace);
    let python = python_environment(workspace);
    assembler::report(workspace);
    match (simulator, python) {
        (Err(first), Err(second)) => {
            eprintln!("{first}");
            Err(second)
        }
        (simulator, python) => simulator.and(python.map(|_| ())),
    }
}

/// The simulator's shared library, without which nothing links.
pub fn simulator(workspace: &Workspace) -> Result {
    let _one_at_a_time = lock(workspace)?;
    mujoco::install(workspace)
}

/// The Python environment of the independent dataset reader; gives its interpreter.
pub fn python_environment(workspace: &Workspace) -> Result<PathBuf> {
    let _one_at_a_time = lock(workspace)?;
    python::install(workspace)
}

/// Held while files are put in place, so that two set-ups at once do not undo each other; the system frees it when a
/// process dies.
fn lock(workspace: &Workspace) -> Result<File> {
    let folder = workspace.root.join("third_party/mujoco");
    fs::create_dir_all(&folder).on("make the folder", &folder)?;
    let path = folder.join("setup.lock");
    let file = File::create(&path).on("write", &path)?;
    file.lock().on("lock", &path)?;
    Ok(file)
}
