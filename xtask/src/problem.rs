//! One error type: what happened, what was expected, what to do now.

use std::fmt;

/// An error as a person should meet it.
#[derive(Debug)]
pub struct Problem {
    pub what: String,
    pub expected: String,
    pub hint: String,
}

pub type Result<T = ()> = std::result::Result<T, Problem>;

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let indented = |text: &str| text.replace('\n', "\n            ");
        writeln!(f, "error: {}", self.what)?;
        writeln!(f, "  expected: {}", indented(&self.expected))?;
        write!(f, "  hint:     {}", indented(&self.hint))
    }
}

/// Adds what was being done to an error of the file system.
pub trait OnPath<T> {
    /// `doing` is a verb in the present: "write", "read"; the path comes last.
    fn on(self, doing: &str, path: &std::path::Path) -> Result<T>;
}

impl<T> OnPath<T> for std::io::Result<T> {
    fn on(self, doing: &str, path: &std::path::Path) -> Result<T> {
        self.map_err(|error| Problem {
            what: format!("cannot {doing}: {error}: {}", path.display()),
            expected: format!("to be able to {doing} this path"),
            hint: "check that it exists, that its folder is writable and that the disk is not full".into(),
        })
    }
}
