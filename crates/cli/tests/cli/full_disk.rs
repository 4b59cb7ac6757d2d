//! A full disk: whatever writes stops with exit 1 and the hint to free space.

use super::{Outcome, PROGRAM, example, finished_run};
use std::process::Command;

/// Runs the program beside a copy of the finished run on a file system with `free_kib` left; `None` where the machine
/// allows no file system of one's own.
fn on_full_disk(arguments: &str, free_kib: u32) -> Option<Outcome> {
    let script = format!(
        "mount -t tmpfs -o size=64m tmpfs . && cd \"$PWD\" && cp -r \"$RUN\" run || exit 77
         dd if=/dev/zero of=fill bs=4k 2> /dev/null
         truncate -s -{free_kib}k fill
         exec \"$G\" {arguments}"
    );
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new("unshare");
    command.args(["--map-root-user", "--mount", "sh", "-c", &script]).current_dir(folder.path());
    let outcome: Outcome = command.env("G", PROGRAM).env("RUN", finished_run()).output().ok()?.into();
    let is_allowed = outcome.code != Some(77) && !outcome.stderr.starts_with("unshare:");
    is_allowed.then_some(outcome)
}

#[test]
fn every_stage_says_that_the_disk_is_full() {
    let task = example("021_spatial");
    for (arguments, free_kib, stage) in [
        (format!("collect {task} --episodes 1 --out other"), 100, "collecting stopped"),
        ("export --to hdf5 run".into(), 8, "cannot keep the images"),
        ("evaluate --policy do_nothing run".into(), 8, "cannot write"),
        // A transcript that cannot be written is no failure of the policy.
        ("evaluate --policy agent:vlm=random,transcripts=transcripts run".into(), 100, "evaluating agent"),
        ("report run".into(), 8, "cannot write"),
    ] {
        let Some(outcome) = on_full_disk(&arguments, free_kib) else {
            eprintln!("skipped: this machine allows no file system of one's own (unshare --map-root-user --mount)");
            return;
        };
        assert_eq!(outcome.code, Some(1), "{arguments}: {outcome:?}");
        for part in [stage, "No space left on device", "hint: free some space on that disk"] {
            assert!(outcome.stderr.contains(part), "{arguments}: `{part}` is missing in:\n{}", outcome.stderr);
        }
    }
}
