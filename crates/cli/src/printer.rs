//! One place decides what is printed where: stdout is data, stderr is talk.

use std::io::{self, IsTerminal, Write};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use genmanip_run::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

use crate::error::Failed;

/// Prints results, messages and progress as the user asked.
pub struct Printer {
    json: bool,
    quiet: bool,
    /// Of the work under way.
    bar: Mutex<Option<ProgressBar>>,
    /// Why data did not arrive.
    lost: Mutex<Option<io::Error>>,
}

impl Printer {
    /// `json` turns tables into JSON on stdout; `quiet` drops talk.
    pub fn new(json: bool, quiet: bool) -> Self {
        Self { json, quiet, bar: Mutex::new(None), lost: Mutex::new(None) }
    }

    /// Data: the JSON value or the text, to stdout.
    pub fn data(&self, value: &impl Serialize, text: &str) {
        match self.json {
            true => self.print(&serde_json::to_string_pretty(value).unwrap_or_default()),
            false => self.print(text.trim_end()),
        }
    }

    /// A list that may be long: as JSON its entries are printed as they come, one per line.
    pub fn list(&self) -> List<'_> {
        List { printer: self, entries: 0 }
    }

    /// A line to stdout.
    fn print(&self, line: &str) {
        let mut stdout = io::stdout().lock();
        if let Err(error) = writeln!(stdout, "{line}").and_then(|()| stdout.flush()) {
            self.lost.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
    }

    /// Whether all data has arrived.
    ///
    /// # Errors
    /// When some was lost, as on a full disk; a closed pipe is the reader's choice.
    pub fn finish(&self) -> Result<(), Failed> {
        match self.lost.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                Err(Failed::because("cannot write to standard output", &error)
                    .hint("what was printed is not whole; is the disk full?"))
            }
            _ => Ok(()),
        }
    }

    /// Talk: to stderr, unless quiet.
    pub fn say(&self, text: impl AsRef<str>) {
        let print = || {
            if !self.quiet {
                let _ = writeln!(std::io::stderr().lock(), "{}", text.as_ref());
            }
        };
        match &*self.bar() {
            Some(bar) => bar.suspend(print),
            None => print(),
        }
    }

    /// An error: always to stderr.
    pub fn error(&self, failed: &Failed) {
        self.end();
        let _ = writeln!(std::io::stderr().lock(), "{failed}");
    }

    fn bar(&self) -> MutexGuard<'_, Option<ProgressBar>> {
        self.bar.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A list that is being printed.
pub struct List<'a> {
    printer: &'a Printer,
    entries: usize,
}

impl List<'_> {
    /// The next entry, printed at once as JSON.
    pub fn add(&mut self, entry: &impl Serialize) {
        if self.printer.json {
            let before = if self.entries == 0 { "[" } else { "," };
            self.printer.print(&format!("{before}{}", serde_json::to_string(entry).unwrap_or_default()));
        }
        self.entries += 1;
    }

    /// Closes the list, or prints the text in its place.
    pub fn end(self, text: &str) {
        match (self.printer.json, self.entries) {
            (true, 0) => self.printer.print("[]"),
            (true, _) => self.printer.print("]"),
            (false, _) => self.printer.print(text.trim_end()),
        }
    }
}

/// A bar with rate and time left; silent when stderr is no terminal.
impl Progress for Printer {
    fn begin(&self, what: &str, total: usize) {
        let target = if self.quiet || !std::io::stderr().is_terminal() {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr_with_hz(8)
        };
        let bar = ProgressBar::with_draw_target(Some(total as u64), target);
        if let Ok(style) =
            ProgressStyle::with_template("{msg:18} {bar:30} {pos:>4}/{len}  {per_sec}  ETA {eta}  {prefix}")
        {
            bar.set_style(style);
        }
        bar.set_message(what.to_owned());
        keep_ticking(&bar);
        *self.bar() = Some(bar);
    }

    fn advance(&self) {
        if let Some(bar) = &*self.bar() {
            bar.inc(1);
        }
    }

    fn tell(&self, state: &str) {
        if let Some(bar) = &*self.bar() {
            bar.set_prefix(state.to_owned());
        }
    }

    fn end(&self) {
        if let Some(bar) = self.bar().take() {
            bar.finish_and_clear();
        }
    }

    fn note(&self, text: &str) {
        self.say(text);
    }
}

/// Keeps rate and time left up to date between two parts; where the system gives no thread for that, they wait.
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
