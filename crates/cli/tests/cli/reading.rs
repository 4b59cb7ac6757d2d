//! The documented ways to read data, run as documented.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::{REPOSITORY, finished_run, genmanip};

/// The script of the examples replays the episodes of a data set in stock MuJoCo to the last bit; a recorded end that is
/// another by one bit is noticed.
#[test]
fn a_script_replays_episodes_in_stock_mujoco() {
    let Some(python) = python("import mujoco, pyarrow; assert mujoco.__version__ == '3.17.0'") else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(REPOSITORY).join("examples/python/replay_in_mujoco.py");
    let lines = fs::read_to_string(&script).unwrap().lines().count();
    assert!(lines <= 60, "{lines} lines");
    let record = finished_run().join("dataset/extras/record");
    let mut episodes = Vec::new();
    for entry in fs::read_dir(&record).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            episodes.push(path);
        }
    }
    assert!(!episodes.is_empty());
    let replay = |episode: &Path, scene: &Path| {
        let output = Command::new(&python).arg(&script).args([episode, scene]).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.code(), text(&output.stdout), text(&output.stderr))
    };
    let scene = folder.path().join("scene.xml");
    for episode in &episodes {
        let scenario = episode.join("scenario.json");
        let arguments = ["export", scenario.to_str().unwrap(), "--mjcf", "--out", scene.to_str().unwrap()];
        assert_eq!(genmanip(folder.path(), &arguments).code, Some(0));
        let (code, told, problem) = replay(episode, &scene);
        assert_eq!((code, told.trim()), (Some(0), "identical"), "{}: {problem}", episode.display());
    }
    let spoilt = folder.path().join("spoilt");
    fs::create_dir(&spoilt).unwrap();
    for name in ["frames.parquet", "initial_state.f64le", "final_state.f64le"] {
        fs::copy(episodes.last().unwrap().join(name), spoilt.join(name)).unwrap();
    }
    let mut bytes = fs::read(spoilt.join("final_state.f64le")).unwrap();
    bytes[2 * 8] ^= 1; // the last bit of the second joint, which is bent
    fs::write(spoilt.join("final_state.f64le"), bytes).unwrap();
    let (code, told, _) = replay(&spoilt, &scene);
    assert!(code == Some(1) && told.starts_with("differs"), "{told}");
}

/// The interpreter of the tests if it can do what is asked; CI must have one.
#[allow(clippy::print_stderr)] // A test says why it is skipped.
fn python(needed: &str) -> Option<PathBuf> {
    let made_by_setup = Path::new(REPOSITORY).join(".python/bin/python");
    let python = std::env::var_os("GENMANIP_PYTHON").map_or(made_by_setup, PathBuf::from);
    if Command::new(&python).args(["-c", needed]).output().is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    let message = format!("{} cannot `{needed}`; `cargo xtask setup` makes one that can", python.display());
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{message}");
    eprintln!("skipped: {message}");
    None
}
