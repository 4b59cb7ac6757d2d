//! `xtask/words.toml`: private words and phrases, the term of the field for each, and where it applies.

use super::lexer::{self, Kind};
use super::repository::Entry;
use super::toml::{self, Record};
use super::violation::Violation;
use crate::problem::{Problem, Result};

/// Path of the list from the repository's root.
pub const PATH: &str = "xtask/words.toml";

/// One private word or phrase.
#[derive(Debug)]
struct Word {
    /// Alternatives per position of the phrase, in lower case.
    phrase: Vec<Vec<String>>,
    avoid: String,
    instead: String,
    scopes: Vec<Scope>,
    /// Path prefixes; none: everywhere.
    under: Vec<String>,
    /// Path prefixes that are exempt.
    except: Vec<String>,
}

/// Kind of text that a word is checked in.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Scope {
    /// Comments and doc comments of Rust files; help texts are doc comments.
    Comments,
    /// Names in Rust files and names of Rust files, split at `_` and capitals.
    Identifiers,
    /// String literals of Rust files that hold a space: messages rather than keys.
    Messages,
    /// Markdown outside of code.
    Markdown,
}

const SCOPES: [(&str, Scope); 4] = [
    ("comments", Scope::Comments),
    ("identifiers", Scope::Identifiers),
    ("messages", Scope::Messages),
    ("markdown", Scope::Markdown),
];

/// The list in [`PATH`].
pub struct Words(Vec<Word>);

impl Words {
    pub fn parse(text: &str) -> Result<Self> {
        toml::records(text, "word", PATH)?.iter().map(word).collect::<Result<_>>().map(Self)
    }

    /// Every private word in the files.
    pub fn check(&self, files: &[Entry]) -> Vec<Violation> {
        files.iter().filter(|file| !is_verbatim(&file.path)).flat_map(|file| self.check_file(file)).collect()
    }

    fn check_file(&self, file: &Entry) -> Vec<Violation> {
        let here = |word: &&Word| {
            let starts = |prefix: &String| file.path.starts_with(prefix.as_str());
            (word.under.is_empty() || word.under.iter().any(starts)) && !word.except.iter().any(starts)
        };
        let words: Vec<&Word> = self.0.iter().filter(here).collect();
        let mut found = Vec::new();
        for (scope, text) in texts(file) {
            for word in words.iter().filter(|word| word.scopes.contains(&scope)) {
                let mut lines: Vec<usize> = occurrences(&word.phrase, &text).collect();
                lines.dedup();
                found.extend(lines.into_iter().map(|line| Violation {
                    place: format!("{}:{line}", file.path),
                    what: format!("private wording: {}", word.avoid),
                    hint: format!("write: {} ({PATH})", word.instead),
                }));
            }
        }
        found
    }
}

/// Files whose words are fixed: prompts, recorded data, licences.
fn is_verbatim(path: &str) -> bool {
    path.split('/').any(|part| matches!(part, "prompts" | "testdata")) || path.starts_with("LICENSE")
}

fn word(record: &Record) -> Result<Word> {
    let wrong = |what: String| Problem {
        what: format!("{PATH}:{}: {what}", record.line),
        expected:
            "avoid = \"a phrase, with al|ternatives\", instead = \"…\", in = [scopes], and perhaps under and except \
                   = [path prefixes]"
                .into(),
        hint: format!("scopes are {}", SCOPES.map(|(name, _)| name).join(", ")),
    };
    const KEYS: [&str; 5] = ["avoid", "instead", "in", "under", "except"];
    if let Some((key, _)) = record.entries.iter().find(|(key, _)| !KEYS.contains(&key.as_str())) {
        return Err(wrong(format!("the key `{key}` is not known")));
    }
    let text = |key: &str| record.string(key).map(str::to_owned).ok_or_else(|| wrong(format!("`{key}` is missing")));
    let scope = |name: &String| {
        let known = SCOPES.iter().find(|(one, _)| one == name).map(|(_, scope)| *scope);
        known.ok_or_else(|| wrong(format!("there is no scope {name:?}")))
    };
    let scopes: Vec<Scope> = record.strings("in").iter().map(scope).collect::<Result<_>>()?;
    let avoid = text("avoid")?;
    let phrase: Vec<Vec<String>> =
        avoid.split_whitespace().map(|part| part.split('|').map(str::to_lowercase).collect()).collect();
    if scopes.is_empty() || phrase.is_empty() {
        return Err(wrong("`in` or `avoid` is empty".into()));
    }
    let instead = text("instead")?;
    let [under, except] = ["under", "except"].map(|key| record.strings(key).to_vec());
    Ok(Word { phrase, avoid, instead, scopes, under, except })
}

/// A word in lower case with its line; punctuation is kept, since no phrase reaches across it.
type Token = (usize, String);

/// Texts of a file by scope. Each name is a text of its own, as are the lines of a comment or a paragraph together.
fn texts(file: &Entry) -> Vec<(Scope, Vec<Token>)> {
    let text = file.text.as_deref().unwrap_or_default();
    if file.path.ends_with(".md") {
        return vec![(
            Scope::Markdown,
            crate::markdown::prose(text).into_iter().flat_map(|(n, l)| tokens(n, &l)).collect(),
        )];
    }
    if !file.path.ends_with(".rs") {
        return Vec::new();
    }
    let mut texts =
        vec![(Scope::Identifiers, parts(1, file.path.rsplit('/').next().unwrap_or_default().trim_end_matches(".rs")))];
    let mut comments: Vec<Token> = Vec::new();
    for piece in lexer::pieces(text) {
        match piece.kind {
            Kind::Name => texts.push((Scope::Identifiers, parts(piece.line, &piece.text))),
            Kind::Mark => {}
            Kind::Literal if piece.text.trim().contains(' ') => {
                texts.push((Scope::Messages, lines(piece.line, &piece.text)));
            }
            Kind::Literal => {}
            Kind::Comment | Kind::Doc | Kind::InnerDoc => {
                // Lines below each other are one text; a gap ends it.
                if comments.last().is_some_and(|(line, _)| line + 1 < piece.line) {
                    comments.push((piece.line, ".".into()));
                }
                comments.extend(lines(piece.line, &piece.text));
            }
        }
    }
    texts.push((Scope::Comments, comments));
    texts
}

fn lines(first: usize, text: &str) -> Vec<Token> {
    text.lines().enumerate().flat_map(|(number, line)| tokens(first + number, line)).collect()
}

/// Words of a line; what stands between backticks is code and left out.
fn tokens(number: usize, line: &str) -> Vec<Token> {
    let mut tokens: Vec<Token> = Vec::new();
    let mut word = String::new();
    let mut is_code = false;
    for letter in line.chars().chain([' ']) {
        if letter.is_alphanumeric() || matches!(letter, '_' | '\'' | '’') {
            word.push(letter);
            continue;
        }
        if !word.is_empty() {
            let word = std::mem::take(&mut word);
            tokens.extend((!is_code).then(|| (number, word.trim_matches(['\'', '’', '_']).to_lowercase())));
        }
        is_code ^= letter == '`';
        tokens.extend((!letter.is_whitespace() && letter != '*').then(|| (number, letter.to_string())));
    }
    tokens
}

/// Words of a name: `TableLight` and `table_light` are `table light`.
fn parts(number: usize, name: &str) -> Vec<Token> {
    let letters: Vec<char> = name.chars().collect();
    let mut words = vec![String::new()];
    for (i, &letter) in letters.iter().enumerate() {
        let is_lower = |at: Option<&char>| at.is_some_and(|letter| letter.is_lowercase());
        let begins = letter.is_uppercase() && i > 0 && (is_lower(letters.get(i - 1)) || is_lower(letters.get(i + 1)));
        if begins || letter == '_' {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut().filter(|_| letter != '_') {
            word.extend(letter.to_lowercase());
        }
    }
    words.into_iter().filter(|word| !word.is_empty()).map(|word| (number, word)).collect()
}

/// Line of each occurrence of a phrase.
fn occurrences<'a>(phrase: &'a [Vec<String>], text: &'a [Token]) -> impl Iterator<Item = usize> + 'a {
    let matches = move |window: &&[Token]| phrase.iter().zip(*window).all(|(any, (_, word))| any.contains(word));
    text.windows(phrase.len()).filter(matches).map(|window| window[0].0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str = r#"
[[word]]
avoid = "brick|bricks"
instead = "voxel block"
in = ["comments", "identifiers"]
under = ["crates/motion"]

[[word]]
avoid = "leave|leaves it|them away"
instead = "omit"
in = ["comments", "markdown", "messages"]
except = ["docs/old.md"]
"#;

    fn places(path: &str, text: &str) -> Vec<String> {
        let words = Words::parse(LIST).unwrap();
        let found = words.check(&[Entry { path: path.into(), text: Some(text.into()) }]);
        found.into_iter().map(|one| one.place.rsplit('/').next().unwrap().to_owned()).collect()
    }

    #[test]
    fn words_are_found_in_their_scope() {
        let text =
            "// A brick, bricked.\nstruct BrickMap; fn of_brick() {}\nconst T: &str = \"a brick\";\n// `brick`\n";
        assert_eq!(places("crates/motion/src/x.rs", text), ["x.rs:2", "x.rs:2", "x.rs:1"]);
        assert!(places("crates/assets/src/x.rs", text).is_empty());
        assert_eq!(places("crates/motion/src/brick.rs", ""), ["brick.rs:1"]);
    }

    #[test]
    fn phrases_reach_across_lines_but_not_across_punctuation() {
        let text = "/// Where it is so, leave\n/// it away.\n// Leave it. Away.\nfn f() { p(\"leaves them away\"); q(\"leave\") }";
        assert_eq!(places("crates/a/src/x.rs", text), ["x.rs:4", "x.rs:1"]);
        let page = "Leave it away.\n\n```sh\nleave it away\n```\nDo not leave `it` away.\n";
        assert_eq!(places("docs/a.md", page), ["a.md:1"]);
        assert!(places("docs/old.md", page).is_empty());
        assert!(places("crates/task-writer/prompts/a.md", page).is_empty());
    }

    #[test]
    fn a_list_with_mistakes_is_refused() {
        for (wrong, said) in [
            ("[[word]]\navoid = \"a\"\nin = [\"comments\"]", "`instead` is missing"),
            ("[[word]]\navoid = \"a\"\ninstead = \"b\"\nin = [\"letters\"]", "no scope"),
            ("[[word]]\navoid = \"a\"\ninstead = \"b\"", "is empty"),
            ("[[word]]\navoid = \"a\"\ninstead = \"b\"\nin = [\"comments\"]\nwhere = \"x\"", "`where` is not known"),
        ] {
            let error = Words::parse(wrong).err().map(|error| error.what).unwrap_or_default();
            assert!(error.contains(said), "{wrong}: {error}");
        }
    }

    #[test]
    fn names_are_split() {
        let split = |name: &str| parts(1, name).into_iter().map(|(_, word)| word).collect::<Vec<_>>().join(" ");
        assert_eq!(split("TableLight"), "table light");
        assert_eq!(split("is_passed_on"), "is passed on");
        assert_eq!(split("RGBDImage"), "rgbd image");
        assert_eq!(split("MAX_LANES"), "max lanes");
    }
}
