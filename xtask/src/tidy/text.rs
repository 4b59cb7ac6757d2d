//! Words that must not be in committed text: they would tie the project to one machine or one network.

use super::repository::Entry;
use super::violation::Violation;

/// Cut in two, so that this file obeys its own rule.
const FORBIDDEN: [(&str, &str, &str); 8] = [
    ("crates", ".io", "say \"the default registry\": which host serves it is the user's setting"),
    ("pypi", ".org", "say \"the Python package index\""),
    ("pythonhosted", ".org", "say \"the Python package index\""),
    ("registry.npmjs", ".org", "say \"the npm registry\""),
    ("deb.debian", ".org", "say \"Debian's packages\""),
    ("../", "shared", "nothing may depend on a folder outside of the repository: copy what is needed"),
    ("/wo", "rk/", "no absolute path of one machine: make the path an argument, or relative to the repository"),
    ("/ro", "ot/", "no absolute path of one machine: make the path an argument, or relative to the repository"),
];

pub fn check(files: &[Entry]) -> Vec<Violation> {
    let mut found = Vec::new();
    // Cargo writes its lock file itself, and names the registry in it.
    for file in files.iter().filter(|file| file.path != "Cargo.lock") {
        for (number, line) in file.text.as_deref().unwrap_or_default().lines().enumerate() {
            for (head, tail, hint) in FORBIDDEN {
                let word = format!("{head}{tail}");
                if contains(line, &word) {
                    found.push(Violation {
                        place: format!("{}:{}", file.path, number + 1),
                        what: format!("forbidden text {word:?}"),
                        hint: hint.into(),
                    });
                }
            }
        }
    }
    found
}

/// A path counts only where it begins: `/wo` `rk/` is one, the end of `net/wo` `rk/` is not.
fn contains(line: &str, word: &str) -> bool {
    line.match_indices(word).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        !word.starts_with('/') || before.is_none_or(|letter| !letter.is_alphanumeric() && !"_-.}".contains(letter))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forbidden_words_are_found_with_their_line() {
        let path = ["cd /wo", "rk/main"].concat();
        let relative = ["open(\"../", "shared/x\")"].concat();
        let file = |text: String| Entry { path: "a.md".into(), text: Some(text) };
        let found = check(&[file(format!("fine\n{path}\n{relative}\n"))]);
        assert_eq!(found.iter().map(|v| v.place.as_str()).collect::<Vec<_>>(), ["a.md:2", "a.md:3"]);
        assert!(check(&[file(["net/wo", "rk/x frame/wo", "rk/"].concat())]).is_empty());
        assert!(check(&[Entry { path: "Cargo.lock".into(), text: Some(path) }]).is_empty());
    }
}
