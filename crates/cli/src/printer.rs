//! One place decides what is printed where: stdout is data, stderr is talk.

use std::io::{IsTerminal, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

use crate::error::Failed;

/// Prints results, messages and progress as the user asked.
pub struct Printer {
    json: bool,
    quiet: bool,
}

impl Printer {
    /// `json` turns tables into JSON on stdout; `quiet` drops talk.
    pub fn new(json: bool, quiet: bool) -> Self {
        Self { json, quiet }
    }

    /// Data: the JSON value or the text, to stdout.
    pub fn data(&self, value: &impl Serialize, text: &str) {
        let output = if self.json {
            serde_json::to_string_pretty(value).unwrap_or_default()
        } else {
            text.trim_end().to_owned()
        };
        // A closed pipe is the reader's choice, not an error.
        let _ = writeln!(std::io::stdout().lock(), "{output}");
    }

    /// Talk: to stderr, unless quiet.
    pub fn say(&self, text: impl AsRef<str>) {
        if !self.quiet {
            let _ = writeln!(std::io::stderr().lock(), "{}", text.as_ref());
        }
    }

    /// An error: always to stderr.
    pub fn error(&self, failed: &Failed) {
        let _ = writeln!(std::io::stderr().lock(), "{failed}");
    }

    /// A progress bar with rate and time left; silent when stderr is no terminal.
    pub fn progress(&self, what: &str, total: usize) -> ProgressBar {
        let target = if self.quiet || !std::io::stderr().is_terminal() {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr_with_hz(8)
        };
        let bar = ProgressBar::with_draw_target(Some(total as u64), target);
        if let Ok(style) = ProgressStyle::with_template("{msg:18} {bar:30} {pos:>4}/{len}  {per_sec}  ETA {eta}") {
            bar.set_style(style);
        }
        bar.set_message(what.to_owned());
        bar.enable_steady_tick(Duration::from_millis(250));
        bar
    }
}

/// A table with aligned columns; the first row is the head.
pub fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns)
        .map(|column| rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0))
        .collect();
    let mut text = String::new();
    for (index, row) in rows.iter().enumerate() {
        let line: Vec<String> = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:width$}")).collect();
        text += line.join("  ").trim_end();
        text.push('\n');
        if index == 0 {
            text += &widths.iter().map(|&width| "─".repeat(width)).collect::<Vec<_>>().join("  ");
            text.push('\n');
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::table;

    #[test]
    fn columns_line_up() {
        let rows = [["task", "verified"], ["017", "2/2"]].map(|row| row.map(String::from).to_vec());
        assert_eq!(table(&rows), "task  verified\n────  ────────\n017   2/2\n");
    }
}
