//! Starts that race for one folder, and runs that are killed and continued.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use genmanip_core::Seed;
use genmanip_run::Progress;
use rand::RngExt;
use serde::Serialize;
use serde_json::Value;

use super::{HostileArguments, Room, listing};
use crate::LabError;

/// What came of starts and kills.
#[derive(Debug, Default, Serialize)]
pub struct Starts {
    /// Pairs of starts with different seeds for one new folder, both begun before either had written.
    pub pairs: usize,
    /// Pairs of which exactly one won, and the other said why it did not.
    pub one_won: usize,
    /// Folders with the record of one run and episodes of the other.
    pub mixed: usize,
    /// Runs that were killed at a random moment of one of their phases, in turn, and then continued.
    pub kills: usize,
    /// What the killed ones were doing.
    pub killed_while: BTreeMap<&'static str, usize>,
    /// Those of them that were killed before they had ended by themselves.
    pub killed_in_time: usize,
    /// Those that ended with the same bytes as a run that was not killed.
    pub identical: usize,
    /// What was found wrong.
    pub wrong: Vec<String>,
}

/// The quickest of the example tasks.
const TASK: &str = "024_appearance";
/// How often a pair is started again of which one had written before the other had begun.
const TRIES: usize = 20;

/// Races pairs of starts, and kills and continues runs.
pub(super) fn measure(
    arguments: &HostileArguments,
    room: &Room,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Starts, LabError> {
    let mut starts = Starts::default();
    progress.begin("racing", arguments.races);
    for pair in 0..arguments.races {
        race(arguments, room, pair as u64, &mut starts)?;
        progress.advance();
    }
    progress.end();
    if arguments.kills > 0 {
        kill(arguments, room, seed, &mut starts, progress)?;
    }
    room.clear()?;
    Ok(starts)
}

fn race(arguments: &HostileArguments, room: &Room, pair: u64, starts: &mut Starts) -> Result<(), LabError> {
    let seeds = [2 * pair, 2 * pair + 1];
    let run = room.work().join("new/run");
    for _ in 0..TRIES {
        room.clear()?;
        let mut both = Vec::new();
        for (index, seed) in seeds.iter().enumerate() {
            let call = ["--no-dataset", "--seed", &seed.to_string(), "--out", "new/run"].map(String::from);
            both.push(collect(arguments, room, &call, &format!("said{index}"))?);
        }
        let in_time = !run.join("run.json").exists();
        let codes =
            both.iter_mut().map(|child| child.wait().map(|status| status.code())).collect::<Result<Vec<_>, _>>();
        let codes = codes.map_err(|error| LabError::broken("cannot wait for the program", error))?;
        if !in_time {
            continue;
        }
        starts.pairs += 1;
        let said = |index: usize| fs::read_to_string(room.work().join(format!("said{index}"))).unwrap_or_default();
        let lost: Vec<usize> = (0..2)
            .filter(|&index| codes[index] == Some(1) && said(index).contains("holds another run (its seed is"))
            .collect();
        let value =
            |path: &Path| -> Value { serde_json::from_slice(&fs::read(path).unwrap_or_default()).unwrap_or_default() };
        let record = value(&run.join("run.json"))["seed"].as_u64();
        let episode = value(&run.join(format!("episodes/{TASK}-000/episode.json")))["result"]["seed"].as_u64();
        // As `Attempt::all` has it.
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

/// What a run does, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    Recording,
    Drawing,
    Exporting,
    Ended,
}

impl Phase {
    const KILLED: [Self; 3] = [Self::Recording, Self::Drawing, Self::Exporting];

    /// What a run is doing, by what lies in its folder.
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

    fn in_words(self) -> &'static str {
        match self {
            Self::Recording => "recording",
            Self::Drawing => "drawing",
            Self::Exporting => "exporting",
            Self::Ended => "ending",
        }
    }
}

/// Waits until a run has come as far as a phase, or has ended.
fn wait_for(phase: Phase, child: &mut Child, run: &Path) -> std::io::Result<()> {
    while Phase::of(run) < phase && child.try_wait()?.is_none() {
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(())
}

fn kill(
    arguments: &HostileArguments,
    room: &Room,
    seed: Seed,
    starts: &mut Starts,
    progress: &dyn Progress,
) -> Result<(), LabError> {
    let call = ["--fps", "10", "--seed", "3", "--workers", "1", "--out", "run"].map(String::from);
    let run = room.work().join("run");
    let failed = |error| LabError::broken("cannot run the program", error);
    // How long each phase took.
    let whole = |said: &str| -> Result<[Duration; 3], LabError> {
        let mut child = collect(arguments, room, &call, said)?;
        let mut durations = [Duration::ZERO; 3];
        for (duration, next) in durations.iter_mut().zip([Phase::Drawing, Phase::Exporting, Phase::Ended]) {
            let started = Instant::now();
            wait_for(next, &mut child, &run).map_err(failed)?;
            *duration = started.elapsed();
        }
        let status = child.wait().map_err(failed)?;
        if !status.success() {
            let text = fs::read_to_string(room.work().join(said)).unwrap_or_default();
            return Err(LabError::input(format!("a run does not end well: {}", text.trim())));
        }
        Ok(durations)
    };
    let bytes = || {
        let mut files = listing(&run);
        files.remove("timings.json");
        files
    };
    room.clear()?;
    let durations = whole("said")?;
    let expected = bytes();
    let mut rng = seed.fork("kills").rng();
    progress.begin("killing", arguments.kills);
    for number in 0..arguments.kills {
        room.clear()?;
        let mut child = collect(arguments, room, &call, "said")?;
        let index = number % Phase::KILLED.len();
        wait_for(Phase::KILLED[index], &mut child, &run).map_err(failed)?;
        std::thread::sleep(durations[index].mul_f64(rng.random_range(0.0..1.0)));
        starts.kills += 1;
        starts.killed_in_time += usize::from(child.try_wait().map_err(failed)?.is_none());
        let _ = child.kill();
        child.wait().map_err(failed)?;
        *starts.killed_while.entry(Phase::of(&run).in_words()).or_default() += 1;
        match whole("again") {
            Ok(_) if bytes() == expected => starts.identical += 1,
            Ok(_) => {
                let now = bytes();
                let names = expected.keys().chain(now.keys()).filter(|name| expected.get(*name) != now.get(*name));
                starts.wrong.push(format!("kill {number}: differs in {:?}", names.take(5).collect::<Vec<_>>()));
            }
            Err(error) => starts.wrong.push(format!("kill {number}: {error}")),
        }
        progress.advance();
    }
    progress.end();
    Ok(())
}

/// Starts `collect` of one attempt; what it says goes into a file.
fn collect(arguments: &HostileArguments, room: &Room, call: &[String], said: &str) -> Result<Child, LabError> {
    let said = room.work().join(said);
    let file = File::create(&said).map_err(|error| LabError::file("write", &said, error))?;
    Command::new(&arguments.program)
        .arg("collect")
        .arg(arguments.project.join(format!("examples/tasks/{TASK}.json")))
        .args(["--episodes", "1"])
        .args(call)
        .current_dir(room.work())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(file)
        .spawn()
        .map_err(|error| LabError::broken("cannot start the program", error))
}

impl Starts {
    pub(super) fn in_words(&self) -> String {
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
