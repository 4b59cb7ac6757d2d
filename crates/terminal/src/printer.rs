//! Printer: data goes to stdout, log lines go to stderr.

use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use genmanip_workspace::Progress;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde::Serialize;

use crate::error::Failed;

/// Interval of progress lines if stderr is not a terminal, e.g. in the log of a cluster job.
const LINE_EVERY: Duration = Duration::from_secs(60);

/// Printer of results, messages and progress.
pub struct Printer {
    json: bool,
    quiet: bool,
    /// Progress of the current task; `None` between tasks.
    work: Mutex<Option<Work>>,
    /// First error in writing to stdout.
    lost: Mutex<Option<io::Error>>,
}

impl Printer {
    /// Printer that prints data as JSON with `json`, and no log and no progress with `quiet`.
    pub fn new(json: bool, quiet: bool) -> Self {
        Self { json, quiet, work: Mutex::new(None), lost: Mutex::new(None) }
    }

    /// Prints data to stdout: `value` as JSON, or `text`.
    pub fn data(&self, value: &impl Serialize, text: &str) {
        match self.json {
            true => self.print(&serde_json::to_string_pretty(value).unwrap_or_default()),
            false => self.print(text.trim_end()),
        }
    }

    /// Starts a list that may be long; as JSON, each entry is printed on its own line as soon as it is added.
    pub fn list(&self) -> List<'_> {
        List { printer: self, entries: 0 }
    }

    /// Prints a line to stdout.
    fn print(&self, line: &str) {
        let mut stdout = io::stdout().lock();
        if let Err(error) = writeln!(stdout, "{line}").and_then(|()| stdout.flush()) {
            self.lost.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
    }

    /// Checks that all data was written; called once at the end.
    ///
    /// # Errors
    /// If some data could not be written, e.g. because the disk is full; a closed pipe is not an error.
    pub fn finish(&self) -> Result<(), Failed> {
        match self.lost.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                Err(Failed::because("cannot write to standard output", &error)
                    .hint("what was printed is not whole; is the disk full?"))
            }
            _ => Ok(()),
        }
    }

    /// Prints a log line to stderr, unless quiet.
    pub fn say(&self, text: impl AsRef<str>) {
        let print = || {
            if !self.quiet {
                let _ = writeln!(std::io::stderr().lock(), "{}", text.as_ref());
            }
        };
        match &*self.work() {
            Some(work) => work.bar.suspend(print),
            None => print(),
        }
    }

    /// Prints an error to stderr.
    pub fn error(&self, failed: &Failed) {
        self.end();
        let _ = writeln!(std::io::stderr().lock(), "{failed}");
    }

    fn work(&self) -> MutexGuard<'_, Option<Work>> {
        self.work.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Progress of one task, shown as a bar on a terminal, as log lines elsewhere.
struct Work {
    what: String,
    bar: ProgressBar,
    began: Instant,
    /// Time of the last log line.
    told: Instant,
}

impl Work {
    /// Log line if one is due, e.g. `expert: 210/2910, 2.8/s, 16 minutes left`.
    fn line(&mut self) -> Option<String> {
        if !self.bar.is_hidden() || self.told.elapsed() < LINE_EVERY {
            return None;
        }
        self.told = Instant::now();
        let (done, total) = (self.bar.position(), self.bar.length().unwrap_or(0));
        let (rate, left) = speed(done, total, self.began.elapsed());
        let left = HumanDuration(left.unwrap_or_default());
        Some(format!("{}: {done}/{total}, {rate:.2}/s, {left} left", self.what))
    }
}

/// Mean rate since the beginning (1/s), and the remaining time at that rate. A recent rate would fluctuate, since
/// episodes that wait for a model end in bursts.
fn speed(done: u64, total: u64, elapsed: Duration) -> (f64, Option<Duration>) {
    let rate = done as f64 / elapsed.as_secs_f64().max(1e-9);
    let left = (done > 0).then(|| Duration::try_from_secs_f64(total.saturating_sub(done) as f64 / rate).ok());
    (rate, left.flatten())
}

/// Style of progress bars; `None` if the template is invalid.
fn style() -> Option<ProgressStyle> {
    let speed = |state: &ProgressState| speed(state.pos(), state.len().unwrap_or(0), state.elapsed());
    let rate = move |state: &ProgressState, out: &mut dyn fmt::Write| {
        let _ = write!(out, "{:.2}/s", speed(state).0);
    };
    let left = move |state: &ProgressState, out: &mut dyn fmt::Write| {
        let _ = match speed(state).1 {
            Some(left) => write!(out, "{:#}", HumanDuration(left)),
            None => write!(out, "-"),
        };
    };
    let style = ProgressStyle::with_template("{msg:18} {bar:30} {pos:>4}/{len}  {rate}  ETA {left}  {prefix}").ok()?;
    Some(style.with_key("rate", rate).with_key("left", left))
}

/// List that is being printed.
pub struct List<'a> {
    printer: &'a Printer,
    entries: usize,
}

impl List<'_> {
    /// Adds an entry; JSON is printed at once.
    pub fn add(&mut self, entry: &impl Serialize) {
        if self.printer.json {
            let before = if self.entries == 0 { "[" } else { "," };
            self.printer.print(&format!("{before}{}", serde_json::to_string(entry).unwrap_or_default()));
        }
        self.entries += 1;
    }

    /// Closes the JSON list; without JSON, prints `text` instead.
    pub fn end(self, text: &str) {
        match (self.printer.json, self.entries) {
            (true, 0) => self.printer.print("[]"),
            (true, _) => self.printer.print("]"),
            (false, _) => self.printer.print(text.trim_end()),
        }
    }
}

/// Progress bar with rate and remaining time; a log line each minute if stderr is not a terminal.
impl Progress for Printer {
    fn begin(&self, what: &str, total: usize) {
        let target = if self.quiet || !std::io::stderr().is_terminal() {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr_with_hz(8)
        };
        let bar = ProgressBar::with_draw_target(Some(total as u64), target);
        if let Some(style) = style() {
            bar.set_style(style);
        }
        bar.set_message(what.to_owned());
        keep_ticking(&bar);
        let now = Instant::now();
        *self.work() = Some(Work { what: what.to_owned(), bar, began: now, told: now });
    }

    fn advance(&self) {
        if let Some(work) = &mut *self.work() {
            work.bar.inc(1);
            if let Some(line) = work.line().filter(|_| !self.quiet) {
                let _ = writeln!(std::io::stderr().lock(), "{line}");
            }
        }
    }

    fn tell(&self, state: &str) {
        if let Some(work) = &*self.work() {
            work.bar.set_prefix(state.to_owned());
        }
    }

    fn end(&self) {
        if let Some(work) = self.work().take() {
            work.bar.finish_and_clear();
        }
    }

    fn note(&self, text: &str) {
        self.say(text);
    }
}

/// Refreshes rate and remaining time between two steps; if no thread can be started, only steps refresh them.
fn keep_ticking(bar: &ProgressBar) {
    if bar.is_hidden() {
        return;
    }
    let ticked = bar.clone();
    let tick = move || {
        while !ticked.is_finished() {
            ticked.tick();
            std::thread::sleep(Duration::from_millis(250));
        }
    };
    let _ = std::thread::Builder::new().name("progress".into()).spawn(tick);
}
