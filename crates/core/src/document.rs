//! Versioned JSON files: `{"schema": "genmanip.task/1", …}`.

use std::io;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use crate::document_error::DocumentError;
use crate::limits::ENTRIES;

/// A type that is stored as a versioned JSON file.
///
/// ```
/// use genmanip_core::{Document, DocumentError, Task};
/// let error = Task::from_json(r#"{"schema": "genmanip.task/9"}"#).unwrap_err();
/// assert!(matches!(error, DocumentError::WrongSchema { .. }));
/// ```
pub trait Document: Serialize + DeserializeOwned {
    /// Schema name and version, e.g. `genmanip.task/1`.
    const SCHEMA: &'static str;

    /// Upgrade from the preceding schema version, which is still accepted; `None` for a first version.
    const PREVIOUS: Option<Upgrade> = None;

    /// Parses the text of a file.
    ///
    /// # Errors
    /// States what was expected and where: position of a syntax error, schema, or JSON path of an invalid value.
    fn from_json(text: &str) -> Result<Self, DocumentError> {
        Self::from_value(crate::json::parse(text)?)
    }

    /// Parses the bytes of a file, see [`Document::from_json`].
    ///
    /// # Errors
    /// As [`Document::from_json`], and for bytes that are not UTF-8.
    fn from_bytes(bytes: &[u8]) -> Result<Self, DocumentError> {
        Self::from_json(crate::json::text(bytes)?)
    }

    /// Validates constraints beyond the field types; called on reading, not on construction.
    ///
    /// # Errors
    /// [`DocumentError::Invalid`] with the first violation.
    fn check(&self) -> Result<(), DocumentError> {
        Ok(())
    }

    /// Converts a parsed JSON value, see [`Document::from_json`].
    ///
    /// # Errors
    /// As [`Document::from_json`].
    fn from_value(value: Value) -> Result<Self, DocumentError> {
        let Value::Object(mut map) = value else {
            return Err(DocumentError::Invalid { path: "$".into(), message: "expected an object".into() });
        };
        match map.shift_remove("schema") {
            Some(Value::String(schema)) if schema == Self::SCHEMA => {}
            Some(Value::String(schema)) if Self::PREVIOUS.is_some_and(|previous| previous.schema == schema) => {
                if let Some(previous) = Self::PREVIOUS {
                    (previous.upgrade)(&mut map)?;
                }
            }
            other => {
                return Err(DocumentError::WrongSchema {
                    expected: Self::SCHEMA.into(),
                    got: other.map_or("none".into(), |schema| schema.to_string().chars().take(80).collect()),
                });
            }
        }
        let document: Self = typed(Value::Object(map), "$")?;
        document.check()?;
        Ok(document)
    }

    /// Serialises to indented JSON, schema first, with a final newline.
    fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(&self.to_value()).unwrap_or_default();
        text.push('\n');
        text
    }

    /// Serialises to a JSON value, schema first.
    fn to_value(&self) -> Value {
        let mut document = Map::new();
        document.insert("schema".into(), Self::SCHEMA.into());
        if let Ok(Value::Object(body)) = serde_json::to_value(self) {
            document.extend(body);
        }
        Value::Object(document)
    }
}

/// Upgrade of a document from the preceding schema version.
///
/// Missing fields are filled with the values that were fixed at the time, never with current defaults.
#[derive(Clone, Copy, Debug)]
pub struct Upgrade {
    /// Schema that is upgraded, e.g. `genmanip.task/1`.
    pub schema: &'static str,
    /// Rewrites a body (without its schema) to the current version.
    pub upgrade: fn(&mut Map<String, Value>) -> Result<(), DocumentError>,
}

/// A document with one list that may be long enough to be read entry by entry.
///
/// Implement [`Document::from_json`] with [`long_from_json`] and [`Document::to_json`] with [`long_to_json`].
pub trait LongDocument: Document {
    /// Key of the list, which follows the schema.
    const LIST: &'static str;
    /// Maximum number of entries of the list.
    const MAX_ENTRIES: usize = ENTRIES;
    /// Type of an entry of the list.
    type Entry: DeserializeOwned;

    /// The list of this document, for reading into it.
    fn entries(&mut self) -> &mut Vec<Self::Entry>;
}

/// Reads a document without holding it in memory twice; `keep` is called on every entry before it is stored, so that
/// data shared between entries can be deduplicated.
///
/// # Errors
/// As [`Document::from_json`].
pub fn long_from_json<T: LongDocument>(text: &str, mut keep: impl FnMut(&mut T::Entry)) -> Result<T, DocumentError> {
    let mut entries: Vec<T::Entry> = Vec::new();
    let rest = crate::json::parse_listing(text, T::SCHEMA, T::LIST, &mut |index, value| {
        let mut entry = entry::<T>(index, value)?;
        keep(&mut entry);
        entries.push(entry);
        Ok(())
    })?;
    let mut document = T::from_value(rest)?;
    if !entries.is_empty() {
        *document.entries() = entries;
        document.check()?;
    }
    Ok(document)
}

/// Streams a document: every entry is passed to `take` as soon as it is parsed, and the returned document's list stays
/// empty. Documents of an older version are held in memory as a whole.
///
/// # Errors
/// As [`Document::from_json`], and errors of `take`.
pub fn long_from_reader<T: LongDocument>(
    reader: impl io::Read,
    mut take: impl FnMut(T::Entry) -> Result<(), DocumentError>,
) -> Result<T, DocumentError> {
    let mut each = |index, value| take(entry::<T>(index, value)?);
    let rest = crate::json::read_listing(reader, T::SCHEMA, T::LIST, &mut each)?;
    let mut document = T::from_value(rest)?;
    std::mem::take(document.entries()).into_iter().try_for_each(take)?;
    Ok(document)
}

/// Parses entry `index` of the list; fails if `index` is at least the maximum number of entries or the value is
/// invalid.
fn entry<T: LongDocument>(index: usize, value: Value) -> Result<T::Entry, DocumentError> {
    if index == T::MAX_ENTRIES {
        let (path, message) =
            (format!("$.{}", T::LIST), format!("expected at most {} entries, got more", T::MAX_ENTRIES));
        return Err(DocumentError::Invalid { path, message });
    }
    typed(value, &format!("$.{}[{index}]", T::LIST))
}

/// As [`Document::to_json`], without an intermediate JSON value.
pub fn long_to_json<T: LongDocument>(document: &T) -> String {
    let mut bytes = Vec::new();
    // Writing to memory cannot fail.
    let _ = write_tagged(&mut bytes, T::SCHEMA, document);
    String::from_utf8(bytes).unwrap_or_default()
}

/// Streams the JSON of [`Document::to_json`] for a schema and a body.
///
/// # Errors
/// Errors of the writer and of the serialisation.
pub fn write_tagged(mut out: impl io::Write, schema: &'static str, body: &impl Serialize) -> io::Result<()> {
    #[derive(Serialize)]
    struct Tagged<'a, T> {
        schema: &'static str,
        #[serde(flatten)]
        body: &'a T,
    }
    serde_json::to_writer_pretty(&mut out, &Tagged { schema, body })?;
    out.write_all(b"\n")
}

/// Deserialises a value; errors carry its JSON path.
fn typed<T: DeserializeOwned>(value: Value, place: &str) -> Result<T, DocumentError> {
    serde_path_to_error::deserialize(value).map_err(|error| DocumentError::Invalid {
        path: match error.path().to_string() {
            root if root == "." => place.into(),
            path if path.starts_with('[') => format!("{place}{path}"),
            path => format!("{place}.{path}"),
        },
        message: error.inner().to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Serialize, serde::Deserialize)]
    struct Diary {
        title: String,
        days: Vec<(u32, String)>,
        pages: Option<u32>,
    }

    impl Document for Diary {
        const SCHEMA: &'static str = "diary/2";
        const PREVIOUS: Option<Upgrade> = Some(Upgrade {
            schema: "diary/1",
            upgrade: |map| {
                map.insert("pages".into(), Value::Null);
                Ok(())
            },
        });

        fn from_json(text: &str) -> Result<Self, DocumentError> {
            long_from_json(text, |_| {})
        }

        fn to_json(&self) -> String {
            long_to_json(self)
        }
    }

    impl LongDocument for Diary {
        const LIST: &'static str = "days";
        type Entry = (u32, String);

        fn entries(&mut self) -> &mut Vec<(u32, String)> {
            &mut self.days
        }
    }

    #[test]
    fn a_long_document_round_trips_like_any_other() {
        let diary = Diary { title: "a".into(), days: vec![(1, "b".into()), (2, "c\"".into())], pages: Some(3) };
        let whole = serde_json::to_string_pretty(&diary.to_value()).unwrap() + "\n";
        assert_eq!(diary.to_json(), whole);
        assert_eq!(Diary::from_json(&whole).unwrap(), diary);
        for (text, days, pages) in [
            // Cases: list before the schema; an older version; an empty list.
            (r#"{"days": [[1, "b"]], "schema": "diary/2", "title": "a", "pages": 1}"#, 1, Some(1)),
            (r#"{"schema": "diary/1", "title": "a", "days": [[1, "b"], [2, "c"]]}"#, 2, None),
            (r#"{"schema": "diary/2", "title": "a", "days": [], "pages": null}"#, 0, None),
        ] {
            let diary = Diary::from_json(text).unwrap();
            assert_eq!((diary.days.len(), diary.pages), (days, pages), "{text}");
        }
    }

    #[test]
    fn lists_are_bounded() {
        let text = |count| {
            format!(r#"{{"schema": "diary/2", "title": "", "days": [{}[1, ""]]}}"#, "[1, \"\"],".repeat(count - 1))
        };
        assert_eq!(Diary::from_json(&text(ENTRIES)).unwrap().days.len(), ENTRIES);
        let error = Diary::from_json(&text(ENTRIES + 1)).unwrap_err().to_string();
        assert_eq!(error, "at $.days: expected at most 100000 entries, got more");
    }

    #[test]
    fn errors_in_a_long_document_carry_their_path() {
        for (text, expected) in [
            (r#"{"schema": "diary/2", "title": "a", "days": [[1, "b"], [2, 3]]}"#, "at $.days[1][1]: invalid type"),
            (r#"{"schema": "diary/2", "title": "a", "days": [[1, "b"], 7]}"#, "at $.days[1]: invalid type"),
            (r#"{"schema": "diary/2", "title": "a", "days": {"b": 1}}"#, "at $.days: invalid type: map"),
            (r#"{"schema": "diary/2", "title": 1, "days": [[1, "b"]]}"#, "at $.title: invalid type"),
            (r#"{"schema": "diary/2", "days": [[1, "b"]]}"#, "at $: missing field `title`"),
            (r#"{"schema": "diary/3", "title": "a", "days": [7]}"#, "expected schema \"diary/2\", got \"diary/3\""),
            (r#"{"schema": "diary/2", "days": [[1, "b"]], "days": []}"#, "key `days` occurs twice"),
            (r#"{"schema": "diary/2", "days": [{"a": 1, "a": 2}]}"#, "key `a` occurs twice"),
            (r#"{"schema": "diary/2", "days": [[1, "b"]"#, "EOF"),
            ("[1]", "at $: expected an object"),
        ] {
            let error = Diary::from_json(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
