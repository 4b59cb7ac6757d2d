//! One call of the program under limits of memory, CPU time and idle time.

use super::HostileArguments;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::Sandbox;
use crate::LabError;

/// Resource limits of a call.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Address space, MiB (`ulimit -v`); it always exceeds the resident memory.
    pub(super) memory_mib: u64,
    /// CPU time, s (`ulimit -t`).
    pub(super) cpu_s: u64,
    /// Maximum time without any use of CPU time, s, to end calls that block.
    pub(super) idle_s: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { memory_mib: 1024, cpu_s: 10, idle_s: 60 }
    }
}

/// Outcome of a call.
#[derive(Debug)]
pub(super) struct Ended {
    /// Exit code; `None` if a signal ended it.
    pub(super) code: Option<i32>,
    pub(super) stdout: String,
    pub(super) stderr: String,
    /// CPU time that the call used, s.
    pub(super) cpu_s: f64,
    /// Peak resident memory, MiB, sampled while the call ran.
    pub(super) peak_mib: u64,
    signal: Option<i32>,
    /// States of the call's threads, if it was killed for being idle too long.
    waited_for: Option<String>,
}

/// Signals of a call that reached its CPU limit, and of one that was killed for being idle too long.
const SIGXCPU: i32 = 24;
const SIGKILL: i32 = 9;

impl Ended {
    pub(super) fn is_over_memory(&self) -> bool {
        self.stderr.contains("memory allocation of") || self.stderr.contains("capacity overflow")
    }

    pub(super) fn is_hanging(&self) -> bool {
        self.waited_for.is_some() || self.signal == Some(SIGXCPU) || self.signal == Some(SIGKILL)
    }

    /// Description of the exceeded limit: idle with the states of the threads, or CPU time.
    pub(super) fn slowness(&self) -> String {
        match &self.waited_for {
            Some(threads) => format!("too slow (waits without working; its threads: {threads})"),
            None => format!("too slow ({:.1} s of CPU time)", self.cpu_s),
        }
    }

    pub(super) fn has_panicked(&self) -> bool {
        let says = |text: &str| self.stderr.contains(text) || self.stdout.contains(text);
        self.code == Some(101) || self.code.is_none() || says("panicked at") || says("a defect of this program")
    }

    /// First 2,000 characters of standard output, which hold the reasons where a subcommand exits with 1.
    pub(super) fn stdout_if_refused(&self) -> String {
        self.stdout.chars().take(2000).collect()
    }
}

/// Calls `genmanip`, or `genmanip-lab` where the first word is `lab`, in the sandbox; `sh` sets the limits, since a library
/// cannot do that safely between fork and exec.
pub(super) fn run(
    arguments: &HostileArguments,
    call: &[String],
    sandbox: &Sandbox,
    limits: Limits,
) -> Result<Ended, LabError> {
    let (program, call) = match call {
        [first, rest @ ..] if first == "lab" => (&arguments.lab, rest),
        all => (&arguments.program, all),
    };
    let script = format!(
        "ulimit -v {}; ulimit -t {}; ulimit -c 0; ulimit -f 2000000; exec \"$0\" \"$@\"",
        limits.memory_mib << 10,
        limits.cpu_s
    );
    let (out, err) = (sandbox.outside().with_file_name("stdout"), sandbox.outside().with_file_name("stderr"));
    let create = |path: &Path| File::create(path).map_err(|error| LabError::file("write", path, error));
    let before = children_cpu_s();
    let mut child = Command::new("sh")
        .args(["-c", &script])
        .arg(program)
        .args(call)
        .current_dir(sandbox.work())
        .env("HOME", sandbox.outside().join("home"))
        .env("TMPDIR", sandbox.outside().join("tmp"))
        .env("RUST_BACKTRACE", "0")
        .stdin(Stdio::null())
        .stdout(create(&out)?)
        .stderr(create(&err)?)
        .spawn()
        .map_err(|error| LabError::broken("cannot start the program", error))?;
    let (mut pause, mut peak_mib) = (Duration::from_millis(1), 0);
    let (mut used, mut used_at) = (0.0, Instant::now());
    let (status, waited_for) = loop {
        match child.try_wait().map_err(|error| LabError::broken("cannot wait for the program", error))? {
            Some(status) => break (status, None),
            None if used_at.elapsed() > Duration::from_secs(limits.idle_s) => {
                let threads = threads(child.id());
                let _ = child.kill();
                let status = child.wait().map_err(|error| LabError::broken("cannot wait for the program", error))?;
                break (status, Some(threads.join(", ")));
            }
            None => {
                peak_mib = peak_mib.max(peak_mib_of(child.id()));
                let now_used = cpu_s(&child.id().to_string(), OWN);
                // A thread that waits for a slow disk uses no CPU time, which is not the program's fault.
                if now_used > used || threads(child.id()).iter().any(|thread| thread.starts_with(ON_DISK)) {
                    (used, used_at) = (now_used, Instant::now());
                }
                std::thread::sleep(pause);
                pause = (pause * 2).min(Duration::from_millis(20));
            }
        }
    };
    let text = |path: &Path| -> Result<String, LabError> {
        let mut bytes = Vec::new();
        let file = File::open(path).map_err(|error| LabError::file("read", path, error))?;
        file.take(1 << 20).read_to_end(&mut bytes).map_err(|error| LabError::file("read", path, error))?;
        std::fs::remove_file(path).map_err(|error| LabError::file("write", path, error))?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    };
    use std::os::unix::process::ExitStatusExt;
    Ok(Ended {
        code: status.code(),
        signal: status.signal(),
        stdout: text(&out)?,
        stderr: text(&err)?,
        cpu_s: children_cpu_s() - before,
        peak_mib,
        waited_for,
    })
}

/// Peak memory of a process, MiB (Linux); 0 if unknown.
fn peak_mib_of(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.split_whitespace().next()?.parse().ok());
    peak.unwrap_or(0_u64) >> 10
}

/// Indices of the CPU time (user, then system) of a process and of its terminated children among the fields of
/// `/proc/PID/stat` after the program name.
const OWN: usize = 11;
const OF_CHILDREN: usize = 13;

/// State of a thread in uninterruptible sleep, usually waiting for the disk.
const ON_DISK: char = 'D';

/// State and kernel wait channel of each thread of a process (Linux).
fn threads(process: u32) -> Vec<String> {
    let tasks = std::fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten();
    let about = |task: std::fs::DirEntry| {
        let text = |name: &str| std::fs::read_to_string(task.path().join(name)).unwrap_or_default();
        let stat = text("stat");
        let state = stat.rsplit_once(')').and_then(|(_, rest)| rest.split_whitespace().next()).unwrap_or("?");
        format!("{state} in {}", text("wchan"))
    };
    tasks.map(about).collect()
}

/// CPU time of all terminated children of this process, s.
fn children_cpu_s() -> f64 {
    cpu_s("self", OF_CHILDREN)
}

/// CPU time of a process, s (Linux; clock ticks of 10 ms); 0 if it cannot be read.
fn cpu_s(process: &str, first_field: usize) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    let fields = stat.rsplit_once(')').map_or("", |(_, rest)| rest).split_whitespace();
    fields.skip(first_field).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
}
