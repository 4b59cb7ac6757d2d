//! The rules of ARCHITECTURE.md and CONTRIBUTING.md that the compiler does not know.
//!
//! The dependency rule is read from the table in ARCHITECTURE.md itself, so the page cannot drift from the code.

mod circles;
mod imports;
mod manifest;
mod structure;
mod table;
mod text;

use crate::problem::{OnPath, Problem, Result};
use std::fs;
use std::path::Path;

/// One broken rule.
#[derive(Debug, PartialEq)]
pub struct Violation {
    /// Path from the root, with a line where there is one.
    pub place: String,
    pub what: String,
    pub hint: String,
}

/// A file of the repository.
pub struct Entry {
    /// From the root, with `/` on every system.
    pub path: String,
    /// `None` when it is not text.
    pub text: Option<String>,
}

/// Checks everything and fails with the whole list.
pub fn run(root: &Path) -> Result {
    let violations = check(root)?;
    if violations.is_empty() {
        eprintln!("tidy: all rules hold");
        return Ok(());
    }
    let list = violations.iter().map(|v| format!("\n  {}: {}\n      {}", v.place, v.what, v.hint));
    Err(Problem {
        what: format!("{} rules are broken{}", violations.len(), list.collect::<String>()),
        expected: "the rules of ARCHITECTURE.md and CONTRIBUTING.md".into(),
        hint: "mend the code; if the rule is wrong, mend the rule there with its reason".into(),
    })
}

/// Every broken rule, in the order of the paths.
pub fn check(root: &Path) -> Result<Vec<Violation>> {
    let files = files(root)?;
    let exceptions = structure::Exceptions::parse(text_of(&files, structure::EXCEPTIONS)?)?;
    let crates = manifest::crates(&files);
    let table = table::parse(text_of(&files, "ARCHITECTURE.md")?)?;
    let mut found = table::check(&table, &crates, &manifest::shared(text_of(&files, "Cargo.toml")?));
    found.extend(manifest::check_run_path(&crates));
    found.extend(structure::check(&files, &exceptions));
    found.extend(circles::check(&files));
    found.extend(text::check(&files));
    found.sort_by(|a, b| a.place.cmp(&b.place));
    Ok(found)
}

fn text_of<'a>(files: &'a [Entry], path: &str) -> Result<&'a str> {
    let found = files.iter().find(|file| file.path == path).and_then(|file| file.text.as_deref());
    found.ok_or_else(|| Problem {
        what: format!("the file is missing or not text: {path}"),
        expected: "a text file that the tidy check reads".into(),
        hint: "take it from the history: `git log --follow` finds it".into(),
    })
}

/// All files of the repository but those that .gitignore names; git itself is not needed, so that an unpacked archive
/// can be checked as well.
fn files(root: &Path) -> Result<Vec<Entry>> {
    let path = root.join(".gitignore");
    let ignored = fs::read_to_string(&path).on("read", &path)?;
    let ignored: Vec<&str> = ignored.lines().map(str::trim).filter(|line| !line.starts_with('#')).collect();
    let mut files = Vec::new();
    walk(root, "", &ignored, &mut files)?;
    files.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(files)
}

fn walk(folder: &Path, prefix: &str, ignored: &[&str], files: &mut Vec<Entry>) -> Result {
    for entry in fs::read_dir(folder).on("read", folder)? {
        let entry = entry.on("read", folder)?;
        let path = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if path == ".git" || ignored.iter().any(|pattern| is_ignored(&path, pattern)) {
            continue;
        }
        let kind = entry.file_type().on("read", &entry.path())?;
        if kind.is_dir() {
            walk(&entry.path(), &format!("{path}/"), ignored, files)?;
        } else if kind.is_file() {
            let bytes = fs::read(entry.path()).on("read", &entry.path())?;
            let text = if bytes.contains(&0) { None } else { String::from_utf8(bytes).ok() };
            files.push(Entry { path, text });
        }
    }
    Ok(())
}

/// The few forms of pattern that our .gitignore uses: `/from/the/root`, `/starts-with*`, `*.suffix`, `name`.
fn is_ignored(path: &str, pattern: &str) -> bool {
    let pattern = pattern.trim_end_matches('/');
    if let Some(rooted) = pattern.strip_prefix('/') {
        return rooted.strip_suffix('*').map_or(path == rooted, |start| path.starts_with(start));
    }
    let name = path.rsplit('/').next().unwrap_or(path);
    match pattern.strip_prefix('*') {
        Some(suffix) => name.ends_with(suffix),
        None => !pattern.is_empty() && name == pattern,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rules hold in this repository; so `cargo test` alone finds what `cargo xtask tidy` would.
    #[test]
    fn this_repository_is_tidy() {
        let problem = run(&crate::process::Workspace::find().root).err();
        assert!(problem.is_none(), "{}", problem.map(|p| p.to_string()).unwrap_or_default());
    }

    #[test]
    fn ignore_patterns() {
        let check = |path: &str, pattern: &str, ignored: bool| {
            assert_eq!(is_ignored(path, pattern), ignored, "{path} against {pattern}");
        };
        check("target", "/target", true);
        check("crates/target", "/target", false);
        check("target-ci", "/target-*", true);
        check("third_party/mujoco", "/third_party/mujoco", true);
        check("a/b.tmp", "*.tmp", true);
        check("a/b.rs", "*.tmp", false);
        check("a/__pycache__", "__pycache__/", true);
        check("a", "", false);
    }
}
