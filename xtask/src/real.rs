//! `cargo xtask test real`: another project's simulated Franka arm, driven over Franka's own protocol.
//!
//! `python/tests/franka_simulator.py` starts the arm, `genmanip real franka` drives it behind a bridge whose connection has
//! 20 ± 10 ms of delay, and `genmanip-lab bridge` measures.

use crate::interop;
use crate::problem::{Problem, Result};
use crate::process::{self, Ending, Workspace};
use std::io::{BufRead, BufReader, Lines, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

const REQUIREMENTS: &str = "xtask/real-requirements.txt";
const SIMULATOR: &str = "python/tests/franka_simulator.py";
/// Address of the simulated arm, whose ports the protocol fixes.
const HOST: &str = "127.0.0.1";
/// Words of pip about a file that is not the pinned one, which is no reason to skip.
const OTHER_FILE: &str = "DO NOT MATCH THE HASHES";
/// Options of the simulator, and measurements: planned motions, starts and gripper; gripper and collision; lost states.
const ROUNDS: [(&[&str], &[&str]); 3] = [
    (&[], &["--motions", "20", "--drills", "free"]),
    (&["--post"], &["--motions", "0", "--drills", "post"]),
    (&["--drop", "5"], &["--motions", "3"]),
];
/// Error word of the collision in the second round.
const REFLEX: &str = "cartesian_reflex";

/// `cargo xtask setup real`: the environment of the simulated arm.
pub fn set_up(workspace: &Workspace) -> Result {
    environment(workspace).map(|_| eprintln!("real: the environment of the simulated Franka arm is in place"))
}

fn environment(workspace: &Workspace) -> Result<PathBuf> {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        return Err(Problem {
            what: "there is no simulated Franka arm for this system".into(),
            expected: "Linux on x86-64".into(),
            hint: format!("{REQUIREMENTS} has the packages for it alone"),
        });
    }
    interop::hashed_environment(workspace, &workspace.target_dir()?.join("real/python"), REQUIREMENTS)
}

/// All rounds; the reason instead, where the simulated arm is not to be had.
pub fn run(workspace: &Workspace) -> Result<Option<String>> {
    let python = match environment(workspace) {
        Ok(python) => python,
        Err(problem) if problem.what.contains(OTHER_FILE) => return Err(problem),
        Err(problem) => return Ok(Some(problem.what)),
    };
    for (simulated, measured) in ROUNDS {
        round(workspace, &python, simulated, measured)?;
    }
    Ok(None)
}

fn round(workspace: &Workspace, python: &Path, simulated: &[&str], measured: &[&str]) -> Result {
    // A control unit shares its processor with nobody; where this is not permitted, `nice` runs the program all the same.
    let mut simulator = workspace.command("nice");
    simulator
        .args(["-n", "-20"])
        .arg(python)
        .arg(SIMULATOR)
        .arg(HOST)
        .args(simulated)
        .stdin(Stdio::null())
        .stdout(Stdio::piped());
    let started = |program: &str, error: &std::io::Error| process::cannot_start(program, error);
    let mut simulator = Ending(simulator.spawn().map_err(|error| started("python", &error))?);
    let mut said = lines(simulator.0.stdout.take());
    find(&mut said, |line| (line == "ready").then_some(()))?;

    let mut bridge = workspace.command(workspace.genmanip()?);
    bridge.args(["real", "franka", "--host", HOST, "--no-realtime", "--address", "127.0.0.1:0"]);
    // The largest speed of the simulated hand.
    bridge
        .args(["--gripper-speed", "0.05", "--latency-ms", "20", "--jitter-ms", "10"])
        .stdin(Stdio::null())
        .stderr(Stdio::piped());
    let mut bridge = Ending(bridge.spawn().map_err(|error| started("genmanip", &error))?);
    let mut said = lines(bridge.0.stderr.take());
    let url =
        find(&mut said, |line| line.split_whitespace().find(|word| word.starts_with("tcp://")).map(str::to_owned))?;

    let lab = workspace.genmanip()?.with_file_name(format!("genmanip-lab{}", std::env::consts::EXE_SUFFIX));
    let mut lab = workspace.command(lab);
    process::visible(lab.args(["bridge", "--seed", "57", "--count", "0", "--robot", &url]).args(measured))?;

    let report = end(workspace, &mut bridge.0, said)?;
    println!("{report}");
    let wanted =
        if simulated.contains(&"--post") { format!("aborted by the arm: 1 {REFLEX};") } else { "none;".into() };
    if report.contains(&wanted) {
        return Ok(());
    }
    Err(Problem {
        what: "the arm aborted other motions than it should".into(),
        expected: wanted,
        hint: format!("the bridge said: {report}"),
    })
}

/// Interrupts the bridge as Ctrl-C does; returns what it says at its end.
fn end(workspace: &Workspace, bridge: &mut Child, said: Lines<BufReader<impl Read>>) -> Result<String> {
    process::output(workspace.command("kill").args(["-INT", &bridge.id().to_string()]))?;
    let said: Vec<String> = said.map_while(|line| line.ok()).collect();
    let status = bridge.wait().map_err(|error| process::cannot_start("genmanip", &error))?;
    let report = said.iter().skip_while(|line| !line.contains("motions")).cloned().collect::<Vec<_>>().join("\n");
    match status.success() {
        true => Ok(report),
        false => Err(process::failed("genmanip real franka", &status.to_string(), &said.join("\n"))),
    }
}

fn lines<R: Read>(pipe: Option<R>) -> Lines<BufReader<R>> {
    BufReader::new(pipe.expect("the pipe was asked for")).lines()
}

/// First line that is wanted, or what was said instead.
fn find<T>(said: &mut Lines<BufReader<impl Read>>, wanted: impl Fn(&str) -> Option<T>) -> Result<T> {
    let mut before = Vec::new();
    for line in said.map_while(|line| line.ok()) {
        match wanted(&line) {
            Some(found) => return Ok(found),
            None => before.push(line),
        }
    }
    Err(process::failed("the program", "it ended", &before.join("\n")))
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_package_is_pinned_by_its_hash() {
        let list = include_str!("../real-requirements.txt").replace("\\\n", " ");
        let packages: Vec<&str> = list.lines().filter(|line| !line.starts_with('#')).collect();
        assert_eq!(packages.len(), 18, "{packages:?}");
        for package in packages {
            assert!(package.contains("==") && package.contains(" --hash=sha256:"), "{package}");
        }
    }
}
