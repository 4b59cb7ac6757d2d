//! Simultaneous starts in one folder, and calls that are killed and restarted.

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

/// Results of starts and kills.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Starts {
    /// Pairs of starts with different seeds in one new folder, both begun before either had written.
    pub pairs: usize,
    /// Pairs with exactly one winner, and an explanation from the other.
    pub one_won: usize,
    /// Folders with the record of one run and episodes of the other.
    pub mixed: usize,
    /// Calls that were killed at a random moment and then repeated: `collect` in each of its phases, and the other
    /// subcommands that write runs and datasets, in turn.
    pub kills: usize,
    /// Activity at the moment of the kill, inferred from the files.
    pub killed_while: BTreeMap<&'static str, usize>,
    /// Calls that were killed before they had ended.
    pub killed_in_time: usize,
    /// Calls with the same final bytes as an uninterrupted one.
    pub identical: usize,
    /// Violations.
    pub wrong: Vec<String>,
}

/// The fastest of the example tasks.
const TASK: &str = "024_appearance";
/// Maximum restarts of a pair if one had written before the other had begun.
const TRIES: usize = 20;

/// Races pairs of starts, and kills and continues runs.
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
            // The signal that stops this program may have ended both too.
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
        // As in `Attempt::all`.
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

/// Starts `collect` of one attempt, with its output in a file.
fn collect(arguments: &HostileArguments, sandbox: &Sandbox, options: &[String], said: &str) -> Result<Child, LabError> {
    start(arguments, sandbox, &collect_call(arguments, options), said)
}

fn collect_call(arguments: &HostileArguments, options: &[String]) -> Vec<String> {
    let task = arguments.project.join(format!("examples/tasks/{TASK}.json")).display().to_string();
    [&["collect".to_owned(), task, "--episodes".into(), "1".into()], options].concat()
}

/// Starts the program, with its output in a file.
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
