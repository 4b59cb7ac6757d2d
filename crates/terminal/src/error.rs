//! What a person reads when something cannot be done, and the exit status a program reads.

use std::error::Error;
use std::fmt;
use std::process::ExitCode;

use genmanip_workspace::RunError;

/// Exit codes are an interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExitStatus {
    /// 0: done.
    Done,
    /// 1: the request could not be met.
    NotMet,
    /// 2: the command line was not understood.
    NotUnderstood,
}

impl From<ExitStatus> for ExitCode {
    fn from(status: ExitStatus) -> Self {
        match status {
            ExitStatus::Done => Self::SUCCESS,
            ExitStatus::NotMet => Self::from(1),
            ExitStatus::NotUnderstood => Self::from(2),
        }
    }
}

/// One clear message: what could not be done, why, and what helps.
#[derive(Debug)]
pub struct Failed {
    what: String,
    causes: Vec<String>,
    hint: Option<String>,
    status: ExitStatus,
}

impl Failed {
    /// A failure in one sentence.
    pub fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), causes: Vec::new(), hint: None, status: ExitStatus::NotMet }
    }

    /// With the error that caused it and the errors behind that.
    pub fn because(what: impl Into<String>, error: &dyn Error) -> Self {
        Self { what: what.into(), causes: chain(error), hint: None, status: ExitStatus::NotMet }
    }

    /// A value on the command line that makes no sense, in one sentence.
    pub fn misused(what: impl Into<String>) -> Self {
        Self { status: ExitStatus::NotUnderstood, ..Self::new(what) }
    }

    /// How the program ends.
    pub fn status(&self) -> ExitStatus {
        self.status
    }

    /// With what helps.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }
}

impl From<RunError> for Failed {
    fn from(error: RunError) -> Self {
        let causes = error.source().map_or_else(Vec::new, chain);
        // These names are known whatever any file holds.
        let typed = ["policy", "policy argument", "kind", "preset"];
        let is_misused = matches!(&error, RunError::UnknownName { what, .. } if typed.contains(what));
        let status = if is_misused { ExitStatus::NotUnderstood } else { ExitStatus::NotMet };
        Self { what: error.to_string(), causes, hint: error.hint(), status }
    }
}

/// An error and those behind it, each in a line.
fn chain(error: &dyn Error) -> Vec<String> {
    let mut causes = vec![error.to_string()];
    let mut source = error.source();
    while let Some(error) = source {
        // Many errors already say what is behind them.
        let cause = error.to_string();
        if causes.last().is_none_or(|last| !last.contains(&cause)) {
            causes.push(cause);
        }
        source = error.source();
    }
    causes
}

impl fmt::Display for Failed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "error: {}", readable(&self.what))?;
        for cause in &self.causes {
            write!(f, "\n  {}", readable(cause))?;
        }
        if let Some(hint) = &self.hint {
            write!(f, "\nhint: {}", readable(hint))?;
        }
        Ok(())
    }
}

/// Longest word of a message, characters: longer than paths are, shorter than what a file may hold for a name.
const LONGEST_WORD: usize = 400;

/// A message that may repeat what a file says: its words cut, and what would steer the terminal or turn the direction of
/// writing spelled out.
fn readable(text: &str) -> String {
    let mut plain = String::with_capacity(text.len().min(4096));
    let mut length = 0;
    for c in text.chars() {
        length = if c.is_whitespace() { 0 } else { length + 1 };
        let is_hidden = c.is_control() && c != '\n' || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        match length {
            _ if length > LONGEST_WORD + 1 => {}
            _ if length == LONGEST_WORD + 1 => plain.push('…'),
            _ if is_hidden => plain.extend(c.escape_unicode()),
            _ => plain.push(c),
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_file_says_cannot_flood_or_steer_the_terminal() {
        let name = format!("got `{}` and more", "x".repeat(20_000));
        let said = Failed::new(name).hint("a\u{1b}[2Jb \u{202e}c\nd").to_string();
        let expected = format!("error: got `{}… and more\nhint: a\\u{{1b}}[2Jb \\u{{202e}}c\nd", "x".repeat(399));
        assert_eq!(said, expected);
    }
}
