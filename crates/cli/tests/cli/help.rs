//! `--help` and `doctor`: what a newcomer types first.

use std::os::unix::fs::PermissionsExt;

use crate::{genmanip, program};

#[test]
fn help_of_every_verb_reads_well_and_shows_an_example() {
    let folder = tempfile::tempdir().unwrap();
    let verbs: &[&[&str]] = &[
        &["demo"],
        &["task", "new"],
        &["task", "check"],
        &["task", "show"],
        &["layout"],
        &["plan"],
        &["robot", "add"],
        &["collect"],
        &["merge"],
        &["launch"],
        &["evaluate"],
        &["ablate"],
        &["sim2real"],
        &["calibrate"],
        &["calibrate", "board"],
        &["calibrate", "plan"],
        &["identify"],
        &["identify", "excite"],
        &["identify", "rehearse"],
        &["real", "simulate"],
        &["real", "run"],
        &["agent", "act"],
        &["studio"],
        &["teleop"],
        &["serve", "segment"],
        &["serve", "agent"],
        &["serve", "policy"],
        &["replay"],
        &["report"],
        &["export"],
        &["train"],
        &["data", "check"],
        &["data", "show"],
        &["data", "merge"],
        &["data", "import"],
        &["data", "convert"],
        &["data", "split"],
        &["data", "filter"],
        &["data", "delete"],
        &["data", "card"],
        &["data", "rerender"],
        &["grasps", "bake"],
        &["grasps", "show"],
        &["edit"],
        &["review"],
        &["camera", "list"],
        &["camera", "add"],
        &["camera", "set"],
        &["camera", "remove"],
        &["camera", "preview"],
        &["doctor"],
    ];
    let overview = genmanip(folder.path(), &["--help"]);
    assert_eq!(overview.code, Some(0), "{overview:?}");
    for verb in verbs {
        assert!(overview.stdout.contains(&format!("  {}", verb[0])), "{} is not in the overview", verb[0]);
        let arguments: Vec<&str> = verb.iter().copied().chain(["--help"]).collect();
        let help = genmanip(folder.path(), &arguments);
        assert_eq!(help.code, Some(0), "{help:?}");
        assert_eq!(help.stderr, "");
        let example = format!("\n  genmanip {}", verb.join(" "));
        assert!(help.stdout.contains("Example") && help.stdout.contains(&example), "{verb:?}: {}", help.stdout);
        let widest = help.stdout.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(widest <= 100, "{verb:?} prints lines of {widest} characters");
    }
}

#[test]
fn the_old_form_of_measurements_names_their_program() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [&["lab"][..], &["lab", "expert", "--count", "3", "--json"], &["lab", "--help"]] {
        genmanip(folder.path(), arguments).assert_ended(2, &["genmanip-lab", "cargo run --release -p genmanip-lab --"]);
    }
}

/// The exit code says whether something needed is missing; physics must really have simulated something.
#[test]
fn doctor_says_what_is_missing_and_how_to_mend_it() {
    let folder = tempfile::tempdir().unwrap();
    let python = folder.path().join("python");
    std::fs::write(&python, "#!/bin/sh\necho pyarrow 1, av 2\n").unwrap();
    std::fs::set_permissions(&python, std::fs::Permissions::from_mode(0o755)).unwrap();
    let doctor = |python: &std::path::Path| -> crate::Outcome {
        program(folder.path(), &["doctor", "--json"]).env("GENMANIP_PYTHON", python).output().unwrap().into()
    };

    let healthy = doctor(&python).json(0);
    let found = |what: &str| {
        let findings = healthy.as_array().unwrap();
        findings.iter().find(|finding| finding["what"] == what).unwrap()["found"].as_str().unwrap().to_owned()
    };
    assert!(found("physics").contains("mujoco 3.17"), "{healthy}");
    assert!(found("physics").contains("simulated"), "{healthy}");
    assert_eq!(found("dataset reader"), "pyarrow 1, av 2");
    assert_eq!(found("current folder"), "writable");

    let lacking = doctor(&folder.path().join("no-python")).json(0);
    let reader = lacking.as_array().unwrap().iter().find(|finding| finding["what"] == "dataset reader").unwrap();
    assert_eq!((&reader["ok"], &reader["needed"]), (&false.into(), &false.into()));
    assert!(reader["mend"].as_str().unwrap().contains("cargo xtask setup"), "{reader}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "doctor leaves nothing behind");

    // Nobody, not even root, may write into this folder.
    let stuck = genmanip(std::path::Path::new("/proc"), &["doctor"]);
    assert_eq!(stuck.code, Some(1), "{stuck:?}");
    let line = stuck.stdout.lines().find(|line| line.contains("current folder")).unwrap();
    assert!(line.starts_with("missing") && line.contains("not writable") && line.contains("change to"), "{line}");
}
