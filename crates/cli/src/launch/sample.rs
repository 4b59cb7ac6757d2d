//! A few attempts made here, to learn what the others will need.

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

/// Interval between memory measurements of the sample.
const LOOK: Duration = Duration::from_millis(20);

/// Measured resources of some attempts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Sample {
    /// Number of attempts.
    pub attempts: usize,
    /// Wall-clock time of all on the cores of one shard, s.
    pub wall_s: f64,
    /// Peak memory.
    pub peak_bytes: u64,
    /// Disk space of their output.
    pub disk_bytes: u64,
}

/// Makes some of the job's attempts, evenly chosen, in a folder of its own that is removed again, and measures them.
///
/// The folder lies inside `beside`, which should be on the disk of the shards, or where the system keeps such things.
///
/// # Errors
/// When the program cannot be started or fails: then the shards would, too.
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
    // 1: some task has no verified demonstration, which is no fault of the command.
    if !matches!(status.code(), Some(0 | 1)) || !folder.is_dir() {
        return Err(WorkspaceError::input(format!("the sample of {attempts} attempts ended with {status}"))
            .with_hint("what it said stands above; the shards would end like it"));
    }
    // All shards share the record of the run, which holds all tasks.
    let shard = Shard::new(0, shards).map_or_else(|_| folder.clone(), |shard| folder.join(shard.name()));
    let record = fs::metadata(shard.join("run.json")).map_or(0, |about| about.len());
    let disk_bytes = bytes_below(&shard).saturating_sub(record);
    Ok(Sample { attempts, wall_s, peak_bytes, disk_bytes })
}

/// Most memory that a process ever had, as Linux tells; 0 where nothing does.
fn resident_bytes(process: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches("kB").trim().parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}
