//! Strict JSON: as the standard has it, and every key of an object once.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};

use crate::DocumentError;

/// The value that a text stands for.
///
/// # Errors
/// [`DocumentError::NotJson`] with line, column and what to do, also for a key that stands twice in one object: which of
/// the two counts is left open by the standard, so programs would read different documents.
///
/// ```
/// assert!(genmanip_core::json::parse(r#"{"seed": 1}"#).is_ok());
/// let error = genmanip_core::json::parse(r#"{"seed": 1, "seed": 2}"#).unwrap_err();
/// assert!(error.to_string().contains("key `seed` stands twice"));
/// ```
pub fn parse(text: &str) -> Result<Value, DocumentError> {
    let mut reader = serde_json::Deserializer::from_str(text);
    let value = Unique.deserialize(&mut reader).and_then(|value| reader.end().map(|()| value));
    value.map_err(|error| DocumentError::NotJson {
        line: error.line(),
        column: error.column(),
        message: error.to_string(),
        hint: hint(text, &error),
    })
}

/// The text of a file that should be JSON.
///
/// # Errors
/// [`DocumentError::NotJson`] when it is no UTF-8, with the place of the first byte that is not.
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

/// What most likely is wrong with a text that is not JSON.
fn hint(text: &str, error: &serde_json::Error) -> &'static str {
    if text.trim().is_empty() {
        "the file is empty"
    } else if text.starts_with('\u{feff}') {
        "the file begins with a byte order mark; save it as UTF-8 without one"
    } else if text.contains('\0') {
        "the file holds zero bytes; is it binary, or UTF-16? save it as UTF-8"
    } else if error.is_eof() {
        "the file ends too early; was it cut off while it was copied or written?"
    } else if error.to_string().contains("stands twice") {
        "keep one of the two"
    } else {
        "JSON has no NaN, no infinity, no comments and no trailing commas"
    }
}

/// Reads any value and refuses a key that stands twice.
struct Unique;

impl<'de> DeserializeSeed<'de> for Unique {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Unique {
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
        while let Some(item) = items.next_element_seed(Unique)? {
            array.push(item);
        }
        Ok(Value::Array(array))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut map = Map::new();
        while let Some(key) = entries.next_key::<String>()? {
            if map.contains_key(&key) {
                return Err(A::Error::custom(format_args!("key `{key}` stands twice")));
            }
            map.insert(key, entries.next_value_seed(Unique)?);
        }
        Ok(Value::Object(map))
    }
}

#[cfg(test)]
mod tests {
    use super::{parse, text};
    use crate::DocumentError;

    #[test]
    fn what_is_json_reads_as_everywhere() {
        for text in ["null", "[1, -2, 2.5, 1e300, true, \"ä\\n\", {}]", r#"{"a": {"a": [18446744073709551615]}}"#] {
            assert_eq!(parse(text).unwrap(), serde_json::from_str::<serde_json::Value>(text).unwrap());
        }
    }

    #[test]
    fn what_is_not_json_is_told_with_its_place_and_a_fitting_hint() {
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
