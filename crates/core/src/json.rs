//! Strict JSON: standard syntax, no duplicate keys, bounded memory.

use std::cell::Cell;
use std::fmt;
use std::io;

use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};

use crate::DocumentError;

/// Parses a JSON text.
///
/// # Errors
/// [`DocumentError::NotJson`] with line, column and a hint for a syntax error; for a duplicate key (the standard
/// leaves open which one counts, so programs would read different documents); and for a text whose values exceed the
/// memory budget.
///
/// ```
/// assert!(genmanip_core::json::parse(r#"{"seed": 1}"#).is_ok());
/// let error = genmanip_core::json::parse(r#"{"seed": 1, "seed": 2}"#).unwrap_err();
/// assert!(error.to_string().contains("key `seed` occurs twice"));
/// ```
pub fn parse(text: &str) -> Result<Value, DocumentError> {
    let budget = MemoryBudget::new();
    read(serde_json::Deserializer::from_str(text), text, UniqueKeys { budget: &budget })
}

/// Parses a document of `schema` without the list at `key`: every entry of the list is passed to `take` as soon as it
/// is parsed.
///
/// If the schema differs or follows the list, the list stays in the returned value and `take` is not called.
///
/// # Errors
/// As [`parse`], with one memory budget per entry; and errors of `take`, which receives the entry's index and value.
pub(crate) fn parse_listing(
    text: &str,
    schema: &str,
    key: &str,
    take: &mut dyn FnMut(usize, Value) -> Result<(), DocumentError>,
) -> Result<Value, DocumentError> {
    list(serde_json::Deserializer::from_str(text), text, schema, key, take)
}

/// Length of the file prefix that is inspected to tell which format a non-JSON file has, bytes.
const HEAD: u64 = 4 << 10;

/// As [`parse_listing`], reading the text incrementally.
///
/// # Errors
/// As [`parse_listing`]; read errors become [`DocumentError::NotJson`].
pub(crate) fn read_listing(
    mut reader: impl io::Read,
    schema: &str,
    key: &str,
    take: &mut dyn FnMut(usize, Value) -> Result<(), DocumentError>,
) -> Result<Value, DocumentError> {
    let mut head = Vec::new();
    io::Read::read_to_end(&mut io::Read::take(&mut reader, HEAD), &mut head).map_err(|error| {
        DocumentError::NotJson { line: 1, column: 1, message: error.to_string(), hint: "check the disk for errors" }
    })?;
    let whole = io::Read::chain(head.as_slice(), reader);
    list(serde_json::Deserializer::from_reader(whole), &String::from_utf8_lossy(&head), schema, key, take)
}

/// Parses an object with a list; `text` is a prefix of the input.
fn list<'de, R: serde_json::de::Read<'de>>(
    reader: serde_json::Deserializer<R>,
    text: &str,
    schema: &str,
    key: &str,
    take: &mut dyn FnMut(usize, Value) -> Result<(), DocumentError>,
) -> Result<Value, DocumentError> {
    let budget = MemoryBudget::new();
    if !text.trim_start().starts_with('{') {
        return read(reader, text, UniqueKeys { budget: &budget });
    }
    let mut refused = None;
    let value = read(reader, text, Listing { schema, key, take, refused: &mut refused });
    match (refused, value) {
        (Some(error), _) => Err(error),
        // Of the object's values only the list has to be of a certain type, so this error concerns the list.
        (None, Err(DocumentError::NotJson { message, .. })) if message.starts_with("invalid type") => {
            Err(DocumentError::Invalid { path: format!("$.{key}"), message })
        }
        (None, value) => value,
    }
}

/// Parses the whole input; `text` is a prefix of it.
fn read<'de, R: serde_json::de::Read<'de>, S: DeserializeSeed<'de, Value = Value>>(
    mut reader: serde_json::Deserializer<R>,
    text: &str,
    seed: S,
) -> Result<Value, DocumentError> {
    let value = seed.deserialize(&mut reader).and_then(|value| reader.end().map(|()| value));
    value.map_err(|error| DocumentError::NotJson {
        line: error.line(),
        column: error.column(),
        message: error.to_string(),
        hint: hint(text, &error),
    })
}

/// Decodes the bytes of a JSON file as UTF-8.
///
/// # Errors
/// [`DocumentError::NotJson`] with the position of the first invalid byte.
pub fn text(bytes: &[u8]) -> Result<&str, DocumentError> {
    std::str::from_utf8(bytes).map_err(|error| {
        let before = &bytes[..error.valid_up_to()];
        let line = before.iter().filter(|byte| **byte == b'\n').count() + 1;
        let column = before.iter().rev().take_while(|byte| **byte != b'\n').count() + 1;
        let is_utf16 = bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]);
        DocumentError::NotJson {
            line,
            column,
            message: format!("not UTF-8 at line {line} column {column}"),
            hint: if is_utf16 { "the file is UTF-16; save it as UTF-8" } else { "save the file as UTF-8" },
        }
    })
}

/// Bytes of a text in UTF-8 without the byte order mark that other programs put before it; our own files have none.
pub fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// Likely cause of a syntax error.
fn hint(text: &str, error: &serde_json::Error) -> &'static str {
    if text.trim().is_empty() {
        "the file is empty"
    } else if text.starts_with('\u{feff}') {
        "the file begins with a byte order mark; save it as UTF-8 without one"
    } else if text.contains('\0') {
        "the file holds zero bytes; is it binary, or UTF-16? save it as UTF-8"
    } else if error.is_eof() {
        "the file ends too early; was it cut off while it was copied or written?"
    } else if error.to_string().contains("occurs twice") {
        "keep one of the two"
    } else if error.to_string().contains(TOO_MANY) {
        "expected a document with fewer values; is it the right file?"
    } else {
        "JSON has no NaN, no infinity, no comments and no trailing commas"
    }
}

/// Memory budget for the values of one text, bytes. Together with the text and the growth of lists, reading stays
/// below 1 GB.
const MAX_BYTES: usize = 256 << 20;
const TOO_MANY: &str = "so many values that they need more than 256 MiB of memory";
/// Memory of a list item, bytes; also of an object entry (hash, key and value) without the bytes of its key.
const ITEM: usize = size_of::<Value>();
const ENTRY: usize = size_of::<(usize, String, Value)>() + size_of::<usize>();
/// Capacity that a collection reserves for its first entry.
const FIRST: usize = 4;

/// Memory left for values, bytes.
struct MemoryBudget(Cell<usize>);

impl MemoryBudget {
    fn new() -> Self {
        Self(Cell::new(MAX_BYTES))
    }

    fn take<E: Error>(&self, bytes: usize) -> Result<(), E> {
        self.0.set(self.0.get().checked_sub(bytes).ok_or_else(|| E::custom(TOO_MANY))?);
        Ok(())
    }
}

/// Seed that parses any value and rejects duplicate keys.
#[derive(Clone, Copy)]
struct UniqueKeys<'a> {
    budget: &'a MemoryBudget,
}

impl<'de> DeserializeSeed<'de> for UniqueKeys<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for UniqueKeys<'_> {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        Number::from_f64(value).map(Value::Number).ok_or_else(|| E::custom("number out of range"))
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_string<E>(self, value: String) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut array = Vec::new();
        while let Some(item) = items.next_element_seed(self)? {
            self.budget.take(if array.is_empty() { FIRST * ITEM } else { ITEM })?;
            array.push(item);
        }
        Ok(Value::Array(array))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut map = Map::new();
        while let Some(key) = next_key(&map, &mut entries)? {
            self.budget.take(key.len() + if map.is_empty() { FIRST * ENTRY } else { ENTRY })?;
            map.insert(key, entries.next_value_seed(self)?);
        }
        Ok(Value::Object(map))
    }
}

/// The next key; an error if it is a duplicate.
fn next_key<'de, A: MapAccess<'de>>(map: &Map<String, Value>, entries: &mut A) -> Result<Option<String>, A::Error> {
    match entries.next_key::<String>()? {
        Some(key) if map.contains_key(&key) => Err(A::Error::custom(format_args!("key `{key}` occurs twice"))),
        key => Ok(key),
    }
}

/// Parses an object of a schema and streams its list entry by entry.
struct Listing<'a> {
    schema: &'a str,
    key: &'a str,
    take: &'a mut dyn FnMut(usize, Value) -> Result<(), DocumentError>,
    /// Set to the error that `take` returned, which serde cannot carry.
    refused: &'a mut Option<DocumentError>,
}

impl<'de> DeserializeSeed<'de> for Listing<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Listing<'_> {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut entries: A) -> Result<Value, A::Error> {
        let budget = MemoryBudget::new();
        let mut map = Map::new();
        while let Some(key) = next_key(&map, &mut entries)? {
            let is_listed = key == self.key && map.get("schema").is_some_and(|schema| schema == self.schema);
            budget.take(key.len() + ENTRY)?;
            let value = if is_listed {
                entries.next_value_seed(Entries(&mut self))?
            } else {
                entries.next_value_seed(UniqueKeys { budget: &budget })?
            };
            map.insert(key, value);
        }
        Ok(Value::Object(map))
    }
}

/// Streams the entries of the list; its own value is an empty list.
struct Entries<'a, 'b>(&'a mut Listing<'b>);

impl<'de> DeserializeSeed<'de> for Entries<'_, '_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Entries<'_, '_> {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        for index in 0.. {
            let budget = MemoryBudget::new();
            let Some(entry) = items.next_element_seed(UniqueKeys { budget: &budget })? else { break };
            if let Err(error) = (self.0.take)(index, entry) {
                *self.0.refused = Some(error);
                return Err(A::Error::custom("an entry is not as expected"));
            }
        }
        Ok(Value::Array(Vec::new()))
    }
}

#[cfg(test)]
mod tests {
    use super::{parse, text};
    use crate::DocumentError;

    #[test]
    fn valid_json_parses_as_with_serde() {
        for text in ["null", "[1, -2, 2.5, 1e300, true, \"ä\\n\", {}]", r#"{"a": {"a": [18446744073709551615]}}"#] {
            assert_eq!(parse(text).unwrap(), serde_json::from_str::<serde_json::Value>(text).unwrap());
        }
    }

    #[test]
    fn many_small_values_are_refused_before_they_fill_the_memory() {
        // Worst case per byte of text: small values that each take about a hundred bytes.
        for unit in ["[0],", "{\"a\":0},", "0,"] {
            let text = format!("[{}0]", unit.repeat((16 << 20) / unit.len()));
            let Err(DocumentError::NotJson { message, hint, .. }) = parse(&text) else { panic!("{unit} was read") };
            assert!(message.contains("256 MiB") && hint.contains("fewer values"), "{unit}: {message}");
        }
        assert!(parse(&format!("[{}0]", "0,".repeat(1 << 20))).is_ok());
        assert!(parse(&format!("[\"{}\"]", "x".repeat(16 << 20))).is_ok());
    }

    #[test]
    fn syntax_errors_carry_their_position_and_a_hint() {
        let cases = [
            ("", 1, "empty"),
            (" \n ", 2, "empty"),
            ("\u{feff}{}", 1, "byte order mark"),
            ("{\0\"\0", 1, "UTF-16"),
            ("{\"a\": [1,\n 2", 2, "ends too early"),
            ("{\"a\": NaN}", 1, "no NaN"),
            ("{\"a\": 1,}", 1, "trailing commas"),
            ("{\"a\": 1,\n \"a\": 1}", 2, "keep one"),
            ("{} {}", 1, "no comments"),
        ];
        for (text, expected_line, expected_hint) in cases {
            let Err(DocumentError::NotJson { line, hint, .. }) = parse(text) else { panic!("{text:?} was read") };
            assert_eq!(line, expected_line, "{text:?}");
            assert!(hint.contains(expected_hint), "{text:?}: {hint}");
        }
        assert!(parse(&"[".repeat(100_000)).is_err(), "bounded depth");
        for (bytes, expected_line, expected_hint) in
            [(&b"\xff\xfe{\0"[..], 1, "UTF-16"), (b"{\n \"caf\xe9\": 1}", 2, "save the file as UTF-8")]
        {
            let Err(DocumentError::NotJson { line, hint, .. }) = text(bytes) else { panic!("{bytes:?} was read") };
            assert!(line == expected_line && hint.contains(expected_hint), "{bytes:?}: {hint}");
        }
    }
}
