//! Job array and its resources.

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
    /// This machine, some shards at a time.
    Local,
}

/// Job array to be launched.
#[derive(Clone, Debug)]
pub struct Job {
    /// Scheduler.
    pub cluster: Cluster,
    /// The program on the machines of the cluster.
    pub program: PathBuf,
    /// `collect` and what follows it, without `--shard` and `--workers`.
    pub arguments: Vec<String>,
    /// Folder that the shards' folders come into; disks of all machines must have it under this name.
    pub out: PathBuf,
    /// Parts that the work is divided into.
    pub shards: usize,
    /// Attempts of all shards together.
    pub attempts: usize,
    /// Cores of each shard.
    pub cpus: usize,
    /// Shards at the same time.
    pub at_once: usize,
    /// Image of the containers and the volume claim that is mounted in them; of Kubernetes only.
    pub container: Option<Container>,
}

/// Container image and shared volume of a Kubernetes job.
#[derive(Clone, Debug)]
pub struct Container {
    /// Image with this program in it.
    pub image: String,
    /// Persistent volume claim that holds inputs and output.
    pub claim: String,
    /// Mount point of the volume, which is also the working directory.
    pub mount: PathBuf,
}

/// Resources that the shards need.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Need {
    /// Wall-clock limit, minutes.
    pub minutes: u64,
    /// Memory limit, MiB.
    pub memory_mib: u64,
    /// Disk space of all shards together, MiB.
    pub disk_mib: u64,
    /// Core hours of all shards together, without any reserve.
    pub core_hours: f64,
}

/// The arguments with another folder in the place of the one behind `--out`.
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
