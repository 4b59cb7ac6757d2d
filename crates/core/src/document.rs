//! Versioned JSON files: `{"schema": "genmanip.task/1", …}`.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use crate::document_error::DocumentError;

/// A type that is exchanged as a versioned JSON file.
///
/// ```
/// use genmanip_core::{Document, DocumentError, Task};
/// let error = Task::from_json(r#"{"schema": "genmanip.task/9"}"#).unwrap_err();
/// assert!(matches!(error, DocumentError::WrongSchema { .. }));
/// ```
pub trait Document: Serialize + DeserializeOwned {
    /// Name and version, e.g. `genmanip.task/1`.
    const SCHEMA: &'static str;

    /// The version before this one, which readers still accept; `None` for a first version.
    const PREVIOUS: Option<Upgrade> = None;

    /// Reads the text of a file.
    ///
    /// # Errors
    /// Says what was expected and where: position of a syntax error, schema, or JSON path of a wrong value.
    fn from_json(text: &str) -> Result<Self, DocumentError> {
        Self::from_value(crate::json::parse(text)?)
    }

    /// Reads the bytes of a file, see [`Document::from_json`].
    ///
    /// # Errors
    /// As [`Document::from_json`], also for what is no UTF-8.
    fn from_bytes(bytes: &[u8]) -> Result<Self, DocumentError> {
        Self::from_json(crate::json::text(bytes)?)
    }

    /// What else must hold than that every value has its type; readers call it, whoever makes a value need not.
    ///
    /// # Errors
    /// [`DocumentError::Invalid`] with the first thing that is wrong.
    fn check(&self) -> Result<(), DocumentError> {
        Ok(())
    }

    /// Reads a parsed value, see [`Document::from_json`].
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
        let document: Self =
            serde_path_to_error::deserialize(Value::Object(map)).map_err(|error| DocumentError::Invalid {
                path: match error.path().to_string() {
                    root if root == "." => "$".into(),
                    path => format!("$.{path}"),
                },
                message: error.inner().to_string(),
            })?;
        document.check()?;
        Ok(document)
    }

    /// The text of the file, indented, the schema first, with a final newline.
    fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(&self.to_value()).unwrap_or_default();
        text.push('\n');
        text
    }

    /// The value of the file, the schema first.
    fn to_value(&self) -> Value {
        let mut document = Map::new();
        document.insert("schema".into(), Self::SCHEMA.into());
        if let Ok(Value::Object(body)) = serde_json::to_value(self) {
            document.extend(body);
        }
        Value::Object(document)
    }
}

/// How the version before becomes the present one.
///
/// What the older version did not say is filled in with what was fixed when it was current, never with today's default.
#[derive(Clone, Copy, Debug)]
pub struct Upgrade {
    /// Name and version that is read, e.g. `genmanip.task/1`.
    pub schema: &'static str,
    /// Changes the body, without its schema, into a body of the present version.
    pub upgrade: fn(&mut Map<String, Value>) -> Result<(), DocumentError>,
}
