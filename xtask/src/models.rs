//! `cargo xtask test --models`: a real language model and a real grasp network answer the programs.
//!
//! The models are packages with known hashes, installed into `target/models`; where they are not to be had, the test is
//! skipped and says so.

use crate::interop;
use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use std::fs;

const REQUIREMENTS: &str = "xtask/models-requirements.txt";
const TESTS: &str = "python/tests/models.py";
/// Words of pip about a file that is not the pinned one, which is no reason to skip.
const OTHER_FILE: &str = "DO NOT MATCH THE HASHES";

pub fn run(workspace: &Workspace) -> Result {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        return skipped(&format!("{REQUIREMENTS} has the packages for Linux on x86-64 alone"));
    }
    let place = workspace.target_dir()?.join("models");
    fs::create_dir_all(&place).on("make the folder", &place)?;
    let python = match interop::hashed_environment(workspace, &place.join("python"), REQUIREMENTS) {
        Ok(python) => python,
        Err(problem) if problem.what.contains(OTHER_FILE) => return Err(problem),
        Err(Problem { what, .. }) => return skipped(&what),
    };
    let mut tests = workspace.command(python);
    process::visible(tests.arg(TESTS).arg("test").arg(workspace.genmanip()?).arg(place.join("run")))
}

fn skipped(reason: &str) -> Result {
    println!("models: skipped, as there are no models: {reason}");
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_package_is_pinned_by_its_hash() {
        let list = include_str!("../models-requirements.txt").replace("\\\n", " ");
        let packages: Vec<&str> = list.lines().filter(|line| !line.starts_with('#')).collect();
        assert_eq!(packages.len(), 5, "{packages:?}");
        for package in packages {
            assert!(package.contains("==") && package.contains(" --hash=sha256:"), "{package}");
        }
    }
}
