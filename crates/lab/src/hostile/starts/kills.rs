//! Calls that are killed at a random moment and repeated.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Child;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use genmanip_core::Seed;
use genmanip_workspace::Progress;
use rand::RngExt;

use super::{HostileArguments, Sandbox, Starts, TASK, collect, start};
use crate::LabError;
use crate::hostile::listing;

/// Contents of files by path in the sandbox; names of folders end with a slash and have no content.
type Files = BTreeMap<String, Vec<u8>>;

/// A call that is killed and repeated.
struct Work {
    /// Activity of the call, for the report.
    doing: &'static str,
    call: Vec<String>,
    /// Files before the call.
    before: Files,
    /// Files after an uninterrupted call.
    after: Files,
    /// Phase of `collect` in which it is killed; `None` to kill another call at any moment.
    phase: Option<Phase>,
    /// Duration of the phase, or of the call.
    takes: Duration,
}

/// Names of the files with the stderr of the killed and of the repeated call.
const SAID: [&str; 2] = ["said", "said-again"];
/// Datasets that must appear atomically: complete or not at all.
const DATASETS: [&str; 4] = ["made/", "made-depth/", "merged/dataset/", "merged/dataset-depth/"];

/// Kills and repeats calls of all subcommands that write, in turn.
pub(super) fn measure(
    arguments: &HostileArguments,
    sandbox: &Sandbox,
    seed: Seed,
    starts: &mut Starts,
    (progress, stop): (&dyn Progress, &AtomicBool),
) -> Result<(), LabError> {
    progress.note("making what is killed");
    let works = works(arguments, sandbox)?;
    let mut rng = seed.fork("kills").rng();
    progress.begin("killing", arguments.kills);
    for (number, work) in works.iter().cycle().take(arguments.kills).enumerate() {
        let before = starts.clone();
        let wrong = kill(arguments, sandbox, work, rng.random_range(0.0..1.0), starts)?;
        if stop.load(Ordering::Relaxed) {
            // Ctrl-C reaches the call as well, so its outcome does not count.
            *starts = before;
            break;
        }
        starts.identical += usize::from(wrong.is_empty());
        starts.wrong.extend(wrong.iter().map(|wrong| format!("kill {number}, {}: {wrong}", work.doing)));
        progress.advance();
    }
    progress.end();
    Ok(())
}

/// Kills a call after a fraction of its duration (`moment`, 0 to 1) and repeats it; returns descriptions of violations.
fn kill(
    arguments: &HostileArguments,
    sandbox: &Sandbox,
    work: &Work,
    moment: f64,
    starts: &mut Starts,
) -> Result<Vec<String>, LabError> {
    lay(sandbox, &work.before)?;
    let run = sandbox.work().join("run");
    let mut child = start(arguments, sandbox, &work.call, SAID[0])?;
    work.phase.map_or(Ok(()), |phase| wait_for(phase, &mut child, &run)).map_err(failed)?;
    std::thread::sleep(work.takes.mul_f64(moment));
    starts.kills += 1;
    starts.killed_in_time += usize::from(child.try_wait().map_err(failed)?.is_none());
    let _ = child.kill();
    child.wait().map_err(failed)?;
    let doing = work.phase.map_or(work.doing, |_| Phase::of(&run).describe());
    *starts.killed_while.entry(doing).or_default() += 1;
    let mut wrong = halves(work, &files(sandbox));
    let again = start(arguments, sandbox, &work.call, SAID[1])?.wait().map_err(failed)?;
    let (now, expected) = (files(sandbox), without_clock(&work.after));
    let now = without_clock(&now);
    let said = fs::read_to_string(sandbox.work().join(SAID[1])).unwrap_or_default();
    // A subcommand that refuses to overwrite may refuse the repetition; its output must then be complete.
    let is_there = again.code() == Some(1) && said.contains("exists");
    if !again.success() && !is_there {
        wrong.push(format!("the next call failed: {}", said.trim()));
    }
    if now != expected {
        let names = expected.keys().chain(now.keys()).filter(|name| expected.get(*name) != now.get(*name));
        wrong.push(format!("differs in {:?} after the next call", names.take(5).collect::<Vec<_>>()));
    }
    Ok(wrong)
}

/// Descriptions of files that are visible but incomplete after a kill.
fn halves(work: &Work, left: &Files) -> Vec<String> {
    let visible: Vec<&String> = left.keys().filter(|name| !name.contains(".partial-")).collect();
    let is_half = |name: &&&String| {
        let bytes = &left[**name];
        // Files that are appended to line by line may be a prefix of the complete file.
        let grows = |whole: &Vec<u8>| name.ends_with(".jsonl") && whole.starts_with(bytes);
        let is_of_after = work.after.get(**name).is_none_or(|whole| whole == bytes || grows(whole));
        !is_of_after && work.before.get(**name) != Some(bytes) && !is_clock(name)
    };
    let mut found: Vec<String> = visible.iter().filter(is_half).map(|name| format!("{name} is not whole")).collect();
    for dataset in DATASETS {
        let inside = |name: &&String| name.starts_with(dataset);
        let (there, whole) = (visible.iter().copied().filter(inside).count(), work.after.keys().filter(inside).count());
        if there != 0 && there != whole {
            found.push(format!("{dataset} has {there} of {whole} files"));
        }
    }
    found
}

/// All calls to be killed, each run once to know its duration and files.
fn works(arguments: &HostileArguments, sandbox: &Sandbox) -> Result<Vec<Work>, LabError> {
    let mut works = collects(arguments, sandbox)?;
    sandbox.clear()?;
    let example = |name: &str| arguments.project.join("examples/tasks").join(name).display().to_string();
    let tasks = [example("021_spatial.json"), example("024_appearance.json")];
    let made = |call: &str| -> Result<Files, LabError> {
        let call: Vec<String> = call.split(' ').map(String::from).collect();
        let call = if call[0] == "collect" { [&call[..1], &tasks, &call[1..]].concat() } else { call };
        whole(arguments, sandbox, &call)?;
        Ok(files(sandbox))
    };
    for shard in ["0/2", "1/2"] {
        made(&format!("collect --episodes 1 --fps 10 --seed 3 --workers 1 --out shards --shard {shard}"))?;
    }
    made("collect --episodes 1 --no-dataset --seed 4 --out other")?;
    let undrawn = made("collect --episodes 1 --no-dataset --seed 3 --out run")?;
    for (run, format, name) in [("run", "lerobot", "a"), ("other", "lerobot", "b"), ("other", "lerobot-v2.1", "v21")] {
        made(&format!("export {run} --to {format} --rate 10 --cameras wrist --out {name}"))?;
    }
    let drawn = files(sandbox);
    let original = listing(&arguments.project.join("crates/dataset-tools/testdata/original"));
    let original: Files = original.into_iter().map(|(name, bytes)| (format!("original/{name}"), bytes)).collect();
    for (doing, call, from, folders) in [
        ("merging shards", "merge shards --workers 1 --out merged", &undrawn, &["shards/"][..]),
        ("exporting a run", "export run --to lerobot --rate 10 --workers 1 --out made", &undrawn, &["run/"]),
        ("converting", "data convert a --to lerobot-v2.1 --out made", &drawn, &["a/", "a-depth/"]),
        ("importing LeRobot", "data import v21 --out made", &drawn, &["v21/"]),
        ("importing GenManip", "data import original --out made", &original, &["original/"]),
        ("merging data sets", "data merge a b --out made", &drawn, &["a/", "a-depth/", "b/", "b-depth/"]),
        (
            "evaluating",
            "evaluate run --policy expert --policy do_nothing:seconds=0.1 --keep-episodes --workers 1",
            &undrawn,
            &["run/"],
        ),
    ] {
        let is_before = |name: &String| folders.iter().any(|folder| name.starts_with(folder));
        let before: Files = from
            .iter()
            .filter(|(name, _)| is_before(name))
            .map(|(name, bytes)| (name.clone(), bytes.clone()))
            .collect();
        lay(sandbox, &before)?;
        let call: Vec<String> = call.split(' ').map(String::from).collect();
        let begun = Instant::now();
        whole(arguments, sandbox, &call)?;
        works.push(Work { doing, call, before, after: files(sandbox), phase: None, takes: begun.elapsed() });
    }
    Ok(works)
}

/// One `collect` per phase, to be killed in that phase.
fn collects(arguments: &HostileArguments, sandbox: &Sandbox) -> Result<Vec<Work>, LabError> {
    sandbox.clear()?;
    let run = sandbox.work().join("run");
    let options = ["--fps", "10", "--seed", "3", "--workers", "1", "--out", "run"].map(String::from);
    let mut child = collect(arguments, sandbox, &options, SAID[0])?;
    let mut durations = Vec::new();
    for next in [Phase::Drawing, Phase::Exporting, Phase::Ended] {
        let begun = Instant::now();
        wait_for(next, &mut child, &run).map_err(failed)?;
        durations.push(begun.elapsed());
    }
    ended_well(sandbox, child)?;
    let after = files(sandbox);
    let call = super::collect_call(arguments, &options);
    let work = |(phase, takes)| {
        let (call, after) = (call.clone(), after.clone());
        Work { doing: "collecting", call, before: Files::new(), after, phase: Some(phase), takes }
    };
    Ok(Phase::KILLED.into_iter().zip(durations).map(work).collect())
}

/// Runs a call, which must succeed.
fn whole(arguments: &HostileArguments, sandbox: &Sandbox, call: &[String]) -> Result<(), LabError> {
    ended_well(sandbox, start(arguments, sandbox, call, SAID[0])?)
}

fn ended_well(sandbox: &Sandbox, mut child: Child) -> Result<(), LabError> {
    if child.wait().map_err(failed)?.success() {
        return Ok(());
    }
    let said = fs::read_to_string(sandbox.work().join(SAID[0])).unwrap_or_default();
    Err(LabError::input(format!("a call that is not killed does not end well: {}", said.trim())))
}

fn failed(error: std::io::Error) -> LabError {
    LabError::broken("cannot run the program", error)
}

/// Empties the sandbox and writes these files into it.
fn lay(sandbox: &Sandbox, wanted: &Files) -> Result<(), LabError> {
    sandbox.clear()?;
    for (name, bytes) in wanted {
        let path = sandbox.work().join(name);
        let folder = if name.ends_with('/') { &path } else { path.parent().unwrap_or(&path) };
        let made = fs::create_dir_all(folder);
        let written = made.and_then(|()| if name.ends_with('/') { Ok(()) } else { fs::write(&path, bytes) });
        written.map_err(|error| LabError::file("write", &path, error))?;
    }
    Ok(())
}

/// Files in the sandbox, except those with the stderr of calls.
fn files(sandbox: &Sandbox) -> Files {
    let mut files = listing(&sandbox.work());
    files.retain(|name, _| !SAID.contains(&name.as_str()));
    files
}

/// True if a file contains wall-clock times, which differ between calls.
fn is_clock(name: &str) -> bool {
    name.rsplit('/').next() == Some("timings.json")
}

fn without_clock(files: &Files) -> BTreeMap<&str, &[u8]> {
    files.iter().filter(|(name, _)| !is_clock(name)).map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect()
}

/// Phases of `collect`, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    Recording,
    Drawing,
    Exporting,
    Ended,
}

impl Phase {
    const KILLED: [Self; 3] = [Self::Recording, Self::Drawing, Self::Exporting];

    /// Phase of a run, inferred from the files in its folder.
    fn of(run: &Path) -> Self {
        let episode = run.join("episodes").join(format!("{TASK}-000"));
        let is_exported = |name: &str| run.join(name).join("meta/info.json").exists();
        if !episode.join("episode.json").exists() {
            Self::Recording
        } else if !episode.join("images_10hz/files.json").exists() {
            Self::Drawing
        } else if !(is_exported("dataset") && is_exported("dataset-depth")) {
            Self::Exporting
        } else {
            Self::Ended
        }
    }

    fn describe(self) -> &'static str {
        match self {
            Self::Recording => "recording",
            Self::Drawing => "drawing",
            Self::Exporting => "exporting",
            Self::Ended => "ending",
        }
    }
}

/// Waits until a run has reached a phase, or its process has ended.
fn wait_for(phase: Phase, child: &mut Child, run: &Path) -> std::io::Result<()> {
    while Phase::of(run) < phase && child.try_wait()?.is_none() {
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(())
}
