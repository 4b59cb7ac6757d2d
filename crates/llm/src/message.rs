//! Messages of a conversation with text and image parts.

use std::fmt;
use std::sync::Arc;

use genmanip_core::hexadecimal;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::error::ImageError;

/// One message of a conversation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Role of the sender.
    pub role: Role,
    /// Texts and images, in order.
    pub parts: Vec<Part>,
}

/// A part of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    /// A text part.
    Text(String),
    /// An image; only allowed in user messages, since servers reject others.
    Image(Image),
}

impl Message {
    /// Message with system instructions.
    pub fn system(text: impl Into<String>) -> Self {
        Self { role: Role::System, parts: vec![Part::Text(text.into())] }
    }

    /// Message of the user with a text.
    pub fn user(text: impl Into<String>) -> Self {
        Self { role: Role::User, parts: vec![Part::Text(text.into())] }
    }

    /// A user message of texts and images.
    ///
    /// ```
    /// use genmanip_llm::{Image, Message, Part};
    /// # let png = [&b"\x89PNG\r\n\x1a\n"[..], b"..."].concat();
    /// let image = Image::new(png).unwrap();
    /// let message = Message::user_parts([Part::Text("What is this?".into()), Part::Image(image)]);
    /// assert_eq!(message.text(), "What is this?");
    /// ```
    pub fn user_parts(parts: impl IntoIterator<Item = Part>) -> Self {
        Self { role: Role::User, parts: parts.into_iter().collect() }
    }

    /// Message of the model with a text.
    pub fn assistant(text: impl Into<String>) -> Self {
        Self { role: Role::Assistant, parts: vec![Part::Text(text.into())] }
    }

    /// Texts of the message joined by line breaks, without images.
    pub fn text(&self) -> String {
        let text = |part: &Part| match part {
            Part::Text(text) => Some(text.clone()),
            Part::Image(_) => None,
        };
        self.parts.iter().filter_map(text).collect::<Vec<_>>().join("\n")
    }
}

/// Role of a message's sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Instructions for the model that precede the conversation.
    System,
    /// The user, who asks.
    User,
    /// The model, which replies.
    Assistant,
}

/// A PNG or JPEG file in memory. Copies share the bytes.
#[derive(Clone, PartialEq, Eq)]
pub struct Image {
    media_type: MediaType,
    bytes: Arc<[u8]>,
}

/// Supported image formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MediaType {
    /// PNG (Portable Network Graphics).
    #[serde(rename = "image/png")]
    Png,
    /// JPEG.
    #[serde(rename = "image/jpeg")]
    Jpeg,
}

impl Image {
    /// Wraps the bytes of a file; the format is detected by signature. The maximum size is a server setting.
    ///
    /// # Errors
    /// Fails if the signature matches neither format.
    pub fn new(bytes: impl Into<Arc<[u8]>>) -> Result<Self, ImageError> {
        let bytes = bytes.into();
        let format = MediaType::ALL.into_iter().find(|format| bytes.starts_with(format.signature()));
        let media_type = format.ok_or_else(|| ImageError {
            size_bytes: bytes.len() as u64,
            beginning: hexadecimal(&bytes[..bytes.len().min(8)]),
        })?;
        Ok(Self { media_type, bytes })
    }

    /// Format detected by signature.
    pub fn media_type(&self) -> MediaType {
        self.media_type
    }

    /// Bytes of the image file.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// SHA-256 of the file, 64 hexadecimal digits.
    pub fn sha256(&self) -> String {
        hexadecimal(&Sha256::digest(&self.bytes))
    }
}

/// Debug output without the bytes.
impl fmt::Debug for Image {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Image({}, {} bytes)", self.media_type.name(), self.bytes.len())
    }
}

impl MediaType {
    /// All supported formats.
    pub const ALL: [Self; 2] = [Self::Png, Self::Jpeg];

    /// MIME type, e.g. `image/png`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Jpeg => "image/jpeg",
        }
    }

    /// Leading bytes of a file of this format (PNG specification 5.2; JPEG: start of image, then the next marker).
    fn signature(self) -> &'static [u8] {
        match self {
            Self::Png => b"\x89PNG\r\n\x1a\n",
            Self::Jpeg => b"\xff\xd8\xff",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_told_by_their_signature() {
        for (bytes, expected) in [
            (&b"\x89PNG\r\n\x1a\nrest"[..], Some(MediaType::Png)),
            (b"\xff\xd8\xff\xe0rest", Some(MediaType::Jpeg)),
            (b"\x89PNG\n\x1a\nrest", None), // line ends were converted
            (b"GIF89a", None),
            (b"data:image/png;base64,iVBORw0KGgo=", None),
            (b"", None),
        ] {
            let image = Image::new(bytes);
            assert_eq!(image.as_ref().ok().map(Image::media_type), expected, "{bytes:?}");
            if let Err(error) = image {
                assert!(error.to_string().contains(&format!("got {} bytes", bytes.len())), "{error}");
            }
        }
        for format in MediaType::ALL {
            assert_eq!(serde_json::to_value(format).unwrap(), format.name());
        }
    }
}
