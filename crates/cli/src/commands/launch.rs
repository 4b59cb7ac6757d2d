//! `genmanip launch`: a collection as a job array of a cluster.

use std::process::Command as Process;

use crate::launch::{Cluster, Container, Job, Need, Sample, measure, script, write};
use clap::Parser;
use serde::Serialize;

use super::collect::{Planned, planned};
use crate::args::{Arguments, CollectArguments, Command, LaunchArguments};
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

/// Output of `launch`.
#[derive(Serialize)]
struct Launched {
    sample: Sample,
    need: Need,
    /// Free space on the disk of the shards, MiB; `None` if unknown.
    free_mib: Option<u64>,
    script: String,
    /// Command line that submits the job; a dry run does not execute it.
    submission: Vec<String>,
}

pub fn run(arguments: &LaunchArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let collect = collecting(&arguments.call)?;
    let Planned { tasks, attempts, .. } = planned(&collect)?;
    let program = std::env::current_exe().map_err(|error| Failed::because("cannot find this program", &error))?;
    let cluster = match arguments {
        LaunchArguments { slurm: true, .. } => Cluster::Slurm,
        LaunchArguments { kubernetes: true, .. } => Cluster::Kubernetes,
        _ => Cluster::Local,
    };
    let container = arguments.image.clone().zip(arguments.claim.clone());
    let at_once = if cluster == Cluster::Local { 1 } else { arguments.shards };
    let job = Job {
        cluster,
        program: program.clone(),
        arguments: arguments.call.clone(),
        out: collect.out.clone(),
        shards: arguments.shards,
        attempts: tasks.entries().len().saturating_mul(attempts),
        cpus: arguments.cpus,
        at_once: arguments.at_once.unwrap_or(at_once),
        container: container.map(|(image, claim)| Container { image, claim, mount: arguments.mount.clone() }),
    };
    job.check()?;
    printer.say("measuring a sample …");
    let sample = measure(&job, &program, (!arguments.dry_run).then_some(job.out.as_path()))?;
    let need = job.need(&sample);
    let free_mib = job.free_mib();
    let launched = Launched { sample, need, free_mib, script: script(&job, &need), submission: job.submission() };
    let submission = launched.submission.join(" ");
    let Need { minutes, memory_mib, disk_mib, core_hours } = need;
    printer.say(format!(
        "{} attempts took {:.1} s; limits of each of {} shards: {minutes} min and {memory_mib} MiB; together some \
         {core_hours:.2} core hours (wall time × cores) and {disk_mib} MiB of episodes on the disk",
        sample.attempts, sample.wall_s, job.shards
    ));
    if arguments.dry_run {
        printer.data(&launched, &launched.script);
        return Ok(ExitStatus::Done);
    }
    if let Some(free) = free_mib.filter(|free| *free < disk_mib) {
        let what =
            format!("the shards will write some {disk_mib} MiB, and the disk has {free} MiB: {}", job.out.display());
        return Err(Failed::new(what).hint("nothing was submitted; choose another --out, or fewer --episodes"));
    }
    let path = write(&job, &launched.script)?;
    printer.say(format!("wrote {}", path.display()));
    let [submitter, rest @ ..] = launched.submission.as_slice() else { return Ok(ExitStatus::NotMet) };
    let status = Process::new(submitter).args(rest).status().map_err(|error| {
        Failed::because(format!("cannot start {submitter}"), &error)
            .hint(format!("the job lies in {}; submit it where there is one: {submission}", path.display()))
    })?;
    printer.data(&launched, &submission);
    Ok(if status.success() { ExitStatus::Done } else { ExitStatus::NotMet })
}

/// Arguments of `collect`, parsed from the words after `--`.
fn collecting(call: &[String]) -> Result<CollectArguments, Failed> {
    let typed = ["genmanip".to_owned()].into_iter().chain(call.iter().cloned());
    let understood = Arguments::try_parse_from(typed)
        .map_err(|error| Failed::misused("what follows -- is not understood").hint(error.to_string()))?;
    let Command::Collect(collect) = understood.command else {
        return Err(Failed::misused("only `collect` can be launched")
            .hint("an evaluation is divided by its own --shard auto, in a script of yours"));
    };
    if collect.shard.is_some() || collect.workers.is_some() {
        return Err(
            Failed::misused("--shard and --workers are chosen by launch").hint("say --shards and --cpus before --")
        );
    }
    Ok(collect)
}
