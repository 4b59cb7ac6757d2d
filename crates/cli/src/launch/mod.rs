//! Job arrays for clusters: one `collect` per shard, with time and memory limits estimated from a measured sample.
//!
//! This module schedules nothing: its result is a script or a manifest for the cluster's scheduler. Every shard writes
//! to
//! a folder of its own and resumes where it stopped, so a job submitted again does only the missing attempts.

mod job;
mod sample;
mod scripts;

use genmanip_workspace::documents;
use std::fs;
use std::path::PathBuf;

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::{disk_space, shard};

pub use job::{Cluster, Container, Job, Need, redirected};
pub use sample::{Sample, measure};
pub use scripts::script;

/// Maximum wall-clock limit of a shard, minutes: a week.
const MAX_MINUTES: u64 = 7 * 24 * 60;
/// Safety factor on the expected time. Chosen by hand: some tasks take up to three times the mean of a small sample.
const TIME_FACTOR: f64 = 3.0;
/// Time added for starting, reading the catalogue and slower nodes, minutes. Chosen by hand.
const TIME_MINUTES: f64 = 5.0;
/// Safety factor on the sample's peak memory. Chosen by hand: long episodes hold more frames than those of a small
/// sample.
const MEMORY_FACTOR: f64 = 1.5;
/// Memory added to the estimate, MiB. Chosen by hand.
const MEMORY_MIB: f64 = 256.0;

impl Job {
    /// Fails for a job that cannot be launched.
    ///
    /// # Errors
    /// When there are no shards, too many or more than attempts, when a shard has no core or none may run, or when a
    /// container
    /// is missing for Kubernetes or given for another scheduler.
    pub fn check(&self) -> Result<(), WorkspaceError> {
        let refuse = |what: String, hint: &str| Err(WorkspaceError::input(what).with_hint(hint));
        if self.shards == 0 || self.shards > shard::MAX_SHARDS || self.shards > self.attempts {
            let what = format!("{} attempts cannot be divided into {} shards", self.attempts, self.shards);
            return refuse(what, "take between one shard and one per attempt; an attempt takes seconds");
        }
        if self.cpus == 0 || self.at_once == 0 {
            return refuse("a shard needs a core, and some shard must run".into(), "take at least 1 of either");
        }
        match (self.cluster, &self.container) {
            (Cluster::Kubernetes, None) => {
                refuse("Kubernetes needs an image and a volume claim".into(), "name them with --image and --claim")
            }
            (Cluster::Slurm | Cluster::Local, Some(_)) => {
                refuse("only Kubernetes has images and claims".into(), "leave --image and --claim away")
            }
            _ => Ok(()),
        }
    }

    /// Path of the script or manifest.
    pub fn script_path(&self) -> PathBuf {
        self.out.join(match self.cluster {
            Cluster::Slurm => "launch.slurm",
            Cluster::Kubernetes => "launch.json",
            Cluster::Local => "launch.sh",
        })
    }

    /// Command line that submits the job.
    pub fn submission(&self) -> Vec<String> {
        let path = self.script_path().display().to_string();
        let words: &[&str] = match self.cluster {
            Cluster::Slurm => &["sbatch", &path],
            Cluster::Kubernetes => &["kubectl", "apply", "-f", &path],
            Cluster::Local => &["sh", &path],
        };
        words.iter().map(|word| (*word).to_owned()).collect()
    }

    /// Free space on the disk of the shards, MiB; `None` if this machine cannot determine it.
    pub fn free_mib(&self) -> Option<u64> {
        match self.cluster {
            // The volume of the cluster is not mounted on this machine.
            Cluster::Kubernetes => None,
            Cluster::Slurm | Cluster::Local => disk_space::free_mib(&self.out),
        }
    }

    /// Time, memory and disk space of the shards, estimated from the measured sample.
    pub fn need(&self, sample: &Sample) -> Need {
        let per_attempt_s = sample.wall_s / sample.attempts.max(1) as f64;
        let per_shard = self.attempts.div_ceil(self.shards) as f64;
        let minutes = TIME_MINUTES + TIME_FACTOR * per_attempt_s * per_shard / 60.0;
        let memory = MEMORY_MIB + MEMORY_FACTOR * sample.peak_bytes as f64 / f64::from(1 << 20);
        let disk = sample.disk_bytes as f64 * self.attempts as f64 / sample.attempts.max(1) as f64;
        Need {
            minutes: (minutes.ceil() as u64).clamp(1, MAX_MINUTES),
            // Rounded up to 64 MiB, for readability.
            memory_mib: ((memory / 64.0).ceil() as u64) * 64,
            disk_mib: (disk / f64::from(1 << 20)).ceil() as u64,
            core_hours: per_attempt_s * self.attempts as f64 * self.cpus as f64 / 3600.0,
        }
    }
}

/// Writes the script or manifest into the folder of the shards, and returns its path.
///
/// # Errors
/// When the folder or the file cannot be written.
pub fn write(job: &Job, script: &str) -> Result<PathBuf, WorkspaceError> {
    let path = job.script_path();
    // Slurm discards the output of a job if the folder of its log does not exist.
    let folder = if job.cluster == Cluster::Slurm { job.out.join("logs") } else { job.out.clone() };
    fs::create_dir_all(&folder)
        .map_err(|error| WorkspaceError::broken(format!("cannot make the folder {}", folder.display()), error))?;
    documents::write_file(&path, script.as_bytes())?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn job(cluster: Cluster) -> Job {
        Job {
            cluster,
            program: "/opt/genmanip".into(),
            arguments: ["collect", "my tasks", "--out", "out/it's"].map(String::from).into(),
            out: "out/it's".into(),
            shards: 8,
            attempts: 100,
            cpus: 2,
            at_once: 3,
            container: None,
        }
    }

    #[test]
    fn needs_follow_from_the_sample() {
        let sample = Sample { attempts: 4, wall_s: 40.0, peak_bytes: 400 << 20, disk_bytes: 12 << 20 };
        let need = job(Cluster::Slurm).need(&sample);
        // 13 attempts of 10 s three times over, and 5 minutes; 600 MiB and 256, in steps of 64.
        assert_eq!((need.minutes, need.memory_mib, need.disk_mib), (12, 896, 300));
        assert!((need.core_hours - 100.0 * 10.0 * 2.0 / 3600.0).abs() < 1e-9);
    }

    #[test]
    fn what_cannot_be_launched_is_refused() {
        let container = || Container { image: "genmanip:1".into(), claim: "data".into(), mount: "/data".into() };
        let cases = [
            (Job { shards: 0, ..job(Cluster::Slurm) }, "0 shards"),
            (Job { shards: 101, ..job(Cluster::Slurm) }, "101 shards"),
            (Job { cpus: 0, ..job(Cluster::Local) }, "a core"),
            (job(Cluster::Kubernetes), "an image"),
            (Job { container: Some(container()), ..job(Cluster::Slurm) }, "only Kubernetes"),
        ];
        for (job, expected) in cases {
            let error = job.check().unwrap_err();
            assert!(error.to_string().contains(expected) && error.hint().is_some(), "{error}");
        }
        assert!(Job { container: Some(container()), ..job(Cluster::Kubernetes) }.check().is_ok());
    }

    #[test]
    fn a_sample_goes_elsewhere() {
        for arguments in
            [&["collect", "a", "--out", "b", "--seed", "7"][..], &["collect", "a", "--out=b", "--seed", "7"]]
        {
            let arguments: Vec<String> = arguments.iter().map(|&argument| argument.into()).collect();
            assert_eq!(redirected(&arguments, Path::new("c")), ["collect", "a", "--seed", "7", "--out", "c"]);
        }
    }
}
