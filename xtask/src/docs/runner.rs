//! Runs the steps of a page in a folder of its own.

use super::plan::{Language, Step};
use crate::problem::{OnPath, Problem, Result};
use std::ffi::OsString;
use std::fs::{self, File};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Longest time of a block.
const PATIENCE: Duration = Duration::from_secs(240);
/// Longest time until a block in the background is ready.
const UNTIL_READY: Duration = Duration::from_secs(60);
/// Time between asking a block to end and killing it.
const UNTIL_KILLED: Duration = Duration::from_secs(5);
/// Lines of output that a failure shows.
const SHOWN_LINES: usize = 30;

/// Environment of all blocks of a page.
pub struct Runner {
    /// Path of the page from the repository's root.
    pub page: String,
    /// Folder in which the first block starts.
    pub folder: PathBuf,
    /// Folder for scripts, output and state, apart from what blocks make.
    pub logs: PathBuf,
    /// Value of PATH.
    pub path: OsString,
    /// Interpreter of Python blocks, if there is one.
    pub python: Option<PathBuf>,
    /// Blocks in the background, which end with the page.
    running: Vec<Background>,
}

/// A block in the background, or a process that ends with its owner.
struct Background {
    line: usize,
    child: Child,
    log: PathBuf,
}

impl Drop for Background {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

/// Ends a child with all processes below it. They are in the group of this program, so that Ctrl-C ends them too.
fn end(child: &mut Child) {
    if matches!(child.try_wait(), Ok(None)) {
        signal("-TERM", child.id());
        let begun = Instant::now();
        while matches!(child.try_wait(), Ok(None)) && begun.elapsed() < UNTIL_KILLED {
            sleep(Duration::from_millis(20));
        }
        if matches!(child.try_wait(), Ok(None)) {
            signal("-KILL", child.id());
        }
    }
    let _ = child.wait();
}

/// Sends a signal to a process and all below it.
fn signal(signal: &str, root: u32) {
    // `PID (NAME) STATE PARENT …`
    let parent = |id: u32| -> Option<u32> {
        let state = fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
        state.rsplit(')').next()?.split_whitespace().nth(1)?.parse().ok()
    };
    let ids = fs::read_dir("/proc").into_iter().flatten().flatten();
    let ids = ids.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    let known: Vec<(u32, u32)> = ids.filter_map(|id| Some((id, parent(id)?))).collect();
    let mut below = vec![root];
    let mut next = 0;
    while let Some(&id) = below.get(next) {
        below.extend(known.iter().filter(|(_, parent)| *parent == id).map(|(id, _)| *id));
        next += 1;
    }
    let ids = below.iter().map(u32::to_string);
    let _ = Command::new("kill").arg(signal).args(ids).stdout(Stdio::null()).stderr(Stdio::null()).status();
}

impl Runner {
    /// A page begins in its folder, without variables of another one.
    pub fn new(page: &str, folder: PathBuf, logs: PathBuf, path: OsString, python: Option<PathBuf>) -> Self {
        let _ = fs::remove_file(logs.join("state.sh"));
        Self { page: page.to_owned(), folder, logs, path, python, running: Vec::new() }
    }

    /// Runs a step to its end, or until it is ready when it is kept in the background.
    pub fn run(&mut self, step: &Step) -> Result {
        let name = format!("{:04}-{}", step.line, fs::read_dir(&self.logs).on("read", &self.logs)?.count());
        let [script, python_file, log] = ["sh", "py", "txt"].map(|kind| self.logs.join(format!("{name}.{kind}")));
        fs::write(&script, self.script(step, &python_file)?).on("write", &script)?;
        let output = File::create(&log).on("write", &log)?;
        let errors = output.try_clone().on("write", &log)?;
        let mut command = Command::new("bash");
        command.args(["--noprofile", "--norc", "-euo", "pipefail"]).arg(&script).current_dir(&self.folder);
        command.env("PATH", &self.path).env("NO_COLOR", "1").env("DOCS_STATE", self.logs.join("state.sh"));
        for name in ["GENMANIP_PACKS", "LD_LIBRARY_PATH", "DYLD_FALLBACK_LIBRARY_PATH"] {
            command.env_remove(name);
        }
        command.stdin(Stdio::null()).stdout(output).stderr(errors);
        let child = command.spawn().map_err(|error| crate::process::cannot_start("bash", &error))?;
        if let Some(port) = step.background {
            self.running.push(Background { line: step.line, child, log });
            return self.wait_until_ready(port);
        }
        let code = wait(child)?;
        if code == Some(step.expected) {
            return Ok(());
        }
        Err(self.failed(step.line, &ended(code), &format!("exit code {}", step.expected), &log))
    }

    /// Ends the blocks in the background; an error if one ended before with an error.
    pub fn finish(&mut self) -> Result {
        for mut one in std::mem::take(&mut self.running) {
            if let Ok(Some(status)) = one.child.try_wait()
                && !status.success()
            {
                return Err(self.failed(
                    one.line,
                    &ended(status.code()),
                    "a server that runs until the page ends",
                    &one.log,
                ));
            }
        }
        Ok(())
    }

    /// The block, with the folder and the exported variables of the shell blocks before it.
    fn script(&self, step: &Step, python_file: &Path) -> Result<String> {
        let before = "if [ -e \"$DOCS_STATE\" ]; then . \"$DOCS_STATE\"; fi\n";
        let keep = "trap '{ export -p; printf \"cd %q\\n\" \"$PWD\"; } > \"$DOCS_STATE\"' EXIT\n";
        let python = match (step.language, &self.python) {
            (Language::Shell, _) if step.background.is_some() => return Ok(format!("{before}{}", step.script)),
            (Language::Shell, _) => return Ok(format!("{before}{keep}{}", step.script)),
            (Language::Python, Some(python)) => python.display(),
            (Language::Python, None) => {
                return Err(Problem {
                    what: format!("{}:{}: no Python with the package", self.page, step.line),
                    expected: "an interpreter".into(),
                    hint: "`cargo xtask test python` makes one".into(),
                });
            }
        };
        fs::write(python_file, &step.script).on("write", python_file)?;
        Ok(format!("{before}exec '{python}' '{}'\n", python_file.display()))
    }

    fn wait_until_ready(&mut self, port: Option<u16>) -> Result {
        let begun = Instant::now();
        while let Some(one) = self.running.last_mut() {
            let has_ended = !matches!(one.child.try_wait(), Ok(None));
            let is_ready = match port {
                Some(port) => TcpStream::connect(("127.0.0.1", port)).is_ok(),
                None => fs::metadata(&one.log).is_ok_and(|file| file.len() > 0),
            };
            if is_ready && !has_ended {
                return Ok(());
            }
            if has_ended || begun.elapsed() > UNTIL_READY {
                let what = if has_ended { "ended before it was ready" } else { "is not ready" };
                let wanted =
                    port.map_or_else(|| "a line of output".into(), |port| format!("a listener on port {port}"));
                let (line, log) = (one.line, one.log.clone());
                return Err(self.failed(line, what, &wanted, &log));
            }
            sleep(Duration::from_millis(50));
        }
        Ok(())
    }

    fn failed(&self, line: usize, what: &str, expected: &str, log: &Path) -> Problem {
        let said = fs::read(log).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default();
        let lines: Vec<&str> = said.lines().collect();
        let tail = &lines[lines.len().saturating_sub(SHOWN_LINES)..];
        let tail = tail.iter().map(|line| format!("\n    {line}")).collect::<String>();
        Problem {
            what: format!("{}:{line}: the block {what}{tail}", self.page),
            expected: expected.into(),
            hint: format!("it ran in {}; its output is {}", self.folder.display(), log.display()),
        }
    }
}

/// Exit code; `None` after a signal or when the time is over.
fn wait(child: Child) -> Result<Option<i32>> {
    let mut child = Background { line: 0, child, log: PathBuf::new() };
    let begun = Instant::now();
    let mut pause = Duration::from_millis(1);
    while begun.elapsed() < PATIENCE {
        if let Some(status) = child.child.try_wait().on("wait for", Path::new("bash"))? {
            return Ok(status.code());
        }
        sleep(pause);
        pause = (pause * 2).min(Duration::from_millis(50));
    }
    Ok(None)
}

fn ended(code: Option<i32>) -> String {
    code.map_or_else(
        || format!("was killed, or took more than {} s", PATIENCE.as_secs()),
        |code| format!("ended with exit code {code}"),
    )
}

#[cfg(test)]
mod tests {
    use super::super::plan;
    use super::*;

    const FIXTURE: &str = include_str!("../../testdata/docs/fixture.md");

    fn runner(name: &str) -> Runner {
        let place = std::env::temp_dir().join(format!("xtask-docs-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&place);
        let (folder, logs) = (place.join("page"), place.join("logs"));
        fs::create_dir_all(&folder).unwrap();
        fs::create_dir_all(&logs).unwrap();
        Runner::new("fixture.md", folder, logs, std::env::var_os("PATH").unwrap(), None)
    }

    /// The first error of a page.
    fn run(name: &str, page: &str) -> Option<Problem> {
        let mut runner = runner(name);
        let steps = plan::read("fixture.md", page).unwrap().steps;
        let steps = steps.iter().filter(|step| step.when == plan::When::Always);
        let result = steps.map(|step| runner.run(step)).find(Result::is_err).unwrap_or(Ok(()));
        let result = result.and_then(|()| runner.finish());
        let _ = fs::remove_dir_all(runner.logs.parent().unwrap());
        result.err()
    }

    #[test]
    fn the_fixture_page_runs() {
        let problem = run("fixture", FIXTURE);
        assert!(problem.is_none(), "{}", problem.map(|problem| problem.to_string()).unwrap_or_default());
    }

    #[test]
    fn failures_name_the_block_and_show_its_output() {
        for (name, page, said) in [
            (
                "code",
                "\n```sh\necho out; echo why >&2\nfalse\ntrue\n```\n",
                "fixture.md:2: the block ended with exit code 1\n    out\n    why",
            ),
            ("unset", "```sh\necho $NOBODY\n```\n", "fixture.md:1: the block ended with exit code 1"),
            ("fine", "<!-- docs: fails -->\n```sh\ntrue\n```\n", "fixture.md:2: the block ended with exit code 0"),
            (
                "early",
                "<!-- docs: background -->\n```sh\nexit 3\n```\n",
                "fixture.md:2: the block ended before it was ready",
            ),
            (
                "late",
                "<!-- docs: background -->\n```sh\necho $$ > pid; echo ready; until [ -e go ]; do sleep 0.05; done; exit 3\n```\n\
                 ```sh\ntouch go; until grep -q ') Z' /proc/$(cat pid)/stat; do sleep 0.05; done\n```\n",
                "fixture.md:2: the block ended with exit code 3",
            ),
            ("python", "```python\n1\n```\n", "fixture.md:1: no Python"),
        ] {
            let problem = run(name, page).map(|problem| problem.what).unwrap_or_default();
            assert!(problem.contains(said), "{name}: {problem}");
        }
    }
}
