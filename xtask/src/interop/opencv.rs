//! OpenCV reads our boards, and its hand-eye solvers calibrate the same views.

use super::environment::environment;
use crate::problem::Result;
use crate::process::{self, Workspace};
use std::fs;
use std::path::Path;

const COMPARISON: &str = "python/tests/interop_opencv.py";
/// Version 5 has no hand-eye solvers in Python.
const PACKAGES: [&str; 2] = ["opencv-python-headless==4.14.0.94", "numpy==2.3.5"];

/// Makes sets of views with known truth, and compares both programs on them.
pub fn run(workspace: &Workspace, place: &Path) -> Result {
    let python = environment(workspace, "python3", &place.join("opencv"), &PACKAGES)?;
    let sets = place.join("board-sets");
    let _ = fs::remove_dir_all(&sets);
    let genmanip = workspace.genmanip()?;
    let lab = genmanip.with_file_name(format!("genmanip-lab{}", std::env::consts::EXE_SUFFIX));
    let mut made = workspace.command(lab);
    made.args(["--quiet", "calibrate", "--seed", "57", "--count", "20", "--rendered", "1", "--out"]).arg(&sets);
    process::output(&mut made)?;
    process::visible(workspace.command(&python).arg(COMPARISON).arg(genmanip).arg(&sets))
}
