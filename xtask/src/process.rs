//! The repository's folder, and other programs started from it.

use crate::problem::{OnPath, Problem, Result};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// The repository this program belongs to.
pub struct Workspace {
    pub root: PathBuf,
}

impl Workspace {
    /// The folder above this package: as cargo says at run time, else as it was when this program was built.
    pub fn find() -> Self {
        let here = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
        let root = Path::new(&here).parent().map_or_else(|| PathBuf::from("."), Path::to_path_buf);
        Self { root }
    }

    /// `program`, started in the root, without what `cargo run` put into our own environment.
    ///
    /// A cargo inside a cargo would otherwise see other variables than one started by hand and build things twice, and
    /// the library path that cargo sets would hide a program that cannot find the simulator by itself.
    pub fn command(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        command.current_dir(&self.root).env_remove("LD_LIBRARY_PATH").env_remove("DYLD_FALLBACK_LIBRARY_PATH");
        for (name, _) in std::env::vars_os() {
            let text = name.to_string_lossy();
            if text.starts_with("CARGO_PKG_") || text.starts_with("CARGO_MANIFEST_") || text.starts_with("CARGO_BIN_") {
                command.env_remove(&name);
            }
        }
        command
    }

    /// The cargo that started this program, with these arguments.
    pub fn cargo<'a>(&self, args: impl IntoIterator<Item = &'a str>) -> Command {
        let mut command = self.command(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        command.args(args);
        command
    }

    /// Cargo's target folder; cargo is asked, because variables and settings files may move it.
    pub fn target_dir(&self) -> Result<PathBuf> {
        let metadata = output(&mut self.cargo(["metadata", "--no-deps", "--format-version", "1"]))?;
        json_string(&metadata, "target_directory").map(PathBuf::from).ok_or_else(|| Problem {
            what: "`cargo metadata` does not say where cargo builds".into(),
            expected: "a field `target_directory`".into(),
            hint: "is this a released cargo? `cargo --version` says".into(),
        })
    }

    /// The built `genmanip` program.
    pub fn genmanip(&self) -> Result<PathBuf> {
        Ok(self.target_dir()?.join("release").join(format!("genmanip{}", std::env::consts::EXE_SUFFIX)))
    }
}

/// The first string value of `key` in JSON text, simple escapes resolved; enough for one flat field of cargo's output.
fn json_string(json: &str, key: &str) -> Option<String> {
    let start = json.find(&format!("\"{key}\":\""))? + key.len() + 4;
    let mut value = String::new();
    let mut chars = json[start..].chars();
    loop {
        match chars.next()? {
            '"' => return Some(value),
            '\\' => value.push(chars.next()?),
            other => value.push(other),
        }
    }
}

/// Runs a command whose output the person should see.
pub fn visible(command: &mut Command) -> Result {
    let line = shown(command);
    eprintln!("$ {line}");
    let status = command.status().map_err(|error| cannot_start(&line, &error))?;
    if status.success() { Ok(()) } else { Err(failed(&line, &status.to_string(), "")) }
}

/// Runs a command quietly and gives what it printed; what it complained about becomes part of the error.
pub fn output(command: &mut Command) -> Result<String> {
    let line = shown(command);
    let output = command.stdin(Stdio::null()).output().map_err(|error| cannot_start(&line, &error))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let complaint = String::from_utf8_lossy(&output.stderr);
    let complaint = if complaint.trim().is_empty() { String::from_utf8_lossy(&output.stdout) } else { complaint };
    Err(failed(&line, &output.status.to_string(), &complaint))
}

pub fn cannot_start(line: &str, error: &std::io::Error) -> Problem {
    let program = line.split(' ').next().unwrap_or(line);
    Problem {
        what: format!("cannot start `{line}`: {error}"),
        expected: format!("the program `{program}`"),
        hint: format!("install `{program}`, or put it on the PATH"),
    }
}

pub fn failed(line: &str, status: &str, complaint: &str) -> Problem {
    const LAST_LINES: usize = 6;
    let lines: Vec<&str> = complaint.lines().filter(|line| !line.trim().is_empty()).collect();
    let tail = &lines[lines.len().saturating_sub(LAST_LINES)..];
    let said = tail.iter().map(|line| format!("\n    {}", line.trim())).collect::<String>();
    Problem {
        what: format!("`{line}` failed ({status}){said}"),
        expected: "the command to succeed".into(),
        hint: "its own message above says why".into(),
    }
}

/// The command as a person would type it.
pub fn shown(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let name = program.file_name().unwrap_or(command.get_program()).to_string_lossy().into_owned();
    command.get_args().fold(name, |line, arg| format!("{line} {}", arg.to_string_lossy()))
}

/// A process that ends with its owner.
pub struct Ending(pub Child);

impl Drop for Ending {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Puts a finished file or link in place; who looks meanwhile sees the old one or the new one, never half of it.
pub fn rename(from: &Path, to: &Path) -> Result {
    std::fs::rename(from, to).on("put in place", to)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn target_directory_is_read_from_cargo_output() {
        let json = r#"{"packages":[],"target_directory":"/a \"b\"\\c","version":1}"#;
        assert_eq!(json_string(json, "target_directory").as_deref(), Some(r#"/a "b"\c"#));
        assert_eq!(json_string(json, "build_directory"), None);
    }

    #[test]
    fn a_failed_command_shows_the_end_of_its_complaint() {
        let complaint = (1..=20).map(|i| format!("line {i}\n")).collect::<String>();
        let problem = failed("pip download x", "exit status: 1", &complaint).to_string();
        assert!(problem.contains("line 20") && !problem.contains("line 14\n"), "{problem}");
    }
}
