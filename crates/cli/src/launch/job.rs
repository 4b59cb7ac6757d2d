//! Job array of a cluster, and the resources of its shards.

use std::path::{Path, PathBuf};

use serde::Serialize;

/// Scheduler that runs the shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cluster {
    /// An array job of Slurm, `sbatch`.
    Slurm,
    /// An indexed job of Kubernetes, `kubectl apply`.
    Kubernetes,
    /// This machine, with a limited number of shards at the same time.
    Local,
}

/// Job array that runs `collect` in shards.
#[derive(Clone, Debug)]
pub struct Job {
    /// Scheduler to submit to.
    pub cluster: Cluster,
    /// Path of this program on the machines of the cluster.
    pub program: PathBuf,
    /// Arguments of the program from `collect` on, without `--shard` and `--workers`.
    pub arguments: Vec<String>,
    /// Folder for the shards' folders; it must be reachable under this path on all machines.
    pub out: PathBuf,
    /// Number of shards.
    pub shards: usize,
    /// Number of attempts of all shards together.
    pub attempts: usize,
    /// Number of cores per shard.
    pub cpus: usize,
    /// Maximum number of shards that run at the same time.
    pub at_once: usize,
    /// Container image and volume, for Kubernetes; `None` for other schedulers.
    pub container: Option<Container>,
}

/// Container image and shared volume of a Kubernetes job.
#[derive(Clone, Debug)]
pub struct Container {
    /// Container image that contains this program.
    pub image: String,
    /// Name of the persistent volume claim for inputs and output.
    pub claim: String,
    /// Mount point of the volume, which is also the working directory.
    pub mount: PathBuf,
}

/// Resources to request for the shards.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Need {
    /// Wall-clock limit of a shard, minutes.
    pub minutes: u64,
    /// Memory limit of a shard, MiB.
    pub memory_mib: u64,
    /// Expected disk space of all shards together, MiB.
    pub disk_mib: u64,
    /// Expected core hours of all shards together, without a safety margin.
    pub core_hours: f64,
}

/// The arguments with the value of `--out` replaced by this folder.
pub fn redirected(arguments: &[String], out: &Path) -> Vec<String> {
    let mut redirected = Vec::new();
    let mut is_folder = false;
    for argument in arguments {
        match argument.as_str() {
            _ if is_folder => is_folder = false,
            "--out" => is_folder = true,
            other if other.starts_with("--out=") => {}
            other => redirected.push(other.to_owned()),
        }
    }
    redirected.extend(["--out".to_owned(), out.display().to_string()]);
    redirected
}
