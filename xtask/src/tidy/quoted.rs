//! Paths and commands that Markdown quotes exist: files, subcommands of the programs, subcommands of xtask, packages.

use super::repository::{Entry, Tree};
use super::subcommands::Subcommands;
use super::violation::Violation;
use crate::markdown;
use std::collections::BTreeSet;

/// Folders of the repository whose paths are checked; others may be made by the reader.
const FOLDERS: [&str; 12] = [
    ".cargo/",
    ".github/",
    "benches/",
    "build/",
    "crates/",
    "docs/",
    "examples/",
    "fuzz/",
    "python/",
    "schemas/",
    "suites/",
    "xtask/",
];
/// Fenced blocks whose commands are checked.
pub const SHELLS: [&str; 3] = ["sh", "bash", "console"];
/// Global options of the programs that take a value.
const WITH_VALUE: [&str; 1] = ["--packs"];

/// The names that commands are checked against.
pub struct Known {
    /// Subcommands by program.
    pub programs: Vec<(&'static str, Subcommands)>,
    /// Names of the workspace's packages.
    pub packages: BTreeSet<String>,
    /// Subcommands of xtask.
    pub xtask: Vec<&'static str>,
    /// Phases and options of `cargo xtask test`.
    pub phases: Vec<&'static str>,
}

/// Everything quoted that does not exist. The changelog is exempt: it tells of what was.
pub fn check(files: &[Entry], tree: &Tree, known: &Known) -> Vec<Violation> {
    let mut found = Vec::new();
    let is_page = |file: &&Entry| file.path.ends_with(".md") && file.path != "CHANGELOG.md";
    for file in files.iter().filter(is_page).filter(|file| !file.path.contains("/prompts/")) {
        let page = markdown::read(file.text.as_deref().unwrap_or_default());
        let mut report = |line: usize, (what, hint): (String, String)| {
            found.push(Violation { place: format!("{}:{line}", file.path), what, hint });
        };
        for (line, span) in page.spans() {
            for word in span.split_whitespace() {
                if let Some(fault) = path_fault(word, tree) {
                    report(line, fault);
                }
            }
            if let Some(fault) = command_fault(&span, known) {
                report(line, fault);
            }
        }
        for block in page.blocks.iter().filter(|block| SHELLS.contains(&block.language.as_str())) {
            for (number, line) in block.lines.iter().enumerate() {
                for fault in commands(line).filter_map(|command| command_fault(command, known)) {
                    report(block.line + 1 + number, fault);
                }
            }
        }
    }
    found
}

/// Simple commands of a shell line, comments and prompts dropped.
fn commands(line: &str) -> impl Iterator<Item = &str> {
    let line = line.split(" #").next().unwrap_or_default();
    line.split(['|', ';', '&', '(', ')']).map(|command| command.trim().trim_start_matches("$ "))
}

fn path_fault(word: &str, tree: &Tree) -> Option<(String, String)> {
    let word = word.trim_end_matches([',', ';', ':', ')', '.']);
    let word = word.split(['#', ':']).next().unwrap_or_default();
    let is_rust = word.ends_with(".rs") && !word.starts_with(['*', '.', '/']);
    let is_below = FOLDERS.iter().any(|folder| word.starts_with(folder));
    if !is_below && !is_rust {
        return None;
    }
    // Up to what stands for something else: wildcards, braces, variables, NAMES.
    let is_certain = |part: &&str| {
        let has_mark = part.contains(['*', '?', '{', '<', '$', '…', '[', '=', '%']) || part.contains("...");
        let is_name = part.chars().any(|letter| letter.is_ascii_uppercase())
            && part
                .split(['.', '-'])
                .next()
                .is_some_and(|stem| stem.chars().all(|c| c.is_ascii_uppercase() || c == '_'))
            && !part.ends_with(".md");
        !has_mark && !is_name
    };
    let parts: Vec<&str> = word.trim_end_matches('/').split('/').collect();
    let certain: Vec<&str> = parts.iter().copied().take_while(is_certain).collect();
    let path = certain.join("/");
    let is_whole = certain.len() == parts.len();
    let exists = if is_rust && is_whole { tree.has_suffix(&path) } else { !is_below || tree.has(&path) };
    (!exists).then(|| (format!("no such file or folder: {word}"), "name what exists now, or remove the mention".into()))
}

fn command_fault(command: &str, known: &Known) -> Option<(String, String)> {
    let words: Vec<&str> = command.split_whitespace().collect();
    let is_word = |word: &str| {
        word.starts_with(|letter: char| letter.is_ascii_lowercase())
            && word.chars().all(|letter| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '-')
    };
    let missing = |what: &str, word: &str, names: &[&str]| {
        (!names.contains(&word)).then(|| {
            (format!("there is no {what} `{word}`: `{command}`"), format!("expected one of: {}", names.join(", ")))
        })
    };
    match words.as_slice() {
        ["cargo", "xtask", name, rest @ ..] if is_word(name) => {
            let phase = || {
                let rest = if *name == "test" { rest } else { &[] };
                let given = rest.iter().filter(|word| is_word(word) || word.starts_with("--"));
                given.into_iter().find_map(|word| missing("phase or option of `cargo xtask test`", word, &known.phases))
            };
            missing("subcommand of xtask", name, &known.xtask).or_else(phase)
        }
        ["cargo", rest @ ..] => {
            let named = rest.windows(2).filter(|pair| matches!(pair[0], "-p" | "--package") && is_word(pair[1]));
            let ours = named.map(|pair| pair[1]).filter(|name| name.starts_with("genmanip") || *name == "xtask");
            let names: Vec<&str> = known.packages.iter().map(String::as_str).collect();
            ours.into_iter().find_map(|name| missing("package", name, &names))
        }
        [program, rest @ ..] => {
            let (_, subcommands) = known.programs.iter().find(|(name, _)| name == program)?;
            let mut rest = rest.iter().copied().peekable();
            while let Some(option) = rest.next_if(|word| word.starts_with('-')) {
                if WITH_VALUE.contains(&option) {
                    rest.next();
                }
            }
            let mut path = Vec::new();
            loop {
                let names = subcommands.below(&path)?;
                let word = rest.next().filter(|word| is_word(word) && *word != "help")?;
                if let Some(fault) = missing(&format!("subcommand of `{program}`"), word, &names) {
                    return Some(fault);
                }
                path.push(word);
            }
        }
        [] => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(text: &str) -> Vec<String> {
        let source =
            "pub enum Command { Layout(X), Task { command: TaskCommand } } enum TaskCommand { New(Y), CheckAll }";
        let known = Known {
            programs: vec![("genmanip", Subcommands::read(&[source], "Command"))],
            packages: ["genmanip-core".to_owned()].into(),
            xtask: vec!["setup", "test"],
            phases: vec!["fmt", "--s3"],
        };
        let file = |path: &str, text: &str| Entry { path: path.into(), text: Some(text.into()) };
        let files = [file("docs/a.md", text), file("crates/core/src/seed.rs", ""), file("examples/tasks/1.json", "")];
        check(&files, &Tree::new(&files), &known).into_iter().map(|one| format!("{} {}", one.place, one.what)).collect()
    }

    #[test]
    fn paths() {
        assert!(
            faults("`crates/core/src/seed.rs`, `crates/core`, `examples/tasks/*.json`, `crates/NAME/x`, `out/x`")
                .is_empty()
        );
        assert!(faults("`src/seed.rs`, `seed.rs:12`, `docs/a.md#there`, `crates/{core,sim}`, `suites`, `tests/NAME.rs` and crates/x").is_empty());
        assert_eq!(
            faults("a\n`crates/sim`\n`genmanip layout examples/none`\n`feed.rs`\n`crates/none/*.rs`"),
            [
                "docs/a.md:2 no such file or folder: crates/sim",
                "docs/a.md:3 no such file or folder: examples/none",
                "docs/a.md:4 no such file or folder: feed.rs",
                "docs/a.md:5 no such file or folder: crates/none/*.rs",
            ]
        );
    }

    #[test]
    fn commands_of_programs() {
        assert!(
            faults(
                "`genmanip --packs x layout a`, `genmanip task check-all`, `genmanip VERB`, `genmanip`, `genmanip help`"
            )
            .is_empty()
        );
        let block =
            "```sh\ngenmanip lay out # genmanip no\ncat x | genmanip task old --x\n```\n```text\ngenmanip none\n```\n";
        assert_eq!(
            faults(block),
            [
                "docs/a.md:2 there is no subcommand of `genmanip` `lay`: `genmanip lay out`",
                "docs/a.md:3 there is no subcommand of `genmanip` `old`: `genmanip task old --x`",
            ]
        );
    }

    #[test]
    fn commands_of_cargo() {
        assert!(
            faults(
                "`cargo xtask setup`, `cargo xtask test fmt --s3`, `cargo test -p genmanip-core`, `cargo add -p serde`"
            )
            .is_empty()
        );
        assert_eq!(
            faults("`cargo xtask tidy`")[0],
            "docs/a.md:1 there is no subcommand of xtask `tidy`: `cargo xtask tidy`"
        );
        assert!(faults("`cargo xtask test speed`")[0].contains("no phase or option of `cargo xtask test` `speed`"));
        assert!(faults("`cargo run --release -p genmanip-old -- x`")[0].contains("no package `genmanip-old`"));
    }
}
