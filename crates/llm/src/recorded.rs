//! File representation of messages: texts as lists of lines, images as hashes.

use serde::{Deserialize, Serialize};

use crate::message::{Image, MediaType, Message, Part, Role};

/// A message in a file, with `text` if it is a single text, otherwise with `parts`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedMessage {
    /// Role of the sender.
    pub role: Role,
    /// Text as a list of lines; `None` if `parts` is used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<RecordedText>,
    /// Parts of a message that is not a single text; otherwise empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<RecordedPart>,
}

/// A text in a file: a string for one line, a list for several.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct RecordedText(#[serde(with = "crate::lines")] pub String);

/// A part of a message in a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RecordedPart {
    /// A text part.
    Text(RecordedText),
    /// An image part, as its hash.
    Image(RecordedImage),
}

/// Identity of an image in a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedImage {
    /// Image format.
    pub media_type: MediaType,
    /// Size of the image file (bytes).
    pub size_bytes: u64,
    /// SHA-256 of the image file, 64 hexadecimal digits.
    pub sha256: String,
}

impl From<&Message> for RecordedMessage {
    fn from(message: &Message) -> Self {
        let (text, parts) = match &message.parts[..] {
            [Part::Text(text)] => (Some(RecordedText(text.clone())), Vec::new()),
            parts => (None, parts.iter().map(RecordedPart::from).collect()),
        };
        Self { role: message.role, text, parts }
    }
}

impl From<&Part> for RecordedPart {
    fn from(part: &Part) -> Self {
        match part {
            Part::Text(text) => Self::Text(RecordedText(text.clone())),
            Part::Image(image) => Self::Image(RecordedImage::from(image)),
        }
    }
}

impl From<&Image> for RecordedImage {
    fn from(image: &Image) -> Self {
        Self { media_type: image.media_type(), size_bytes: image.bytes().len() as u64, sha256: image.sha256() }
    }
}

impl std::fmt::Display for RecordedImage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, {} bytes, sha256 {}", self.media_type.name(), self.size_bytes, self.sha256)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn any_text_survives(texts in proptest::collection::vec("(.|\n|\r){0,40}", 1..3)) {
            let message = Message::user_parts(texts.into_iter().map(Part::Text));
            let recorded = RecordedMessage::from(&message);
            let json = serde_json::to_string(&recorded).unwrap();
            prop_assert_eq!(serde_json::from_str::<RecordedMessage>(&json).unwrap(), recorded);
        }
    }
}
