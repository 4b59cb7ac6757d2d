//! Supervision of a worker: a process that dies has found something; another one goes on behind that input.

use std::process::{Command, ExitStatus};

use crate::Failure;
use crate::input::Input;
use crate::targets::Target;
use crate::worker::{MAX_CPU_S, MAX_WAIT_S, Progress, TIMED_OUT};

/// Address space of a worker, MiB; readers promise 1 GiB, the corpus and the program itself come on top.
const MEMORY_MIB: u64 = 2048;
/// Number of findings that end a campaign.
const MAX_FOUND: usize = 10;

/// Runs a target for some CPU time; prints and saves what broke it, and returns the number of findings.
///
/// # Errors
/// If a worker cannot be started, or ends before its first input.
pub fn run(target: &'static Target, budget_s: f64, seed: u64) -> Result<usize, Failure> {
    let scratch = tempfile::tempdir()?;
    let file = scratch.path().join("progress");
    let corpus = (target.open)(target.name, &crate::repository())?.corpus;
    let (mut from, mut left_s, mut accepted, mut found) = (0, budget_s, 0, 0);
    while left_s > 0.0 && found < MAX_FOUND {
        // The shell sets the limit, since a program cannot do that safely between fork and exec.
        let status = Command::new("sh")
            .args(["-c", &format!("ulimit -v {}; ulimit -c 0; exec \"$0\" \"$@\"", MEMORY_MIB << 10)])
            .arg(std::env::current_exe()?)
            .args([target.name, "--seed", &seed.to_string(), "--minutes", &(left_s / 60.0).to_string()])
            .args(["--from", &from.to_string(), "--progress"])
            .arg(&file)
            .env("TMPDIR", scratch.path())
            .status()?;
        let progress = Progress::read(&file)?;
        (from, left_s, accepted) =
            (progress.index, left_s - progress.cpu_ms as f64 / 1e3, accepted + progress.accepted);
        if status.success() {
            break;
        }
        found += 1;
        let folder = Input::mutated(target, &corpus, seed, from).save(target, seed, from)?;
        println!("{}: input {from} of seed {seed}: {}", target.name, ending(status));
        println!("  cargo xtask fuzz {} --input {}", target.name, folder.display());
        from += 1;
    }
    println!("{}: {from} inputs, {accepted} accepted, {found} broke the reader", target.name);
    Ok(found)
}

fn ending(status: ExitStatus) -> String {
    match status.code() {
        Some(101) => "panic".into(),
        Some(TIMED_OUT) => format!("more than {MAX_CPU_S} s of CPU time, or no answer for {MAX_WAIT_S} s"),
        Some(code) => format!("exit code {code}"),
        None => format!("{status}: a stack overflow, or more memory than {MEMORY_MIB} MiB"),
    }
}
