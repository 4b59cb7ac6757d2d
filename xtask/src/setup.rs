//! `cargo xtask setup`: what cargo cannot fetch, verified and put where the build and the tests look for it.

use crate::problem::{OnPath, Problem, Result};
use crate::process::Workspace;
use crate::{mujoco, python};
use std::fs::{self, File};
use std::path::PathBuf;

/// Wheels put here by hand are used instead of the network.
pub const HAND_PLACED: &str = "third_party/wheels";

/// Both parts; the second is tried even when the first fails, so that one run names everything that is missing.
pub fn run(workspace: &Workspace) -> Result {
    let simulator = simulator(workspace);
    let python = python_environment(workspace);
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

/// The ways on when a download was not possible.
pub fn offline(what: &str, cause: &Problem, files: &str, place: &str) -> Problem {
    Problem {
        what: format!("{what}\n  because {}", cause.what),
        expected: files.into(),
        hint: format!("with a network: run `cargo xtask setup` again\nwithout: {place}"),
    }
}
