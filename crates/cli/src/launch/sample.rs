//! Sample of a few attempts of the job, run on this machine to estimate time, memory and disk space of all.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::{Job, redirected};
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::disk_space::{SAMPLE, bytes_below};
use genmanip_workspace::shard::Shard;

/// Interval between memory measurements of the sample, short against an attempt (seconds).
const LOOK: Duration = Duration::from_millis(20);

/// Measured resources of the sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Sample {
    /// Number of attempts of the sample.
    pub attempts: usize,
    /// Wall-clock time of all these attempts, on as many cores as a shard has, s.
    pub wall_s: f64,
    /// Peak resident memory, bytes.
    pub peak_bytes: u64,
    /// Disk space of their output, bytes.
    pub disk_bytes: u64,
}

/// Runs a small, evenly spread shard of the job's attempts, in a scratch folder that is removed afterwards, and
/// measures them.
///
/// The folder is created inside `beside`, which should be on the disk of the shards; in the system's temporary folder
/// if
/// `None`.
///
/// # Errors
/// When the scratch folder cannot be made, or the program cannot be started or fails; the shards would fail, too.
pub fn measure(job: &Job, program: &Path, beside: Option<&Path>) -> Result<Sample, WorkspaceError> {
    let failed = |error: std::io::Error| WorkspaceError::broken("cannot make a folder for the sample", error);
    let mut builder = tempfile::Builder::new();
    let scratch = match beside {
        None => builder.tempdir().map_err(failed)?,
        Some(folder) => {
            fs::create_dir_all(folder).map_err(failed)?;
            builder.prefix(".sample-").tempdir_in(folder).map_err(failed)?
        }
    };
    let folder = scratch.path().join("sample");
    let shards = job.attempts.div_ceil(SAMPLE);
    let attempts = job.attempts.div_ceil(shards);
    let mut command = Command::new(program);
    command.args(redirected(&job.arguments, &folder));
    command.args(["--shard", &format!("0/{shards}"), "--workers", &job.cpus.to_string(), "--quiet"]);
    let begun = Instant::now();
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .map_err(|error| WorkspaceError::broken(format!("cannot start {}", program.display()), error))?;
    let mut peak_bytes = 0;
    let status = loop {
        peak_bytes = peak_bytes.max(resident_bytes(child.id()));
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) => thread::sleep(LOOK),
            Err(error) => return Err(WorkspaceError::broken("the sample cannot be waited for", error)),
        }
    };
    let wall_s = begun.elapsed().as_secs_f64();
    // Exit code 1: some task has no verified demonstration, which is a valid result.
    if !matches!(status.code(), Some(0 | 1)) || !folder.is_dir() {
        return Err(WorkspaceError::input(format!("the sample of {attempts} attempts ended with {status}"))
            .with_hint("what it said stands above; the shards would end like it"));
    }
    // The shards of the job share one record of the run, which holds all tasks, so the sample measures one shard of it.
    let shard = Shard::new(0, shards).map_or_else(|_| folder.clone(), |shard| folder.join(shard.name()));
    let record = fs::metadata(shard.join("run.json")).map_or(0, |about| about.len());
    let disk_bytes = bytes_below(&shard).saturating_sub(record);
    Ok(Sample { attempts, wall_s, peak_bytes, disk_bytes })
}

/// Peak resident memory of a process, bytes (Linux); 0 if unknown.
fn resident_bytes(process: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches("kB").trim().parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}
