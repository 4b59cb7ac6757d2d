//! The small Python environment `.python/`: an independent reader judges the datasets we write.

use crate::offline;
use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use std::fs;
use std::path::{Path, PathBuf};

const REQUIREMENTS: &str = "xtask/python-requirements.txt";
/// Written last: an environment without it, or with another text in it, is not whole and is made anew.
const MARKER: &str = "genmanip-requirements.txt";
const OLDEST: (u32, u32) = (3, 10);

/// Makes sure that the environment is there and as pinned; gives its interpreter.
pub fn install(workspace: &Workspace) -> Result<PathBuf> {
    let list = workspace.root.join(REQUIREMENTS);
    let wanted = fs::read_to_string(&list).on("read", &list)?;
    let folder = workspace.root.join(".python");
    let interpreter = folder.join("bin/python");
    if is_whole(workspace, &folder, &interpreter, &wanted) {
        eprintln!("python:    the environment of the dataset reader is in place");
        return Ok(interpreter);
    }
    refuse_old(&process::output(
        workspace.command("python3").args(["-c", "import sys; print(sys.version_info[0], sys.version_info[1])"]),
    )?)?;
    eprintln!("python:    making .python/ with the packages of {REQUIREMENTS} (150 MB, once)");
    if folder.exists() {
        fs::remove_dir_all(&folder).on("remove the unfinished environment", &folder)?;
    }
    process::output(workspace.command("python3").args(["-m", "venv", ".python"])).map_err(|problem| Problem {
        expected: "python3 with its module venv".into(),
        hint: "on Debian and Ubuntu: apt install python3-venv python3-pip".into(),
        ..problem
    })?;
    let mut pip = workspace.command(&interpreter);
    pip.args(["-m", "pip", "install", "--quiet", "--only-binary=:all:", "--requirement", REQUIREMENTS]);
    if workspace.root.join(offline::HAND_PLACED).is_dir() {
        pip.args(["--find-links", offline::HAND_PLACED]);
    }
    process::output(&mut pip).map_err(|cause| {
        offline::problem(
            "the packages of the dataset reader could not be installed",
            &cause,
            &names(&wanted).join(", "),
            &format!(
                "put the wheels of {} for your Python into {}/ and run it again",
                names(&wanted).join(", "),
                offline::HAND_PLACED
            ),
        )
    })?;
    process::output(workspace.command(&interpreter).args(["-c", "import av, h5py, mujoco, numpy, pyarrow.parquet"]))?;
    let aside = folder.join("marker.tmp");
    fs::write(&aside, &wanted).on("write", &aside)?;
    process::rename(&aside, &folder.join(MARKER))?;
    eprintln!("python:    the environment of the dataset reader is ready");
    Ok(interpreter)
}

fn is_whole(workspace: &Workspace, folder: &Path, interpreter: &Path, wanted: &str) -> bool {
    fs::read_to_string(folder.join(MARKER)).is_ok_and(|text| text == wanted)
        && process::output(workspace.command(interpreter).args(["-c", ""])).is_ok()
}

fn refuse_old(version: &str) -> Result {
    let mut parts = version.split_whitespace().map(|part| part.parse::<u32>().unwrap_or(0));
    let got = (parts.next().unwrap_or(0), parts.next().unwrap_or(0));
    if got >= OLDEST {
        return Ok(());
    }
    Err(Problem {
        what: format!("python3 is version {}.{}", got.0, got.1),
        expected: format!("{}.{} or newer", OLDEST.0, OLDEST.1),
        hint: "put a newer python3 first on the PATH".into(),
    })
}

/// `name==version` of each requirement, as it stands in the list.
pub fn names(requirements: &str) -> Vec<&str> {
    let lines = requirements.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines.map(|line| line.split(';').next().unwrap_or(line).trim()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_requirement_is_pinned() {
        let list = names(include_str!("../python-requirements.txt"));
        assert!(list.iter().all(|name| name.contains("==")), "{list:?}");
        assert_eq!(names("# why\n\na==1; python_version < \"3.11\"\nb==2\n"), ["a==1", "b==2"]);
    }

    #[test]
    fn an_old_python_is_named() {
        assert!(refuse_old("3 10\n").is_ok() && refuse_old("4 0").is_ok());
        let problem = refuse_old("3 9").err().map(|problem| problem.to_string()).unwrap_or_default();
        assert!(problem.contains("3.9") && problem.contains("3.10 or newer"), "{problem}");
    }
}
