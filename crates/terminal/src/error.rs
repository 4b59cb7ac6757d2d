//! Errors as they are shown to the user, and exit codes.

use std::error::Error;
use std::fmt;
use std::process::ExitCode;

use genmanip_workspace::{WorkspaceError, hint, messages};

/// Exit codes of the programs; scripts may rely on them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExitStatus {
    /// Exit code 0: success.
    Done,
    /// Exit code 1: the request could not be met.
    NotMet,
    /// Exit code 2: the command line was invalid.
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

/// Error message for the user: the failed action, its causes, and a hint.
#[derive(Debug)]
pub struct Failed {
    what: String,
    causes: Vec<String>,
    hint: Option<String>,
    status: ExitStatus,
}

impl Failed {
    /// Failure described in one sentence, with exit code 1.
    pub fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), causes: Vec::new(), hint: None, status: ExitStatus::NotMet }
    }

    /// Failure with the chain of causes of an error, and the hint that fits the error.
    pub fn because(what: impl Into<String>, error: &(dyn Error + 'static)) -> Self {
        Self { what: what.into(), causes: messages(error), hint: hint(error), status: ExitStatus::NotMet }
    }

    /// Invalid command-line value, described in one sentence, with exit code 2.
    pub fn misused(what: impl Into<String>) -> Self {
        Self { status: ExitStatus::NotUnderstood, ..Self::new(what) }
    }

    /// Exit code of the program after this failure.
    pub fn status(&self) -> ExitStatus {
        self.status
    }

    /// Same failure with this hint instead of any other.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }

    /// Same failure, with this hint if the causes suggest none.
    #[must_use]
    pub fn or_hint(mut self, hint: impl Into<String>) -> Self {
        self.hint.get_or_insert_with(|| hint.into());
        self
    }
}

impl From<WorkspaceError> for Failed {
    fn from(error: WorkspaceError) -> Self {
        let causes = error.source().map_or_else(Vec::new, messages);
        // Valid names of these do not depend on a file's contents, so that an unknown one is a mistake in the command
        // line.
        let typed = ["policy", "policy argument", "kind", "preset"];
        let is_misused = matches!(&error, WorkspaceError::UnknownName { what, .. } if typed.contains(what));
        let status = if is_misused { ExitStatus::NotUnderstood } else { ExitStatus::NotMet };
        Self { what: error.to_string(), causes, hint: error.hint(), status }
    }
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

/// Maximum word length in a message, characters: longer than paths, shorter than names that a file may contain.
const MAX_WORD_CHARS: usize = 400;

/// Text that may repeat a file's contents, made safe for a terminal: long words are cut, and control and bidirectional
/// characters are escaped.
fn readable(text: &str) -> String {
    let mut plain = String::with_capacity(text.len().min(4096));
    let mut length = 0;
    for c in text.chars() {
        length = if c.is_whitespace() { 0 } else { length + 1 };
        let is_hidden = c.is_control() && c != '\n' || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        match length {
            _ if length > MAX_WORD_CHARS + 1 => {}
            _ if length == MAX_WORD_CHARS + 1 => plain.push('…'),
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
