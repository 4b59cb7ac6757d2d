//! The Python wheel: built, installed into an environment of its own, and tested there.

use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use std::fs;
use std::path::{Path, PathBuf};

const REQUIREMENTS: &str = "xtask/wheel-requirements.txt";
const TESTS: &str = "python/tests";

/// Builds the wheel and runs its tests.
pub fn test(workspace: &Workspace) -> Result {
    let place = workspace.target_dir()?.join("wheel");
    let python = place.join("python/bin/python");
    let wheel = build(workspace)?;
    install(workspace, &python, &wheel)?;
    let mut tests = workspace.command(&python);
    tests.args(["-W", "error::DeprecationWarning", "-m", "unittest", "discover", "--start-directory", TESTS]);
    tests.env("GENMANIP_PROGRAM", workspace.genmanip()?).env("TMPDIR", &place);
    process::visible(&mut tests)
}

/// Builds the wheel with the crates that the program was built of; the environment must be there.
pub fn build(workspace: &Workspace) -> Result<PathBuf> {
    let target = workspace.target_dir()?;
    let place = target.join("wheel");
    let python = place.join("python/bin/python");
    let wheels = place.join("built");
    if wheels.exists() {
        fs::remove_dir_all(&wheels).on("remove the wheel built before", &wheels)?;
    }
    let mut build = workspace.command(&python);
    build.args(["-m", "maturin", "build", "--release", "--locked", "--manifest-path", "python/Cargo.toml"]);
    build.arg("--interpreter").arg(&python).arg("--target-dir").arg(&target).arg("--out").arg(&wheels);
    process::visible(&mut build)?;
    only_file(&wheels)
}

/// Installs a wheel without looking for what it depends on.
pub fn install(workspace: &Workspace, python: &Path, wheel: &Path) -> Result {
    let mut install = workspace.command(python);
    install.args(["-m", "pip", "install", "--quiet", "--no-deps", "--force-reinstall", "--no-index"]);
    process::output(install.arg(wheel)).map(|_| ())
}

/// Makes sure that there is an environment with exactly the packages of the list; one with another list is made anew.
pub fn environment(workspace: &Workspace) -> Result {
    let place = &workspace.target_dir()?.join("wheel");
    let list = workspace.root.join(REQUIREMENTS);
    let wanted = fs::read_to_string(&list).on("read", &list)?;
    let (folder, marker) = (place.join("python"), place.join("python/requirements.txt"));
    if fs::read_to_string(&marker).is_ok_and(|text| text == wanted) {
        return Ok(());
    }
    eprintln!("python:    making an environment with the packages of {REQUIREMENTS} (250 MB, once)");
    if folder.exists() {
        fs::remove_dir_all(&folder).on("remove the unfinished environment", &folder)?;
    }
    fs::create_dir_all(place).on("make the folder", place)?;
    process::output(workspace.command("python3").args(["-m", "venv"]).arg(&folder)).map_err(|problem| Problem {
        expected: "python3 with its module venv".into(),
        hint: "on Debian and Ubuntu: apt install python3-venv python3-pip".into(),
        ..problem
    })?;
    let mut pip = workspace.command(folder.join("bin/python"));
    pip.args(["-m", "pip", "install", "--quiet", "--only-binary=:all:", "--requirement", REQUIREMENTS]);
    process::output(&mut pip)?;
    // Written last: an environment without it is not whole.
    let aside = place.join("requirements.tmp");
    fs::write(&aside, &wanted).on("write", &aside)?;
    process::rename(&aside, &marker)
}

/// The wheel in the folder.
fn only_file(folder: &Path) -> Result<PathBuf> {
    let mut entries = fs::read_dir(folder).on("read", folder)?;
    match entries.next() {
        Some(entry) => Ok(entry.on("read", folder)?.path()),
        None => Err(Problem {
            what: format!("maturin wrote no wheel into {}", folder.display()),
            expected: "one file".into(),
            hint: "its own messages above say why".into(),
        }),
    }
}
