//! Upgrades of documents from the preceding schema version.
//!
//! Missing fields are filled with the values that were fixed at the time, never with current defaults; all constants
//! here are therefore frozen.

mod feasibility;
pub mod generation;
pub mod result;
pub mod run;
pub mod scenario;
pub mod task;
mod world;

use serde_json::{Map, Value};

use crate::DocumentError;

/// Error for a missing or mistyped value at a path.
fn lacks(path: &str, expected: &str) -> DocumentError {
    DocumentError::Invalid { path: path.into(), message: format!("expected {expected}") }
}

/// The JSON object under a key; an error if there is none.
fn object<'m>(
    map: &'m mut Map<String, Value>,
    key: &str,
    path: &str,
) -> Result<&'m mut Map<String, Value>, DocumentError> {
    map.get_mut(key).and_then(Value::as_object_mut).ok_or_else(|| lacks(&format!("{path}.{key}"), "an object"))
}

/// The JSON objects of the list under a key; an error if there is no such list.
fn objects<'m>(
    map: &'m mut Map<String, Value>,
    key: &str,
    path: &str,
) -> Result<Vec<&'m mut Map<String, Value>>, DocumentError> {
    let place = format!("{path}.{key}");
    let items = map.get_mut(key).and_then(Value::as_array_mut).ok_or_else(|| lacks(&place, "a list"))?;
    items
        .iter_mut()
        .enumerate()
        .map(|(index, item)| item.as_object_mut().ok_or_else(|| lacks(&format!("{place}[{index}]"), "an object")))
        .collect()
}

/// The text under a key; an error if there is none.
fn text(map: &Map<String, Value>, key: &str, path: &str) -> Result<String, DocumentError> {
    map.get(key).and_then(Value::as_str).map(String::from).ok_or_else(|| lacks(&format!("{path}.{key}"), "a text"))
}
