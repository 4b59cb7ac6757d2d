//! The real program in temporary folders: what it prints, how it ends, and what it leaves on disk.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod answers;
mod arm;
mod calibrating;
mod cameras;
mod comparing;
mod designing;
mod editing;
mod full_disk;
mod help;
mod hostile;
mod identifying;
mod importing;
mod interrupted;
mod labels;
#[cfg(feature = "learn")]
mod learn;
mod learnability;
mod messages;
mod planning;
mod reading;
mod refusals;
mod render;
mod reviewing;
mod robots;
mod runs;
mod serving;
mod sharding;
mod skills;
mod studio_killed;
mod suites;
mod teleoperating;
mod verified;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use std::time::SystemTime;

use serde_json::Value;

const PROGRAM: &str = env!("CARGO_BIN_EXE_genmanip");
const REPOSITORY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// The two quickest of the example tasks, with images at the lowest rate: rendering takes most of the time.
const QUICK_TASKS: [&str; 2] = ["021_spatial", "024_appearance"];
const QUICK: [&str; 4] = ["--episodes", "1", "--fps", "10"];

/// Exit code and output of a call.
#[derive(Debug)]
struct Outcome {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl From<Output> for Outcome {
    fn from(output: Output) -> Self {
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        Self { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }
}

impl Outcome {
    /// The JSON on stdout of a call that ended with this exit code.
    #[track_caller]
    fn json(&self, code: i32) -> Value {
        assert_eq!(self.code, Some(code), "{self:?}");
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("stdout is no JSON ({error}): {self:?}"))
    }

    /// Panics unless the call ended with exit code 0.
    #[track_caller]
    fn assert_done(&self) {
        assert_eq!(self.code, Some(0), "{self:?}");
    }

    /// Panics unless the call failed as a user's mistake does: exit 1, one message, nothing on stdout.
    #[track_caller]
    fn assert_refused(&self, wanted: &[&str]) {
        self.assert_ended(1, wanted);
    }

    /// As [`Outcome::assert_refused`], with another exit code.
    #[track_caller]
    fn assert_ended(&self, code: i32, wanted: &[&str]) {
        assert_eq!(self.code, Some(code), "{self:?}");
        assert_eq!(self.stdout, "", "{self:?}");
        assert_eq!(self.stderr.matches("error:").count(), 1, "{self:?}");
        for part in wanted {
            assert!(self.stderr.contains(part), "`{part}` is missing in:\n{}", self.stderr);
        }
    }
}

/// The program, to be started in a folder.
fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(PROGRAM);
    command.current_dir(folder).args(arguments);
    command
}

/// Runs the program in a folder to its end.
fn genmanip(folder: &Path, arguments: &[&str]) -> Outcome {
    program(folder, arguments).output().unwrap().into()
}

/// Runs `genmanip-lab`, which is built beside the program, in a folder to its end.
fn genmanip_lab(folder: &Path, arguments: &[&str]) -> Outcome {
    let program = Path::new(PROGRAM).with_file_name("genmanip-lab");
    assert!(program.is_file(), "build it first: cargo build --release -p genmanip-lab");
    Command::new(program).current_dir(folder).args(arguments).output().unwrap().into()
}

/// Runs `genmanip-lab` if the first word is `lab`, else the program.
fn either_program(folder: &Path, arguments: &[&str]) -> Outcome {
    match arguments {
        ["lab", rest @ ..] => genmanip_lab(folder, rest),
        all => genmanip(folder, all),
    }
}

/// Path of an example task.
fn example(name: &str) -> String {
    format!("{REPOSITORY}/examples/tasks/{name}.json")
}

/// Path of a recorded answer, sound or flawed.
fn recorded(name: &str) -> String {
    format!("{REPOSITORY}/crates/tasks/testdata/responses/{name}.json")
}

/// File of the default world whose dataset cameras have 128 x 72 pixels; layouts are judged in the others.
fn small_images() -> &'static str {
    static WORLD: OnceLock<String> = OnceLock::new();
    WORLD.get_or_init(|| {
        let usual = fs::read_to_string(format!("{REPOSITORY}/crates/assets/data/world.toml")).unwrap();
        let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("small_images.toml");
        let (others, cameras) = usual.split_at(usual.find("name = \"static\"").unwrap());
        fs::write(&file, format!("{others}{}", cameras.replace("[512, 288]", "[128, 72]"))).unwrap();
        file.to_str().unwrap().to_owned()
    })
}

/// `collect` of the quick tasks with small images into `run`, with more arguments.
fn collect_quick<'a>(examples: &'a [String], more: &[&'a str]) -> Vec<&'a str> {
    let tasks = examples.iter().map(String::as_str);
    let usual = ["--world", small_images(), "--out", "run"];
    ["collect"].into_iter().chain(tasks).chain(QUICK).chain(usual).chain(more.iter().copied()).collect()
}

fn quick_examples() -> Vec<String> {
    QUICK_TASKS.iter().map(|task| example(task)).collect()
}

/// A finished run of the quick tasks, made once and never changed; tests that write use [`copy_of_finished_run`].
fn finished_run() -> &'static Path {
    static RUN: OnceLock<PathBuf> = OnceLock::new();
    RUN.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("finished");
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        let outcome = genmanip(&folder, &collect_quick(&quick_examples(), &["--workers", "2"]));
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        folder.join("run")
    })
}

/// The finished run as `run` in a temporary folder.
fn copy_of_finished_run() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in tree(finished_run()) {
        let path = folder.path().join("run").join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    folder
}

/// All files under a folder, by path.
fn tree(root: &Path) -> BTreeMap<String, Vec<u8>> {
    files(root).into_iter().map(|(name, path)| (name, fs::read(path).unwrap())).collect()
}

/// Modification time of each file below a folder.
fn times(root: &Path) -> BTreeMap<String, SystemTime> {
    files(root).into_iter().map(|(name, path)| (name, path.metadata().unwrap().modified().unwrap())).collect()
}

fn files(root: &Path) -> BTreeMap<String, PathBuf> {
    let mut files = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.strip_prefix(root).unwrap().to_string_lossy().into_owned(), path);
            }
        }
    }
    files
}

/// Panics with the names of the files that differ, rather than with their bytes.
#[track_caller]
fn assert_same_tree(left: &BTreeMap<String, Vec<u8>>, right: &BTreeMap<String, Vec<u8>>) {
    let differing: Vec<&String> =
        left.keys().chain(right.keys()).filter(|name| left.get(*name) != right.get(*name)).collect();
    assert!(differing.is_empty(), "these files differ or are missing: {differing:?}");
    assert!(!left.is_empty());
}

/// A run without what is measured by the clock.
fn without_timings(mut tree: BTreeMap<String, Vec<u8>>) -> BTreeMap<String, Vec<u8>> {
    assert!(tree.remove("timings.json").is_some());
    tree
}
