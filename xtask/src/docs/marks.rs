//! Marks that pages set on their code blocks: HTML comments `<!-- docs: … -->` on the lines above a block.

use crate::markdown::Comment;
use crate::problem::{Problem, Result};

/// Beginning of every mark.
pub const PREFIX: &str = "docs:";

/// Instruction for the next block, or for the whole page.
#[derive(Debug, Clone, PartialEq)]
pub enum Mark {
    /// The block is not run, for this reason.
    Skip(String),
    /// The block runs in `cargo xtask test --interop` alone.
    Interop,
    /// Text of the block that is replaced before it runs.
    Replace(String, String),
    /// The block is started and kept running until the page ends. The next block waits for this port to accept
    /// connections, or else for the first line of output.
    Background(Option<u16>),
    /// Expected exit code.
    Fails(i32),
    /// Shell command that runs before the block and is not shown to readers.
    Run(String),
    /// Page whose blocks run first in the same folder.
    Needs(String),
    /// No block of the page is run, for this reason.
    Off(String),
}

impl Mark {
    /// True if the mark is about the whole page.
    pub fn is_of_page(&self) -> bool {
        matches!(self, Self::Needs(_) | Self::Off(_))
    }
}

/// Marks of a comment, one per line; `None` if the comment holds none.
pub fn read(path: &str, comment: &Comment) -> Result<Option<Vec<Mark>>> {
    if !comment.text.starts_with(PREFIX) {
        return Ok(None);
    }
    let lines = comment.text.lines().map(str::trim).filter(|line| !line.is_empty());
    let mark = |(number, line): (usize, &str)| {
        let text = line.strip_prefix(PREFIX).map(str::trim);
        text.and_then(mark).ok_or_else(|| Problem {
            what: format!("{path}:{}: not a mark: `{line}`", comment.line + number),
            expected: "docs: skip REASON, interop, replace FROM => TO, background [PORT], fails [CODE], run COMMAND, \
                       needs PAGE or off REASON"
                .into(),
            hint: "CONTRIBUTING.md, \"Code blocks of the documentation\", says what they do".into(),
        })
    };
    lines.enumerate().map(mark).collect::<Result<Vec<_>>>().map(Some)
}

fn mark(text: &str) -> Option<Mark> {
    let (name, rest) = text.split_once(' ').map_or((text, ""), |(name, rest)| (name, rest.trim()));
    let given = || (!rest.is_empty()).then(|| rest.to_owned());
    match name {
        "skip" => given().map(Mark::Skip),
        "off" => given().map(Mark::Off),
        "run" => given().map(Mark::Run),
        "needs" => given().map(Mark::Needs),
        "interop" if rest.is_empty() => Some(Mark::Interop),
        "replace" => {
            let (from, to) = rest.split_once("=>")?;
            let (from, to) = (from.trim(), to.trim());
            (!from.is_empty()).then(|| Mark::Replace(from.to_owned(), to.to_owned()))
        }
        "background" if rest.is_empty() => Some(Mark::Background(None)),
        "background" => rest.parse().ok().map(|port| Mark::Background(Some(port))),
        "fails" if rest.is_empty() => Some(Mark::Fails(1)),
        "fails" => rest.parse().ok().map(Mark::Fails),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_read() {
        let read = |text: &str| read("a.md", &Comment { line: 3, end: 3, text: text.into() });
        assert_eq!(read("a remark").unwrap(), None);
        let found = read("docs: skip needs a GPU\n  docs: replace --count 9 => --count 1").unwrap().unwrap();
        assert_eq!(found, [Mark::Skip("needs a GPU".into()), Mark::Replace("--count 9".into(), "--count 1".into())]);
        for (text, mark) in [
            ("docs: interop", Mark::Interop),
            ("docs: background", Mark::Background(None)),
            ("docs: background 8000", Mark::Background(Some(8000))),
            ("docs: fails", Mark::Fails(1)),
            ("docs: fails 2", Mark::Fails(2)),
            ("docs: run mkdir a", Mark::Run("mkdir a".into())),
            ("docs: needs docs/guides/b.md", Mark::Needs("docs/guides/b.md".into())),
            ("docs: off being rewritten", Mark::Off("being rewritten".into())),
            ("docs: replace --slow =>", Mark::Replace("--slow".into(), String::new())),
        ] {
            assert_eq!(read(text).unwrap(), Some(vec![mark]), "{text}");
        }
        for wrong in [
            "docs: skip",
            "docs: off",
            "docs: hide it",
            "docs: background soon",
            "docs: replace a b",
            "docs: skip x\nmore",
        ] {
            let error = read(wrong).unwrap_err();
            assert!(error.what.contains("a.md:"), "{wrong}: {error}");
        }
    }
}
