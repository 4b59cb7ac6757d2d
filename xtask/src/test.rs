//! `cargo xtask test`: everything CI runs, cheapest first, stopping at the first failure, with the time of each phase.
//!
//! The phase [`BESIDE`] runs at the same time as those between it and the tests.

use crate::command_line::{OPT_IN, PHASES};
use crate::features::{ALL, LEARN};
use crate::problem::{Problem, Result};
use crate::process::{self, Workspace};
use crate::{docs, features, real, setup, tidy, web, wheel};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Phase that mostly waits for a browser; the tests, which use all cores, wait for it.
const BESIDE: &str = "web";

/// Result of a phase that did not fail.
enum Outcome {
    Passed(String),
    /// With the reason; never silently.
    Skipped(String),
}

/// Runs one phase of [`PHASES`].
fn phase(name: &str, workspace: &Workspace) -> Result<Outcome> {
    match name {
        "setup" => set_up(workspace),
        "fmt" => {
            let hint = "run `cargo fmt --all`".to_owned();
            cargo(workspace, &["fmt", "--all", "--check"]).map_err(|problem| Problem { hint, ..problem })
        }
        "tidy" => tidy::run(&workspace.root, &[]).and_then(|()| features::check(workspace)).map(|()| passed()),
        "deny" => if_installed(workspace, "cargo-deny", &["check", "licenses", "bans", "sources"]),
        "typos" => if_installed(workspace, "typos", &[]),
        "clippy" => lints(workspace),
        "doc" => documentation(workspace),
        "build" => build(workspace).map(|()| passed()),
        "link check" => link_check(workspace),
        "bytes" => same_bytes(workspace),
        "web" => web_page(workspace),
        "python" => python_wheel(workspace),
        "docs" => documentation_blocks(workspace),
        "test" => tests(workspace),
        "real" => franka_arm(workspace),
        other => unreachable!("{other} is no phase"),
    }
}

/// All phases but [`OPT_IN`], or those named; prints the table whether they pass or not.
pub fn run(workspace: &Workspace, chosen: &[String]) -> Result {
    if let Some(wrong) = chosen.iter().find(|name| !PHASES.contains(&name.as_str())) {
        return Err(Problem {
            what: format!("there is no phase `{wrong}`"),
            expected: PHASES.join(", "),
            hint: format!("without a name all phases run but {}", OPT_IN.join(", ")),
        });
    }
    let (mut table, mut result, mut beside) = (Vec::new(), Ok(()), None);
    let is_chosen = |name: &&str| match chosen {
        [] => !OPT_IN.contains(name),
        _ => chosen.iter().any(|one| one == name),
    };
    let mut end = |name: &'static str, time: Duration, outcome: Result<Outcome>| {
        let said = match &outcome {
            Ok(Outcome::Passed(note)) => note.clone(),
            Ok(Outcome::Skipped(reason)) => format!("skipped: {reason}"),
            Err(_) => "FAILED".into(),
        };
        table.push((name, time, said));
        outcome.map(drop).map_err(|problem| Problem { what: format!("phase `{name}`: {}", problem.what), ..problem })
    };
    let phases: Vec<&str> = PHASES.into_iter().filter(is_chosen).collect();
    let start = Instant::now();
    for &name in &phases {
        if name == BESIDE && phases.len() > 1 {
            beside = Some(start_beside(workspace)?);
            continue;
        }
        if name == "test" {
            result = beside.take().map_or(Ok(()), |running| finish_beside(running, &mut end));
        }
        if result.is_ok() {
            eprintln!("\n== {name}");
            let start = Instant::now();
            let outcome = phase(name, workspace);
            result = end(name, start.elapsed(), outcome);
        }
        if result.is_err() {
            break;
        }
    }
    let late = beside.map_or(Ok(()), |running| finish_beside(running, &mut end));
    println!("\n{}", render(&table, start.elapsed()));
    result.and(late)
}

/// A phase in a process of its own: its time and its outcome, with its output.
type Beside = JoinHandle<(Duration, std::io::Result<std::process::Output>)>;

fn start_beside(workspace: &Workspace) -> Result<Beside> {
    eprintln!("\n== {BESIDE} (beside the next phases; its output comes at its end)");
    let xtask = std::env::current_exe().map_err(|error| process::cannot_start("xtask", &error))?;
    let mut command = workspace.command(xtask);
    command.args(["test", BESIDE]).stdin(Stdio::null());
    Ok(thread::spawn(move || {
        let start = Instant::now();
        let output = command.output();
        (start.elapsed(), output)
    }))
}

fn finish_beside(running: Beside, end: &mut impl FnMut(&'static str, Duration, Result<Outcome>) -> Result) -> Result {
    let (time, output) = running.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    let output = output.map_err(|error| process::cannot_start("xtask", &error))?;
    eprintln!("\n== {BESIDE}\n{}", String::from_utf8_lossy(&output.stderr));
    let printed = String::from_utf8_lossy(&output.stdout);
    println!("{printed}");
    let outcome = if output.status.success() {
        // The row of its own table, without name and time.
        let row = printed.lines().rfind(|line| line.starts_with(BESIDE)).unwrap_or_default();
        Ok(Outcome::Passed(row.split_whitespace().skip(2).collect::<Vec<_>>().join(" ")))
    } else {
        Err(process::failed(&format!("xtask test {BESIDE}"), &output.status.to_string(), ""))
    };
    end(BESIDE, time, outcome)
}

fn passed() -> Outcome {
    Outcome::Passed("ok".into())
}

fn in_ci() -> bool {
    std::env::var("CI").is_ok_and(|value| value == "true" || value == "1")
}

/// The simulator is needed by everybody; without the Python environment the tests that need it say so and skip, but in
/// CI a skip would hide that the independent reader never ran.
fn set_up(workspace: &Workspace) -> Result<Outcome> {
    setup::simulator(workspace)?;
    match setup::python_environment(workspace) {
        Ok(_) => Ok(passed()),
        Err(problem) if in_ci() => Err(problem),
        Err(problem) => {
            eprintln!("{problem}");
            Ok(Outcome::Skipped("no Python environment, so tests of exported datasets skip; a failure in CI".into()))
        }
    }
}

fn cargo(workspace: &Workspace, args: &[&str]) -> Result<Outcome> {
    process::visible(&mut with_python(workspace, workspace.cargo(args.iter().copied()))).map(|()| passed())
}

/// Tests find the independent reader through this variable, which is unset when there is none.
fn with_python(workspace: &Workspace, mut command: Command) -> Command {
    let python = workspace.root.join(".python/bin/python");
    if python.exists() {
        command.env("GENMANIP_PYTHON", python);
    }
    command
}

fn if_installed(workspace: &Workspace, program: &str, args: &[&str]) -> Result<Outcome> {
    if process::output(workspace.command(program).arg("--version")).is_err() {
        return Ok(Outcome::Skipped(format!("{program} is not installed")));
    }
    process::visible(workspace.command(program).args(args)).map(|()| passed())
}

/// The programs, all libraries and all tests.
fn build(workspace: &Workspace) -> Result {
    process::visible(&mut workspace.cargo(["test", "--release", "--no-run"].into_iter().chain(ALL)))
}

/// Lints of everything, then of libraries and programs without learned policies, which no other phase compiles.
fn lints(workspace: &Workspace) -> Result<Outcome> {
    for which in [["--all-targets"].into_iter().chain(ALL).collect::<Vec<_>>(), vec!["--workspace"]] {
        let all = ["clippy", "--release"].into_iter().chain(which);
        process::visible(&mut workspace.cargo(all.chain(["--", "-D", "warnings"])))?;
    }
    Ok(passed())
}

fn documentation(workspace: &Workspace) -> Result<Outcome> {
    let mut cargo = workspace.cargo(["doc", "--release", "--workspace", "--no-deps", "--quiet"]);
    process::visible(cargo.env("RUSTDOCFLAGS", "-D warnings")).map(|()| passed())
}

/// README.md and the guides show commands that work.
fn documentation_blocks(workspace: &Workspace) -> Result<Outcome> {
    build(workspace)?;
    docs::run(workspace, &[], docs::Blocks::Usual).map(Outcome::Passed)
}

/// The program finds the simulator by itself: `command` has removed the library path that cargo would give it.
/// Tests and doctests show the same under cargo, which adds no folder outside of the target folder.
fn link_check(workspace: &Workspace) -> Result<Outcome> {
    build(workspace)?;
    process::visible(with_python(workspace, workspace.command(workspace.genmanip()?)).arg("doctor"))?;
    Ok(passed())
}

/// Rendered images have the same bytes with SIMD registers of any width: an example built for any processor, against the
/// usual build on this one.
fn same_bytes(workspace: &Workspace) -> Result<Outcome> {
    #[cfg(target_arch = "x86_64")]
    let has_wide = std::arch::is_x86_feature_detected!("avx2");
    #[cfg(not(target_arch = "x86_64"))]
    let has_wide = false;
    if !has_wide {
        return Ok(Outcome::Skipped("this processor has no wide registers (AVX2)".into()));
    }
    // The usual one with the features of the tests' own build, so that only the other one is built anew.
    let usual = ALL.as_slice();
    let other = ["--package", "genmanip-render", "--no-default-features"].as_slice();
    let pictures = |which: &[&str]| {
        let build = ["build", "--release", "--example", "same_bytes"];
        process::visible(&mut workspace.cargo(build.iter().chain(which).copied()))?;
        process::output(&mut workspace.command(workspace.genmanip()?.with_file_name("examples/same_bytes")))
    };
    let (wide, plain) = (pictures(usual)?, pictures(other)?);
    match wide.lines().zip(plain.lines()).find(|(wide, plain)| wide != plain) {
        None if wide.lines().count() == plain.lines().count() => {
            Ok(Outcome::Passed(format!("{} image channels are the same", wide.lines().count())))
        }
        difference => Err(Problem {
            what: "images depend on the width of the processor's registers".into(),
            expected: difference.map_or_else(|| "as many lines".into(), |(_, plain)| plain.into()),
            hint: difference.map_or_else(String::new, |(wide, _)| {
                format!("with wide registers it is `{wide}`; a sum was taken in another order, or rounded once instead of twice")
            }),
        }),
    }
}

/// The page needs packages that only the network has; as in [`set_up`], a skip is a failure in CI.
fn web_page(workspace: &Workspace) -> Result<Outcome> {
    match web::packages(workspace) {
        Ok(()) => web::test(workspace, in_ci()).map(Outcome::Passed),
        Err(problem) if in_ci() => Err(problem),
        Err(problem) => {
            eprintln!("{problem}");
            Ok(Outcome::Skipped("no packages to build the studio's page with; a failure in CI".into()))
        }
    }
}

/// The wheel needs packages that only the network has; as in [`set_up`], a skip is a failure in CI.
fn python_wheel(workspace: &Workspace) -> Result<Outcome> {
    match wheel::environment(workspace) {
        Ok(()) => wheel::test(workspace).map(|()| passed()),
        Err(problem) if in_ci() => Err(problem),
        Err(problem) => {
            eprintln!("{problem}");
            Ok(Outcome::Skipped("no Python environment to build the wheel in; a failure in CI".into()))
        }
    }
}

/// The simulated arm needs packages that only the network has.
fn franka_arm(workspace: &Workspace) -> Result<Outcome> {
    process::visible(&mut workspace.cargo(["build", "--release", "--bins"].into_iter().chain(LEARN)))?;
    Ok(real::run(workspace)?.map_or_else(passed, Outcome::Skipped))
}

/// Unit, integration and documentation tests; adds up what they report, since cargo itself never does.
fn tests(workspace: &Workspace) -> Result<Outcome> {
    let test = ["test", "--release", "--no-fail-fast"];
    let mut command = with_python(workspace, workspace.cargo(test.into_iter().chain(ALL)));
    let line = process::shown(&command);
    eprintln!("$ {line}");
    let mut child = command.stdout(Stdio::piped()).spawn().map_err(|error| process::cannot_start(&line, &error))?;
    let mut tally = Tally::default();
    for text in child.stdout.take().into_iter().flat_map(|out| BufReader::new(out).split(b'\n')).map_while(|l| l.ok()) {
        let text = String::from_utf8_lossy(&text);
        println!("{text}");
        tally.add(&text);
    }
    let status = child.wait().map_err(|error| process::cannot_start(&line, &error))?;
    println!("\n{} passed, {} failed, {} skipped", tally.passed, tally.failed, tally.skipped);
    if !status.success() {
        return Err(process::failed(&line, &status.to_string(), ""));
    }
    Ok(Outcome::Passed(format!("{} passed, {} ignored", tally.passed, tally.skipped)))
}

/// Sums of cargo's `test result:` lines.
#[derive(Default, Debug, PartialEq)]
struct Tally {
    passed: u64,
    failed: u64,
    skipped: u64,
}

impl Tally {
    fn add(&mut self, line: &str) {
        let Some(counts) = line.strip_prefix("test result: ").and_then(|rest| rest.split_once(". ")) else {
            return;
        };
        for count in counts.1.split("; ") {
            let mut words = count.split_whitespace();
            let number = words.next().and_then(|word| word.parse::<u64>().ok()).unwrap_or(0);
            match words.next() {
                Some("passed") => self.passed += number,
                Some("failed") => self.failed += number,
                Some("ignored") => self.skipped += number,
                _ => {}
            }
        }
    }
}

/// Table of phases and the time of all, which is less than their sum where some ran at the same time.
fn render(table: &[(&str, Duration, String)], total: Duration) -> String {
    let mut text = format!("{:<12} {:>8}  result\n", "phase", "seconds");
    for (name, time, said) in table {
        text += &format!("{name:<12} {:>8.1}  {said}\n", time.as_secs_f64());
    }
    text + &format!("{:<12} {:>8.1}", "total", total.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_added_up() {
        let mut tally = Tally::default();
        for line in [
            "test a ... ok",
            "test result: ok. 12 passed; 0 failed; 1 ignored; 0 measured; 3 filtered out; finished in 0.02s",
            "test result: FAILED. 2 passed; 1 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.02s",
        ] {
            tally.add(line);
        }
        assert_eq!(tally, Tally { passed: 14, failed: 1, skipped: 1 });
    }

    #[test]
    fn the_table_names_phase_time_and_result() {
        let table = [("fmt", Duration::from_millis(1250), "ok".to_owned())];
        assert_eq!(
            render(&table, Duration::from_millis(1250)),
            "phase         seconds  result\nfmt               1.2  ok\ntotal             1.2"
        );
    }
}
