//! Simultaneous starts in one folder, and calls that are killed and repeated.

mod kills;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_core::Seed;
use genmanip_workspace::Progress;
use serde::Serialize;
use serde_json::Value;

use super::{HostileArguments, Sandbox};
use crate::LabError;

/// Results of simultaneous starts and of kills.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Starts {
    /// Number of pairs of `collect` with different seeds in one new folder, both started before either had written.
    pub pairs: usize,
    /// Number of pairs of which exactly one succeeded and the other explained its failure.
    pub one_won: usize,
    /// Number of folders with the record of one run and episodes of the other.
    pub mixed: usize,
    /// Number of calls that were killed at a random moment and repeated: `collect` in each of its phases, and the other
    /// subcommands that write runs and datasets, in turn.
    pub kills: usize,
    /// Number of kills by the call's activity at that moment, inferred from its files.
    pub killed_while: BTreeMap<&'static str, usize>,
    /// Number of calls that were killed before they ended by themselves.
    pub killed_in_time: usize,
    /// Number of repeated calls whose final files have the same bytes as those of an uninterrupted call.
    pub identical: usize,
    /// Descriptions of violations.
    pub wrong: Vec<String>,
}

/// Task of the runs, the fastest of the example tasks.
const TASK: &str = "024_appearance";
/// Maximum number of repetitions of a pair of which one had written before the other started.
const TRIES: usize = 20;

/// Starts pairs of `collect` in one folder, and kills and repeats calls.
pub(super) fn measure(
    arguments: &HostileArguments,
    sandbox: &Sandbox,
    seed: Seed,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Starts, LabError> {
    let mut starts = Starts::default();
    progress.begin("racing", arguments.races);
    for pair in 0..arguments.races {
        let before = starts.clone();
        race(arguments, sandbox, pair as u64, &mut starts)?;
        if stop.load(Ordering::Relaxed) {
            // Ctrl-C reaches both calls as well, so their outcome does not count.
            return Ok(before);
        }
        progress.advance();
    }
    progress.end();
    if arguments.kills > 0 {
        kills::measure(arguments, sandbox, seed, &mut starts, (progress, stop))?;
    }
    sandbox.clear()?;
    Ok(starts)
}

fn race(arguments: &HostileArguments, sandbox: &Sandbox, pair: u64, starts: &mut Starts) -> Result<(), LabError> {
    let seeds = [2 * pair, 2 * pair + 1];
    let run = sandbox.work().join("new/run");
    for _ in 0..TRIES {
        sandbox.clear()?;
        let mut both = Vec::new();
        for (index, seed) in seeds.iter().enumerate() {
            let call = ["--no-dataset", "--seed", &seed.to_string(), "--out", "new/run"].map(String::from);
            both.push(collect(arguments, sandbox, &call, &format!("said{index}"))?);
        }
        let in_time = !run.join("run.json").exists();
        let codes =
            both.iter_mut().map(|child| child.wait().map(|status| status.code())).collect::<Result<Vec<_>, _>>();
        let codes = codes.map_err(|error| LabError::broken("cannot wait for the program", error))?;
        if !in_time {
            continue;
        }
        starts.pairs += 1;
        let said = |index: usize| fs::read_to_string(sandbox.work().join(format!("said{index}"))).unwrap_or_default();
        let lost: Vec<usize> = (0..2)
            .filter(|&index| codes[index] == Some(1) && said(index).contains("holds another run (its seed is"))
            .collect();
        let value =
            |path: &Path| -> Value { serde_json::from_slice(&fs::read(path).unwrap_or_default()).unwrap_or_default() };
        let record = value(&run.join("run.json"))["seed"].as_u64();
        let episode = value(&run.join(format!("episodes/{TASK}-000/episode.json")))["result"]["seed"].as_u64();
        // Same stream as `Attempt::all`, so that an episode's seed tells which run made it.
        let of_run = |seed: u64| Seed::new(seed).fork("attempt").fork(TASK).fork_index(0).value();
        if episode.is_some() && record.map(of_run) != episode {
            starts.mixed += 1;
            starts.wrong.push(format!("pair {pair}: mixed"));
        }
        match lost.as_slice() {
            [lost] if record == Some(seeds[1 - lost]) && episode.is_some() => starts.one_won += 1,
            _ => starts.wrong.push(format!("pair {pair}: {codes:?}, {} / {}", said(0).trim(), said(1).trim())),
        }
        return Ok(());
    }
    starts.wrong.push(format!("pair {pair}: no two starts before the first had written"));
    Ok(())
}

/// Starts `collect` with one attempt; its stderr goes to the file `said`.
fn collect(arguments: &HostileArguments, sandbox: &Sandbox, options: &[String], said: &str) -> Result<Child, LabError> {
    start(arguments, sandbox, &collect_call(arguments, options), said)
}

fn collect_call(arguments: &HostileArguments, options: &[String]) -> Vec<String> {
    let task = arguments.project.join(format!("examples/tasks/{TASK}.json")).display().to_string();
    [&["collect".to_owned(), task, "--episodes".into(), "1".into()], options].concat()
}

/// Starts the program; its stderr goes to the file `said`, its stdout is discarded.
fn start(arguments: &HostileArguments, sandbox: &Sandbox, call: &[String], said: &str) -> Result<Child, LabError> {
    let said = sandbox.work().join(said);
    let file = File::create(&said).map_err(|error| LabError::file("write", &said, error))?;
    Command::new(&arguments.program)
        .args(call)
        .current_dir(sandbox.work())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(file)
        .spawn()
        .map_err(|error| LabError::broken("cannot start the program", error))
}

impl Starts {
    pub(super) fn describe(&self) -> String {
        let mut text = format!(
            "starts         {} pairs, one won in {}, {} mixed\nkills          {} ({} in time), {} identical afterwards\n",
            self.pairs, self.one_won, self.mixed, self.kills, self.killed_in_time, self.identical
        );
        for (what, count) in &self.killed_while {
            text += &format!("  {count} while {what}\n");
        }
        for wrong in &self.wrong {
            text += &format!("  {wrong}\n");
        }
        text
    }
}
