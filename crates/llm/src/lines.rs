//! Serde helpers that store multi-line texts in JSON as readable lists of lines.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

#[derive(Deserialize)]
#[serde(untagged, expecting = "a text, or a list of lines")]
enum Text {
    One(String),
    Lines(Vec<String>),
}

/// Serialises a single line as a string, several as a list.
pub(crate) fn serialize<S: Serializer>(text: &str, serializer: S) -> Result<S::Ok, S::Error> {
    if text.contains('\n') {
        text.split('\n').collect::<Vec<_>>().serialize(serializer)
    } else {
        text.serialize(serializer)
    }
}

/// Deserialises a text from either form.
pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    Ok(match Text::deserialize(deserializer)? {
        Text::One(text) => text,
        Text::Lines(lines) => lines.join("\n"),
    })
}
