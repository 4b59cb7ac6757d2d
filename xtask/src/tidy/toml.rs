//! The subset of TOML that lists of records need: `[[name]]`, and keys with a string or an array of strings.

use crate::problem::{Problem, Result};

/// Keys and values of one `[[name]]`; a string is an array of one.
#[derive(Debug, Default, PartialEq)]
pub struct Record {
    /// Line of its heading, from 1.
    pub line: usize,
    pub entries: Vec<(String, Vec<String>)>,
}

impl Record {
    pub fn strings(&self, key: &str) -> &[String] {
        self.entries.iter().find(|(one, _)| one == key).map_or(&[], |(_, value)| value)
    }

    pub fn string(&self, key: &str) -> Option<&str> {
        match self.strings(key) {
            [one] => Some(one),
            _ => None,
        }
    }
}

/// Records of the array `name`; everything else is refused with its line.
pub fn records(text: &str, name: &str, path: &str) -> Result<Vec<Record>> {
    let mut records: Vec<Record> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let wrong = |what: &str| Problem {
            what: format!("{path}:{}: {what}: {line:?}", number + 1),
            expected: format!("`[[{name}]]`, `key = \"string\"` or `key = [\"string\", …]`, one per line"),
            hint: "only this subset of TOML is read".into(),
        };
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        if line == format!("[[{name}]]") {
            records.push(Record { line: number + 1, entries: Vec::new() });
            continue;
        }
        let (key, value) = line.split_once('=').ok_or_else(|| wrong("neither a heading nor a key"))?;
        let value = value_of(value.trim()).ok_or_else(|| wrong("the value is not understood"))?;
        let record = records.last_mut().ok_or_else(|| wrong("a key before the first heading"))?;
        if record.entries.iter().any(|(one, _)| one == key.trim()) {
            return Err(wrong("the key occurs twice"));
        }
        record.entries.push((key.trim().to_owned(), value));
    }
    Ok(records)
}

/// A string or an array of strings, perhaps followed by a comment.
fn value_of(text: &str) -> Option<Vec<String>> {
    let Some(mut rest) = text.strip_prefix('[') else {
        let (value, rest) = string(text)?;
        return is_end(rest).then_some(vec![value]);
    };
    let mut values = Vec::new();
    loop {
        rest = rest.trim_start();
        if let Some(behind) = rest.strip_prefix(']') {
            return is_end(behind).then_some(values);
        }
        let (value, behind) = string(rest)?;
        values.push(value);
        rest = behind.trim_start();
        match rest.strip_prefix(',') {
            Some(behind) => rest = behind,
            None if rest.starts_with(']') => {}
            None => return None,
        }
    }
}

/// A basic string and what follows it.
fn string(text: &str) -> Option<(String, &str)> {
    let rest = text.strip_prefix('"')?;
    let mut value = String::new();
    let mut letters = rest.char_indices();
    while let Some((at, letter)) = letters.next() {
        match letter {
            '"' => return Some((value, &rest[at + 1..])),
            '\\' => value.push(letters.next().map(|(_, letter)| letter).filter(|letter| "\"\\".contains(*letter))?),
            _ => value.push(letter),
        }
    }
    None
}

fn is_end(rest: &str) -> bool {
    let rest = rest.trim();
    rest.is_empty() || rest.starts_with('#')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_read() {
        let text = "# why\n[[word]]\nsay = \"a \\\"b\\\"\" # note\nin = [\"x\", \"y\",]\n\n[[word]]\nin = []\n";
        let found = records(text, "word", "words.toml").unwrap();
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].line, found[1].line), (2, 6));
        assert_eq!(found[0].string("say"), Some("a \"b\""));
        assert_eq!(found[0].strings("in"), ["x", "y"]);
        assert!(found[1].strings("in").is_empty() && found[1].string("say").is_none());
    }

    #[test]
    fn anything_else_is_refused_with_its_line() {
        for (text, line) in [
            ("say = \"a\"", ":1:"),
            ("[[word]]\nsay", ":2:"),
            ("[[word]]\nsay = 1", ":2:"),
            ("[[word]]\nsay = [\"a\" \"b\"]", ":2:"),
            ("[[word]]\nsay = \"a", ":2:"),
            ("[[word]]\nsay = \"a\" b", ":2:"),
            ("[[word]]\nsay = \"a\"\nsay = \"b\"", ":3:"),
        ] {
            let error = records(text, "word", "words.toml").unwrap_err();
            assert!(error.what.contains(line), "{text}: {error}");
        }
    }
}
