//! The rules of ARCHITECTURE.md and CONTRIBUTING.md that the compiler does not know.
//!
//! The dependency rule is read from the table in ARCHITECTURE.md itself, so the page cannot drift from the code.

mod circles;
mod exceptions;
mod imports;
mod lexer;
mod links;
mod manifest;
mod openings;
mod quoted;
mod repository;
mod structure;
mod subcommands;
mod table;
mod text;
mod toml;
mod violation;
mod words;

use crate::command_line;
use crate::docs;
use crate::problem::{Problem, Result};
use exceptions::Exceptions;
use repository::{Entry, Tree, text_of};
use std::path::Path;
use subcommands::Subcommands;
use violation::Violation;

/// Checks everything and fails with the whole list.
///
/// Arguments are `--rule NAME` and path prefixes; with any, limits of `tidy-exceptions.txt` do not count.
pub fn run(root: &Path, args: &[String]) -> Result {
    let choice = Choice::parse(args)?;
    let violations = check(root, &choice)?;
    if violations.is_empty() {
        eprintln!("tidy: all rules hold");
        return Ok(());
    }
    let list = violations.iter().map(|v| format!("\n  {}: {}\n      {}", v.place, v.what, v.hint));
    Err(Problem {
        what: format!("{} rules are broken{}", violations.len(), list.collect::<String>()),
        expected: "the rules of ARCHITECTURE.md and CONTRIBUTING.md".into(),
        hint: "fix the code; if the rule is wrong, fix the rule there with its reason".into(),
    })
}

const RULES: [&str; 10] =
    ["dependencies", "structure", "circles", "knots", "text", "openings", "words", "links", "quoted", "marks"];

/// Part of the rules and files.
#[derive(Debug, Default)]
pub struct Choice {
    rule: Option<String>,
    paths: Vec<String>,
}

impl Choice {
    fn parse(args: &[String]) -> Result<Self> {
        let mut choice = Self::default();
        let mut args = args.iter();
        while let Some(arg) = args.next() {
            if arg != "--rule" {
                choice.paths.push(arg.trim_start_matches("./").to_owned());
                continue;
            }
            let known = args.next().filter(|rule| RULES.contains(&rule.as_str()));
            choice.rule = Some(known.cloned().ok_or_else(|| Problem {
                what: "--rule names no rule".into(),
                expected: RULES.join(", "),
                hint: "`cargo xtask tidy --rule openings crates/core` lists those of one folder".into(),
            })?);
        }
        Ok(choice)
    }

    fn is_everything(&self) -> bool {
        self.rule.is_none() && self.paths.is_empty()
    }

    fn has(&self, violation: &Violation) -> bool {
        self.paths.is_empty() || self.paths.iter().any(|path| violation.place.starts_with(path.as_str()))
    }
}

/// Every broken rule, in the order of the paths.
pub fn check(root: &Path, choice: &Choice) -> Result<Vec<Violation>> {
    let files = repository::read(root)?;
    let exceptions = Exceptions::parse(text_of(&files, exceptions::PATH)?)?;
    let tree = Tree::new(&files);
    let mut found: Vec<Violation> = Vec::new();
    for rule in RULES.into_iter().filter(|rule| choice.rule.as_deref().is_none_or(|one| one == *rule)) {
        let violations = match rule {
            "dependencies" => dependencies(&files)?,
            "structure" => structure::check(&files, &exceptions),
            "circles" => circles::check(&files, circles::Kind::Circles),
            "knots" => circles::check(&files, circles::Kind::Knots),
            "openings" => openings::check(&files),
            "words" => words::Words::parse(text_of(&files, words::PATH)?)?.check(&files),
            "links" => links::check(&files, &tree),
            "quoted" => quoted::check(&files, &tree, &known(&files)),
            "marks" => marks(&files),
            _ => text::check(&files),
        };
        if choice.is_everything() {
            found.extend(exceptions.limit(rule, violations));
        } else {
            found.extend(violations.into_iter().filter(|violation| choice.has(violation)));
        }
    }
    found.sort_by(|a, b| a.place.cmp(&b.place));
    Ok(found)
}

/// Manifests against the table of ARCHITECTURE.md.
fn dependencies(files: &[Entry]) -> Result<Vec<Violation>> {
    let crates = manifest::crates(files);
    let table = table::parse(text_of(files, "ARCHITECTURE.md")?)?;
    let mut found = table::check(&table, &crates, &manifest::shared(text_of(files, "Cargo.toml")?));
    found.extend(manifest::check_run_path(&crates));
    Ok(found)
}

/// Code blocks of pages that the docs phase could not read.
fn marks(files: &[Entry]) -> Vec<Violation> {
    let pages = files.iter().filter(|file| docs::is_page(&file.path));
    let read = |file: &Entry| docs::plan::read(&file.path, file.text.as_deref().unwrap_or_default()).err();
    let problems = pages.filter_map(read);
    let violation = |problem: Problem| {
        let parts: Vec<&str> = problem.what.splitn(3, ':').collect();
        let place = parts.iter().take(2).copied().collect::<Vec<_>>().join(":");
        let what = parts.last().map_or("", |what| what.trim()).to_owned();
        Violation { place, what, hint: format!("{}; expected {}", problem.hint, problem.expected) }
    };
    problems.map(violation).collect()
}

/// Names that commands quoted in Markdown are checked against.
fn known(files: &[Entry]) -> quoted::Known {
    let below = |folder: &str| -> Vec<&str> {
        let inside = files.iter().filter(|file| file.path.starts_with(folder) && file.path.ends_with(".rs"));
        inside.filter_map(|file| file.text.as_deref()).collect()
    };
    let programs = [("genmanip", "crates/cli/src/", "Command"), ("genmanip-lab", "crates/lab/src/", "LabCommand")];
    let packages = files.iter().filter(|file| file.path.ends_with("Cargo.toml"));
    let packages = packages.map(|file| manifest::parse("", file.text.as_deref().unwrap_or_default()).package);
    quoted::Known {
        programs: programs.map(|(name, folder, root)| (name, Subcommands::read(&below(folder), root))).into(),
        packages: packages.filter(|package| !package.is_empty()).collect(),
        xtask: command_line::SUBCOMMANDS.into(),
        phases: command_line::test_words(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rules hold in this repository; so `cargo test` alone finds what `cargo xtask tidy` would.
    #[test]
    fn this_repository_is_tidy() {
        let problem = run(&crate::process::Workspace::find().root, &[]).err();
        assert!(problem.is_none(), "{}", problem.map(|p| p.to_string()).unwrap_or_default());
    }
}
