//! Files of the repository, as the rules read them.

use crate::problem::{OnPath, Problem, Result};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// A file of the repository.
pub struct Entry {
    /// From the root, with `/` on every system.
    pub path: String,
    /// `None` when it is not text.
    pub text: Option<String>,
}

/// Files and folders of the repository.
pub struct Tree(BTreeSet<String>);

impl Tree {
    pub fn new(files: &[Entry]) -> Self {
        let mut all = BTreeSet::from([String::new()]);
        for file in files {
            let ends = file.path.match_indices('/').map(|(at, _)| at).chain([file.path.len()]);
            all.extend(ends.map(|end| file.path[..end].to_owned()));
        }
        Self(all)
    }

    /// True for a file or folder at this path from the root.
    pub fn has(&self, path: &str) -> bool {
        self.0.contains(path.trim_end_matches('/'))
    }

    /// True for a file or folder whose path ends with these components.
    pub fn has_suffix(&self, path: &str) -> bool {
        let suffix = format!("/{path}");
        self.has(path) || self.0.iter().any(|one| one.ends_with(&suffix))
    }
}

/// All files of the repository but those that .gitignore names; git itself is not needed, so that an unpacked archive
/// can be checked as well.
pub fn read(root: &Path) -> Result<Vec<Entry>> {
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

pub fn text_of<'a>(files: &'a [Entry], path: &str) -> Result<&'a str> {
    let found = files.iter().find(|file| file.path == path).and_then(|file| file.text.as_deref());
    found.ok_or_else(|| Problem {
        what: format!("the file is missing or not text: {path}"),
        expected: "a text file that the tidy check reads".into(),
        hint: "take it from the history: `git log --follow` finds it".into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

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
