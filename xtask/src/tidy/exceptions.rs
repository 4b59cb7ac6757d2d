//! `xtask/tidy-exceptions.txt`: exceptions from the rules, each with its reason.

use super::violation::Violation;
use crate::problem::{Problem, Result};
use std::collections::BTreeMap;

/// Path of the list from the repository's root.
pub const PATH: &str = "xtask/tidy-exceptions.txt";
const KINDS: [&str; 3] = ["long", "mesh", "limit"];

/// Lines `KIND SUBJECT: reason`.
#[derive(Debug, Default)]
pub struct Exceptions(BTreeMap<(String, String), Exception>);

#[derive(Debug)]
struct Exception {
    line: usize,
    /// Number behind the subject of `limit`.
    most: usize,
}

impl Exceptions {
    pub fn parse(text: &str) -> Result<Self> {
        let mut all = BTreeMap::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let Some((kind, subject, most)) = read(line) else {
                return Err(Problem {
                    what: format!("line {} is not an exception: {line:?}: {PATH}", number + 1),
                    expected: "`long PATH: reason`, `mesh PATH: reason` or `limit RULE NUMBER: reason`".into(),
                    hint: "the reason is required".into(),
                });
            };
            all.insert((kind.to_owned(), subject.to_owned()), Exception { line: number + 1, most });
        }
        Ok(Self(all))
    }

    pub fn has(&self, kind: &str, path: &str) -> bool {
        self.0.contains_key(&(kind.to_owned(), path.to_owned()))
    }

    /// Exceptions of a kind: subject and line.
    pub fn of_kind<'a>(&'a self, kind: &'a str) -> impl Iterator<Item = (&'a str, usize)> {
        self.0.iter().filter(move |((one, _), _)| one == kind).map(|((_, subject), one)| (subject.as_str(), one.line))
    }

    /// Violations of a rule that exceed its limit: none, or one that replaces them all.
    ///
    /// A limit lets old violations be fixed folder by folder while new ones are refused.
    pub fn limit(&self, rule: &str, found: Vec<Violation>) -> Vec<Violation> {
        let Some(limit) = self.0.get(&("limit".to_owned(), rule.to_owned())) else {
            return found;
        };
        let place = format!("{PATH}:{}", limit.line);
        if found.is_empty() {
            return vec![unneeded(place, &format!("limit {rule}"))];
        }
        if found.len() <= limit.most {
            return Vec::new();
        }
        vec![Violation {
            place,
            what: format!(
                "{} violations of the rule `{rule}`, at most {}: {}",
                found.len(),
                limit.most,
                folders(&found)
            ),
            hint: format!("`cargo xtask tidy --rule {rule} [PATH…]` lists them; fix those that you added"),
        }]
    }
}

/// An exception without a use.
pub fn unneeded(place: String, what: &str) -> Violation {
    Violation { place, what: format!("unneeded exception: {what}"), hint: "delete the line".into() }
}

/// Kind, subject and number of one line.
fn read(line: &str) -> Option<(&str, &str, usize)> {
    let (what, reason) = line.split_once(": ")?;
    let (kind, subject) = what.split_once(' ')?;
    let subject = subject.trim();
    if !KINDS.contains(&kind) || reason.trim().is_empty() {
        return None;
    }
    if kind != "limit" {
        return Some((kind, subject, 0));
    }
    let (rule, most) = subject.split_once(' ')?;
    Some((kind, rule, most.trim().parse().ok()?))
}

/// Number of violations per folder of the first two levels, most first.
fn folders(found: &[Violation]) -> String {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for one in found {
        let path = one.place.split(':').next().unwrap_or_default();
        let folder: Vec<&str> = path.split('/').take(2).collect();
        *counts.entry(folder.join("/")).or_default() += 1;
    }
    let mut counts: Vec<(String, usize)> = counts.into_iter().collect();
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    counts.iter().map(|(folder, count)| format!("{folder} {count}")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn violations(paths: &[&str]) -> Vec<Violation> {
        let one = |path: &&str| Violation { place: (*path).into(), what: String::new(), hint: String::new() };
        paths.iter().map(one).collect()
    }

    #[test]
    fn every_exception_has_a_reason() {
        for wrong in ["long a.rs:", "long a.rs", "wide a.rs: x", "limit words: x", "limit words many: x"] {
            assert!(Exceptions::parse(wrong).is_err(), "{wrong}");
        }
        let read = Exceptions::parse("# why\n\nlong a.rs: a table\nlimit words 3: being replaced\n").unwrap();
        assert!(read.has("long", "a.rs") && !read.has("mesh", "a.rs"));
        assert_eq!(read.of_kind("long").collect::<Vec<_>>(), [("a.rs", 3)]);
    }

    #[test]
    fn a_limit_admits_old_violations_only() {
        let exceptions = Exceptions::parse("limit words 2: being replaced").unwrap();
        let two = ["crates/a/src/x.rs:1", "crates/a/src/y.rs:2"];
        assert!(exceptions.limit("words", violations(&two)).is_empty());
        assert_eq!(exceptions.limit("openings", violations(&two)).len(), 2, "a rule without a limit");
        let three = exceptions.limit("words", violations(&["docs/a.md:3", two[0], two[1]]));
        assert_eq!(three[0].place, "xtask/tidy-exceptions.txt:1");
        assert!(
            three[0].what.ends_with("3 violations of the rule `words`, at most 2: crates/a 2, docs/a.md 1"),
            "{three:?}"
        );
        let none = exceptions.limit("words", Vec::new());
        assert_eq!(none[0].what, "unneeded exception: limit words");
    }
}
