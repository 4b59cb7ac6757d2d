//! Parser of one value: accepts unambiguous deviations such as comments, trailing commas, single quotes, bare keys, raw
//! line breaks in strings, and Python's literals.

use serde_json::{Map, Number, Value};

/// Maximum nesting depth; answers need five levels.
const MAX_DEPTH: usize = 64;

/// A parsed object or list.
#[derive(Clone, Debug, PartialEq)]
pub struct Parsed {
    /// The object or list, with all deviations resolved.
    pub value: Value,
    /// Byte of the opening bracket.
    pub start: usize,
    /// Byte after the closing bracket.
    pub end: usize,
    /// Tolerated deviations, each kind once with its first position.
    pub sloppy: Vec<(&'static str, usize)>,
}

/// Reason of a parse failure, with its byte position.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// The text ends within the value.
    #[error("the JSON is not closed")]
    Truncated {
        /// Position of the end.
        at: usize,
    },
    /// A syntax error.
    #[error("{message}")]
    Malformed {
        /// Position of the error.
        at: usize,
        /// Expected and found text.
        message: String,
    },
    /// A key occurs twice with different values.
    #[error("key `{key}` occurs twice with different values")]
    DuplicateKey {
        /// Position of the second occurrence.
        at: usize,
        /// The key that occurs twice.
        key: String,
    },
    /// The text has more values than were allowed.
    #[error("too many JSON values")]
    TooManyValues {
        /// Position of the first value beyond the limit.
        at: usize,
    },
}

impl Failure {
    /// Byte position of the failure.
    pub fn at(&self) -> usize {
        match self {
            Self::Truncated { at }
            | Self::Malformed { at, .. }
            | Self::DuplicateKey { at, .. }
            | Self::TooManyValues { at } => *at,
        }
    }
}

/// Parses the object or list that begins at `start`, which must be its opening bracket; every parsed value is deducted
/// from the budget.
pub(super) fn parse(text: &str, start: usize, budget: &mut usize) -> Result<Parsed, Failure> {
    let mut reader = Reader { text, bytes: text.as_bytes(), at: start, sloppy: Vec::new(), budget };
    let value = if reader.bytes.get(start) == Some(&b'[') { reader.array(0) } else { reader.object(0) }?;
    Ok(Parsed { value, start, end: reader.at, sloppy: reader.sloppy })
}

struct Reader<'a> {
    text: &'a str,
    bytes: &'a [u8],
    at: usize,
    sloppy: Vec<(&'static str, usize)>,
    budget: &'a mut usize,
}

impl<'a> Reader<'a> {
    fn value(&mut self, depth: usize) -> Result<Value, Failure> {
        match self.budget.checked_sub(1) {
            Some(left) => *self.budget = left,
            None => return Err(Failure::TooManyValues { at: self.at }),
        }
        match self.peek()? {
            b'{' => self.object(depth),
            b'[' => self.array(depth),
            b'"' | b'\'' => self.string().map(Value::String),
            b'-' | b'0'..=b'9' => self.number(),
            _ => self.literal(),
        }
    }

    fn object(&mut self, depth: usize) -> Result<Value, Failure> {
        self.check_depth(depth)?;
        self.at += 1;
        let mut map = Map::new();
        loop {
            self.skip_space()?;
            if self.peek()? == b'}' {
                self.at += 1;
                return Ok(Value::Object(map));
            }
            let key_at = self.at;
            let key = match self.peek()? {
                b'"' | b'\'' => self.string()?,
                byte if byte.is_ascii_alphabetic() || byte == b'_' => {
                    self.forgive("bare key");
                    self.word().to_owned()
                }
                _ => return Err(self.unexpected("a key in quotes or `}`")),
            };
            self.skip_space()?;
            if self.peek()? != b':' {
                return Err(self.unexpected("`:` after the key"));
            }
            self.at += 1;
            self.skip_space()?;
            let value = self.value(depth + 1)?;
            if map.get(&key).is_some_and(|earlier| *earlier != value) {
                return Err(Failure::DuplicateKey { at: key_at, key });
            }
            map.insert(key, value);
            if self.item_ends(b'}', "`,` or `}`")? {
                return Ok(Value::Object(map));
            }
        }
    }

    fn array(&mut self, depth: usize) -> Result<Value, Failure> {
        self.check_depth(depth)?;
        self.at += 1;
        let mut items = Vec::new();
        loop {
            self.skip_space()?;
            if self.peek()? == b']' {
                self.at += 1;
                return Ok(Value::Array(items));
            }
            items.push(self.value(depth + 1)?);
            if self.item_ends(b']', "`,` or `]`")? {
                return Ok(Value::Array(items));
            }
        }
    }

    /// Consumes the comma after an item, or the closing bracket; returns true at the end of the list.
    fn item_ends(&mut self, close: u8, expected: &str) -> Result<bool, Failure> {
        self.skip_space()?;
        match self.peek()? {
            b',' => {
                let comma = self.at;
                self.at += 1;
                self.skip_space()?;
                if self.peek()? == close {
                    self.forgive_at("trailing comma", comma);
                }
                Ok(false)
            }
            byte if byte == close => {
                self.at += 1;
                Ok(true)
            }
            _ => Err(self.unexpected(expected)),
        }
    }

    fn string(&mut self) -> Result<String, Failure> {
        let quote = self.peek()?;
        if quote == b'\'' {
            self.forgive("single quotes");
        }
        self.at += 1;
        let mut out = String::new();
        loop {
            let rest = &self.bytes[self.at..];
            let plain = rest
                .iter()
                .position(|&byte| byte == quote || byte == b'\\' || byte < 0x20)
                .ok_or(Failure::Truncated { at: self.bytes.len() })?;
            out.push_str(&self.text[self.at..self.at + plain]);
            self.at += plain;
            match self.bytes[self.at] {
                byte if byte == quote => {
                    self.at += 1;
                    return Ok(out);
                }
                b'\\' => self.escape(&mut out)?,
                byte => {
                    self.forgive("raw control character in a string");
                    out.push(char::from(byte));
                    self.at += 1;
                }
            }
        }
    }

    fn escape(&mut self, out: &mut String) -> Result<(), Failure> {
        let code = *self.bytes.get(self.at + 1).ok_or(Failure::Truncated { at: self.bytes.len() })?;
        let plain = match code {
            b'"' => '"',
            b'\\' => '\\',
            b'/' => '/',
            b'b' => '\u{8}',
            b'f' => '\u{c}',
            b'n' => '\n',
            b'r' => '\r',
            b't' => '\t',
            b'\'' => {
                self.forgive("escaped single quote");
                '\''
            }
            b'u' => return self.unicode_escape(out),
            _ => return Err(self.unexpected("an escape sequence of JSON")),
        };
        out.push(plain);
        self.at += 2;
        Ok(())
    }

    fn unicode_escape(&mut self, out: &mut String) -> Result<(), Failure> {
        let unit = |reader: &Self, at: usize| -> Result<u16, Failure> {
            if at + 6 > reader.bytes.len() {
                return Err(Failure::Truncated { at: reader.bytes.len() });
            }
            let digits = reader.text.get(at + 2..at + 6).filter(|_| reader.bytes[at..].starts_with(b"\\u"));
            digits
                .filter(|digits| digits.bytes().all(|byte| byte.is_ascii_hexdigit()))
                .and_then(|digits| u16::from_str_radix(digits, 16).ok())
                .ok_or_else(|| Failure::Malformed { at, message: "expected `\\u` and four hexadecimal digits".into() })
        };
        let first = unit(self, self.at)?;
        let mut units = vec![first];
        if (0xd800..0xdc00).contains(&first) {
            units.push(unit(self, self.at + 6)?);
        }
        let text = String::from_utf16(&units)
            .map_err(|_| Failure::Malformed { at: self.at, message: "half of a surrogate pair".into() })?;
        out.push_str(&text);
        self.at += 6 * units.len();
        Ok(())
    }

    fn number(&mut self) -> Result<Value, Failure> {
        let length = self.bytes[self.at..]
            .iter()
            .take_while(|byte| matches!(byte, b'0'..=b'9' | b'+' | b'-' | b'.' | b'e' | b'E'))
            .count();
        if self.at + length == self.bytes.len() {
            return Err(Failure::Truncated { at: self.bytes.len() });
        }
        let text = &self.text[self.at..self.at + length];
        let number = serde_json::from_str::<Number>(text).map_err(|_| self.unexpected("a number"))?;
        self.at += length;
        Ok(Value::Number(number))
    }

    fn literal(&mut self) -> Result<Value, Failure> {
        let start = self.at;
        let value = match self.word() {
            "null" => Value::Null,
            "true" => Value::Bool(true),
            "false" => Value::Bool(false),
            "None" => Value::Null,
            "True" => Value::Bool(true),
            "False" => Value::Bool(false),
            _ if self.at == self.bytes.len() => return Err(Failure::Truncated { at: self.at }),
            _ => {
                self.at = start;
                return Err(self.unexpected("a value"));
            }
        };
        if self.bytes[start].is_ascii_uppercase() {
            self.forgive_at("Python literal", start);
        }
        Ok(value)
    }

    fn word(&mut self) -> &'a str {
        let start = self.at;
        while self.bytes.get(self.at).is_some_and(|byte| byte.is_ascii_alphanumeric() || *byte == b'_') {
            self.at += 1;
        }
        &self.text[start..self.at]
    }

    /// Skips white space and comments.
    fn skip_space(&mut self) -> Result<(), Failure> {
        loop {
            let rest = &self.bytes[self.at..];
            let end = Failure::Truncated { at: self.bytes.len() };
            match rest {
                [] => return Err(end),
                [b' ' | b'\t' | b'\r' | b'\n', ..] => self.at += 1,
                [0xc2, 0xa0, ..] => self.at += 2,
                [b'#', ..] | [b'/', b'/', ..] => {
                    self.forgive("comment");
                    self.at += rest.iter().position(|&byte| byte == b'\n').ok_or(end)?;
                }
                [b'/', b'*', ..] => {
                    self.forgive("comment");
                    self.at += rest.windows(2).skip(2).position(|pair| pair == b"*/").ok_or(end)? + 4;
                }
                _ => return Ok(()),
            }
        }
    }

    fn peek(&self) -> Result<u8, Failure> {
        self.bytes.get(self.at).copied().ok_or(Failure::Truncated { at: self.at })
    }

    fn check_depth(&self, depth: usize) -> Result<(), Failure> {
        if depth < MAX_DEPTH {
            return Ok(());
        }
        Err(Failure::Malformed { at: self.at, message: format!("nested deeper than {MAX_DEPTH} levels") })
    }

    fn forgive(&mut self, what: &'static str) {
        self.forgive_at(what, self.at);
    }

    fn forgive_at(&mut self, what: &'static str, at: usize) {
        if !self.sloppy.iter().any(|(known, _)| *known == what) {
            self.sloppy.push((what, at));
        }
    }

    fn unexpected(&self, expected: &str) -> Failure {
        let got = self.text.get(self.at..).and_then(|rest| rest.chars().next());
        let got = got.map_or("the end".into(), |character| format!("`{}`", character.escape_debug()));
        Failure::Malformed { at: self.at, message: format!("expected {expected}, got {got}") }
    }
}
