//! Robustness against hostile files: randomly mutated input of every kind, passed to the program itself.
//!
//! Each try is one call of the real program in a sandbox folder, under limits of memory and CPU time. It may accept its
//! input or refuse it with one clear message; it must not panic, hang, exceed its memory or write outside the folder.

mod child;
mod corpus;
mod full;
pub mod imports;
pub mod mutate;
mod readers;
mod starts;

use genmanip_workspace::documents;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_core::Seed;
use genmanip_workspace::Progress;
use rand::RngExt;
use serde::Serialize;

use crate::LabError;
use child::{Ended, Limits};
use corpus::{Case, Corpus};
pub use corpus::{KINDS, robot};
pub use readers::Reader;
pub use starts::Starts;

/// Program, inputs and amount of the measurement.
#[derive(Clone, Debug)]
pub struct HostileArguments {
    /// Path of the `genmanip` executable.
    pub program: PathBuf,
    /// Path of the `genmanip-lab` executable.
    pub lab: PathBuf,
    /// Project folder, with `examples/tasks`, recorded answers and the kept corpus.
    pub project: PathBuf,
    /// CPU time of all calls together, minutes.
    pub minutes: f64,
    /// Only kind of input to mutate; `None` for all.
    pub kind: Option<String>,
    /// File to write all error messages to; `None` for no file.
    pub refusals: Option<PathBuf>,
    /// Folder to copy inputs to that caused a violation; `None` for no copies.
    pub found: Option<PathBuf>,
    /// True to measure every reader on files at its size limit.
    pub readers: bool,
    /// Number of pairs of simultaneous starts in one folder.
    pub races: usize,
    /// Number of calls killed at a random moment.
    pub kills: usize,
}

/// Violations, by kind, and cost of the calls.
#[derive(Debug, Default, Serialize)]
pub struct Measured {
    /// Number of calls of the program.
    pub tried: u64,
    /// Numbers of calls by kind of input.
    pub by_kind: BTreeMap<String, ByKind>,
    /// Number of calls that panicked or were ended by a signal.
    pub panics: u64,
    /// Number of calls that used more than 10 s of CPU time, or were idle for a minute.
    pub hangs: u64,
    /// Number of calls that exceeded 1 GiB of memory.
    pub over_memory: u64,
    /// Number of calls that created, changed or removed something outside their folder, or modified read-only input.
    pub wrote_outside: u64,
    /// Error messages without location, expectation, actual value or hint.
    pub unclear: Vec<String>,
    /// Violations: kind, description, the call, and the input's file under `--found`.
    pub broken: Vec<String>,
    /// CPU time of all calls, s.
    pub cpu_s: f64,
    /// CPU time of the slowest call that ended normally, s.
    pub slowest_s: f64,
    /// Command line of that slowest call.
    pub slowest: String,
    /// Cost of every reader on files at its size limit, if requested.
    pub readers: Vec<Reader>,
    /// Results of simultaneous starts and of kills; `None` unless requested.
    pub starts: Option<Starts>,
    /// Seed of the mutations.
    pub seed: u64,
}

/// Calls on one kind of input.
#[derive(Debug, Default, Serialize)]
pub struct ByKind {
    /// Number of calls on this kind.
    pub tried: u64,
    /// Number of calls that accepted the input.
    pub accepted: u64,
    /// Number of calls that refused the input.
    pub refused: u64,
}

/// Maximum number of unclear messages and violations listed.
const SHOWN: usize = 200;

/// Calls the program with mutated inputs for some minutes of CPU time; if `stop` becomes true, returns the results so
/// far.
///
/// # Errors
/// If the program cannot be started, or the valid inputs cannot be made.
pub fn measure(
    arguments: &HostileArguments,
    seed: Seed,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Measured, LabError> {
    let sandbox = Sandbox::new()?;
    let mut measured = Measured { seed: seed.value(), ..Measured::default() };
    progress.note("making the sound inputs");
    let corpus = Corpus::make(arguments, &sandbox)?;
    let mut refusals = String::new();
    let budget_s = arguments.minutes * 60.0;
    progress.begin("trying", (budget_s.max(1.0)) as usize);
    let mut rng = seed.fork("hostile").rng();
    let mut done = 0;
    // Inputs of the kept corpus, which once caused a violation, come first.
    let kept = corpus.kept().into_iter().filter(|case| arguments.kind.as_ref().is_none_or(|kind| *kind == case.kind));
    for case in kept.collect::<Vec<_>>() {
        attempt(arguments, &sandbox, &case, (&mut measured, &mut refusals), stop)?;
    }
    while measured.cpu_s < budget_s && !stop.load(Ordering::Relaxed) {
        // One in 100 calls has a file at its size limit, which costs as much as a hundred other calls.
        let is_full = rng.random_bool(0.01);
        let any = || if is_full { corpus::FULL } else { KINDS[rng.random_range(0..KINDS.len() - 1)] }.to_owned();
        let kind = arguments.kind.clone().unwrap_or_else(any);
        let mut case = corpus.case(&kind, &mut rng)?;
        for _ in 0..mutate::CHANGES[rng.random_range(0..mutate::CHANGES.len())] {
            case.change(&mut rng);
        }
        attempt(arguments, &sandbox, &case, (&mut measured, &mut refusals), stop)?;
        while done < measured.cpu_s as usize {
            progress.advance();
            done += 1;
        }
    }
    progress.end();
    if arguments.readers {
        measured.readers = readers::measure(arguments, &sandbox, &corpus)?;
    }
    if arguments.races + arguments.kills > 0 {
        measured.starts = Some(starts::measure(arguments, &sandbox, seed, progress, stop)?);
    }
    if let Some(path) = &arguments.refusals {
        documents::write_file(path, refusals.as_bytes())?;
    }
    Ok(measured)
}

/// Makes one call on one input and records its outcome.
fn attempt(
    arguments: &HostileArguments,
    sandbox: &Sandbox,
    case: &Case,
    (measured, refusals): (&mut Measured, &mut String),
    stop: &AtomicBool,
) -> Result<(), LabError> {
    sandbox.fill(case)?;
    let before = if case.only_reads { listing(&sandbox.work()) } else { BTreeMap::new() };
    let ended = child::run(arguments, &case.call, sandbox, Limits::default())?;
    if stop.load(Ordering::Relaxed) {
        // Ctrl-C reaches the call as well, so its outcome does not count.
        return sandbox.clear();
    }
    measured.tried += 1;
    measured.cpu_s += ended.cpu_s;
    let by_kind = measured.by_kind.entry(case.kind.clone()).or_default();
    by_kind.tried += 1;
    by_kind.accepted += u64::from(ended.code == Some(0));
    by_kind.refused += u64::from(matches!(ended.code, Some(1 | 2)));
    let what = case.describe();
    let mut broken = Vec::new();
    if ended.is_over_memory() {
        measured.over_memory += 1;
        broken.push("too much memory".to_owned());
    } else if ended.is_hanging() {
        measured.hangs += 1;
        broken.push(ended.slowness());
    } else if ended.has_panicked() {
        measured.panics += 1;
        broken.push("panic or signal".to_owned());
    } else if ended.cpu_s > measured.slowest_s {
        (measured.slowest_s, measured.slowest) = (ended.cpu_s, what.clone());
    }
    let changed = case.only_reads && ended.code != Some(0) && before != listing(&sandbox.work());
    if changed || !sandbox.is_untouched() {
        measured.wrote_outside += 1;
        broken.push("wrote what it should not".to_owned());
    }
    for how in broken {
        if measured.broken.len() < SHOWN {
            let at = keep(arguments, sandbox, measured.broken.len(), case)?;
            measured.broken.push(format!("{how}: {what}{at}: {}", last_lines(&ended.stderr)));
        }
    }
    if matches!(ended.code, Some(1 | 2)) && !ended.is_hanging() {
        *refusals += &format!("$ {what}\n{}{}\n", ended.stdout_if_refused(), ended.stderr);
        if let Some(lack) = lacks(&ended, case)
            && measured.unclear.len() < SHOWN
        {
            measured.unclear.push(format!("{what}: {lack}: {}", ended.stderr.trim_end()));
        }
    }
    sandbox.clear()
}

/// Missing part of an error message: location, expectation, actual value, or hint; `None` if it is complete.
fn lacks(ended: &Ended, case: &Case) -> Option<&'static str> {
    if imports::is_kind(&case.kind) && !ended.stdout.trim().is_empty() {
        return imports::lacks(ended);
    }
    let said = &ended.stderr;
    // Refusals of answers, tasks, worlds and episodes are tables on stdout, with at most one line on stderr.
    if ended.code == Some(1) && !ended.stdout.trim().is_empty() {
        return None;
    }
    if said.lines().filter(|line| line.starts_with("error:")).count() != 1 {
        return Some("not one error");
    }
    if !case.places().iter().any(|place| said.contains(place.as_str())) {
        return Some("no place");
    }
    let hint = said.split_once("hint:").or_else(|| said.split_once("For more information")).map(|(before, _)| before);
    let Some(before) = hint else { return Some("no hint") };
    let found = [
        "got",
        "found",
        "cannot",
        "is no",
        "is a symbolic link",
        "not",
        "unknown",
        "no ",
        "larger",
        "twice",
        "invalid",
        "missing",
        "holds",
        "has ",
    ];
    if !found.iter().any(|word| before.contains(word)) {
        return Some("nothing that was found");
    }
    None
}

fn last_lines(text: &str) -> String {
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
    lines[lines.len().saturating_sub(3)..].join(" / ")
}

/// Saves an input that caused a violation below `--found`; returns its path, or an empty text without that option.
fn keep(arguments: &HostileArguments, sandbox: &Sandbox, number: usize, case: &Case) -> Result<String, LabError> {
    let Some(folder) = &arguments.found else { return Ok(String::new()) };
    let folder = folder.join(format!("{}-{number}", case.kind));
    sandbox.fill(case)?;
    for (name, _) in &case.files {
        let from = sandbox.work().join(name);
        if from.is_file() {
            let to = folder.join(name);
            fs::create_dir_all(to.parent().unwrap_or(&folder)).map_err(|error| LabError::file("write", &to, error))?;
            fs::copy(&from, &to).map_err(|error| LabError::file("write", &to, error))?;
        }
    }
    documents::write_file(&folder.join("call.txt"), case.describe().as_bytes())?;
    Ok(format!(" ({})", folder.display()))
}

/// Sandbox: a working folder for calls, beside files that the calls must not change.
pub(super) struct Sandbox {
    root: PathBuf,
    outside: BTreeMap<String, Vec<u8>>,
}

impl Sandbox {
    fn new() -> Result<Self, LabError> {
        let root = std::env::temp_dir().join(format!("genmanip-hostile-{}", std::process::id()));
        let _ = fs::remove_dir_all(&root);
        let failed = |error| LabError::file("write", &root, error);
        for folder in ["outside/home", "outside/tmp", "outside/victim", "work"] {
            fs::create_dir_all(root.join(folder)).map_err(failed)?;
        }
        for file in ["outside/canary", "outside/victim/info.json"] {
            fs::write(root.join(file), "this stays as it is\n").map_err(failed)?;
        }
        let outside = listing(&root.join("outside"));
        Ok(Self { root, outside })
    }

    pub(super) fn work(&self) -> PathBuf {
        self.root.join("work")
    }

    pub(super) fn outside(&self) -> PathBuf {
        self.root.join("outside")
    }

    /// Empties the working folder and writes the files of a case into it.
    fn fill(&self, case: &Case) -> Result<(), LabError> {
        self.clear()?;
        for (name, content) in &case.files {
            let path = self.work().join(name);
            let failed = |error| LabError::file("write", &path, error);
            if let Some(parent) = path.parent() {
                fs::create_dir_all(parent).map_err(failed)?;
            }
            content.write(&path, &self.outside()).map_err(failed)?;
        }
        Ok(())
    }

    fn clear(&self) -> Result<(), LabError> {
        let work = self.work();
        let _ = fs::remove_dir_all(&work);
        fs::create_dir_all(&work).map_err(|error| LabError::file("write", &work, error))
    }

    fn is_untouched(&self) -> bool {
        let names: Vec<_> =
            fs::read_dir(&self.root).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.file_name())).collect();
        names.len() == 2 && listing(&self.outside()) == self.outside
    }
}

impl Drop for Sandbox {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.root);
    }
}

/// Contents of all files below a folder, by relative path; for links and pipes their type.
pub fn listing(root: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let (path, kind) = (entry.path(), entry.file_type());
            let name = path.strip_prefix(root).unwrap_or(&path).to_string_lossy().into_owned();
            match kind {
                Ok(kind) if kind.is_dir() => {
                    files.insert(format!("{name}/"), Vec::new());
                    folders.push(path);
                }
                Ok(kind) if kind.is_file() => {
                    files.insert(name, fs::read(&path).unwrap_or_default());
                }
                _ => {
                    files.insert(name, b"no file".to_vec());
                }
            }
        }
    }
    files
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let mut text = format!(
        "tried          {} calls, {:.0} s of CPU time, slowest {:.2} s ({})\n\
         panics         {}\nhangs          {}\nover memory    {}\nwrote outside  {}\nunclear        {}\n",
        measured.tried,
        measured.cpu_s,
        measured.slowest_s,
        measured.slowest,
        measured.panics,
        measured.hangs,
        measured.over_memory,
        measured.wrote_outside,
        measured.unclear.len(),
    );
    for (kind, by) in &measured.by_kind {
        text +=
            &format!("  {kind:<12} {:>6} tried, {:>6} accepted, {:>6} refused\n", by.tried, by.accepted, by.refused);
    }
    for reader in &measured.readers {
        let Reader { file, limit, filled_with, outcome, cpu_s, peak_mib } = reader;
        text += &format!("  {cpu_s:>6.2} s {peak_mib:>5} MiB  {outcome:<8} {limit:>8}  {file} of {filled_with}\n");
    }
    if let Some(starts) = &measured.starts {
        text += &starts.describe();
    }
    for line in measured.broken.iter().chain(&measured.unclear).take(20) {
        text += &format!("  {line}\n");
    }
    text
}
