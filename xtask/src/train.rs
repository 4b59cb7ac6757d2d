//! `cargo xtask test --train`: stock SAC of Stable-Baselines3 learns the built-in task `reach`.

use crate::interop;
use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use crate::{python, wheel};
use std::fs;

const SCRIPT: &str = "examples/python/train_with_sb3.py";
const REQUIREMENTS: &str = "examples/python/train-requirements.txt";
/// A quarter of what two cores have in ten minutes.
const CPU_MINUTES: &str = "5";
/// Smallest share of fresh starts that must succeed.
const MIN_SUCCESS: f64 = 0.95;

/// Trains in an environment of its own, with the wheel of this repository, and compares with the bar.
pub fn run(workspace: &Workspace) -> Result {
    let place = workspace.target_dir()?.join("train");
    fs::create_dir_all(&place).on("make the folder", &place)?;
    let list = workspace.root.join(REQUIREMENTS);
    let listed = fs::read_to_string(&list).on("read", &list)?;
    let python = interop::environment(workspace, "python3", &place.join("python"), &python::names(&listed))?;
    wheel::environment(workspace)?;
    wheel::install(workspace, &python, &wheel::build(workspace)?)?;
    let out = place.join("reach");
    let _ = fs::remove_dir_all(&out);
    let mut training = workspace.command(&python);
    let said = process::output(training.arg(SCRIPT).args(["reach", "--cpu-minutes", CPU_MINUTES, "--out"]).arg(&out))?;
    println!("{said}");
    let bar = || Problem {
        what: format!("{SCRIPT} learned too little of `reach`, or printed no rate"),
        expected: format!("{:.0} % of fresh starts after {CPU_MINUTES} minutes of CPU", 100.0 * MIN_SUCCESS),
        hint: format!("its learning curve is {}", out.join("curve.csv").display()),
    };
    success(&said).filter(|success| *success >= MIN_SUCCESS).map(|_| ()).ok_or_else(bar)
}

/// The share in a line such as `reach: 97.5 % (94.3 to 98.9 %) of 200 episodes`.
fn success(said: &str) -> Option<f64> {
    let line = said.lines().find_map(|line| line.strip_prefix("reach: "))?;
    line.split_whitespace().next()?.parse::<f64>().ok().map(|percent| percent / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_read() {
        assert_eq!(success("4000 steps\nreach: 97.5 % (94.3 to 98.9 %) of 200 episodes\n"), Some(0.975));
        assert_eq!(success("no rate\n"), None);
    }
}
