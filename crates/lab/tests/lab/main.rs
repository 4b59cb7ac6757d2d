//! The program `genmanip-lab` in temporary folders: output, exit codes and messages.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod motion;
mod strangers;
mod teleop;
mod worth;

use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

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

    /// Panics unless the call ended with exit code 1, one message with these parts, and nothing on stdout.
    #[track_caller]
    fn assert_refused(&self, wanted: &[&str]) {
        assert_eq!((self.code, self.stdout.as_str()), (Some(1), ""), "{self:?}");
        assert_eq!(self.stderr.matches("error:").count(), 1, "{self:?}");
        for part in wanted {
            assert!(self.stderr.contains(part), "`{part}` is missing in:\n{}", self.stderr);
        }
    }
}

/// Runs the program in a folder to its end.
fn lab(folder: &Path, arguments: &[&str]) -> Outcome {
    let mut command = Command::new(env!("CARGO_BIN_EXE_genmanip-lab"));
    command.current_dir(folder).args(arguments).output().unwrap().into()
}

#[test]
fn help_of_every_subcommand_reads_well() {
    let folder = tempfile::tempdir().unwrap();
    let overview = lab(folder.path(), &["--help"]);
    assert_eq!(overview.code, Some(0), "{overview:?}");
    for name in [
        "layout",
        "relations",
        "answers",
        "expert",
        "agent",
        "blame",
        "data",
        "design",
        "motion",
        "strangers",
        "teleop",
        "worth",
        "grasp",
        "fit",
        "scale",
    ] {
        assert!(overview.stdout.contains(&format!("  {name}")), "{name} is not in the overview");
        let help = lab(folder.path(), &[name, "--help"]);
        assert_eq!((help.code, help.stderr.as_str()), (Some(0), ""), "{help:?}");
        let example = format!("\n  genmanip-lab {name}");
        assert!(help.stdout.contains("Example") && help.stdout.contains(&example), "{name}: {}", help.stdout);
        let widest = help.stdout.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(widest <= 100, "{name} prints lines of {widest} characters");
    }
}

#[test]
fn design_prints_its_contract() {
    let folder = tempfile::tempdir().unwrap();
    let report = lab(folder.path(), &["design", "--seed", "9", "--count", "60", "--json"]).json(0);
    let keys: Vec<&String> = report.as_object().unwrap().keys().collect();
    let expected = [
        "seed",
        "tasks",
        "valid",
        "distinct_instructions",
        "distinct_share",
        "kinds",
        "relations",
        "worst_quota_deviation",
        "references",
        "references_unique",
        "words_max",
        "cpu_s",
        "rejections",
        "flaws",
    ];
    assert_eq!(keys, expected);
    assert_eq!((&report["tasks"], &report["valid"], &report["flaws"]), (&60.into(), &60.into(), &json!([])));
    assert_eq!(report["kinds"]["spatial"], json!({"count": 10, "quota": 10.0}));
    assert!(report["relations"]["between"]["count"].as_u64().unwrap() > 0);
}
