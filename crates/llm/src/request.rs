//! Requests to models, in memory and recorded.

use genmanip_core::Seed;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use crate::message::{Image, Message, Part};
use crate::recorded::RecordedMessage;
use genmanip_core::hexadecimal;

/// A conversation to continue, with everything that determines the reply. It never contains a secret.
#[derive(Clone, Debug, PartialEq)]
pub struct ChatRequest {
    /// Model name on the server.
    pub model: String,
    /// The conversation so far, oldest first.
    pub messages: Vec<Message>,
    /// Requested structure of the reply; see [`ChatReply::structure`](crate::ChatReply::structure) for its enforcement.
    /// `None` for free text.
    pub reply_schema: Option<ReplySchema>,
    /// Additional fields of the request body, e.g. `temperature`.
    pub parameters: Map<String, Value>,
}

/// A JSON Schema for the reply.
///
/// Use the subset supported by servers: objects whose properties are all required and closed with
/// `additionalProperties: false`, arrays, strings, enums; no references, no patterns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReplySchema {
    /// Name of letters, digits and underscores.
    pub name: String,
    /// JSON Schema of the reply.
    pub schema: Value,
    /// Stricter schema for servers that convert it to a grammar; may also use `anyOf`, `minItems` and `maxItems`.
    /// Servers that refuse it get `schema`. Not part of recordings and keys, so that recordings made without it stay
    /// valid.
    #[serde(skip)]
    pub grammar: Option<Value>,
}

impl ReplySchema {
    /// Creates a schema without a stricter grammar.
    pub fn new(name: impl Into<String>, schema: Value) -> Self {
        Self { name: name.into(), schema, grammar: None }
    }
}

/// A request in a file: with image hashes instead of bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedRequest {
    /// See [`ChatRequest::model`].
    pub model: String,
    /// See [`ChatRequest::messages`].
    pub messages: Vec<RecordedMessage>,
    /// See [`ChatRequest::reply_schema`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reply_schema: Option<ReplySchema>,
    /// See [`ChatRequest::parameters`].
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub parameters: Map<String, Value>,
}

impl ChatRequest {
    /// Creates a request for free text without additional parameters.
    pub fn new(model: impl Into<String>, messages: Vec<Message>) -> Self {
        Self { model: model.into(), messages, reply_schema: None, parameters: Map::new() }
    }

    /// Content hash: 64 hexadecimal digits of the SHA-256 of the recorded request as JSON with sorted keys.
    ///
    /// ```
    /// use genmanip_llm::{ChatRequest, Message};
    /// let ask = |text: &str| ChatRequest::new("m", vec![Message::user(text)]);
    /// assert_eq!(ask("hello").key(), ask("hello").key());
    /// assert_ne!(ask("hello").key(), ask("Hello").key());
    /// ```
    pub fn key(&self) -> String {
        RecordedRequest::from(self).key()
    }

    /// Random stream of this request, for retry jitter.
    pub(crate) fn fork(&self, seed: Seed) -> Seed {
        seed.fork(&self.key())
    }

    /// All images with the index of their message, in order.
    pub(crate) fn images(&self) -> impl Iterator<Item = (usize, &Image)> {
        self.messages.iter().enumerate().flat_map(|(index, message)| {
            message.parts.iter().filter_map(move |part| match part {
                Part::Image(image) => Some((index, image)),
                Part::Text(_) => None,
            })
        })
    }
}

impl RecordedRequest {
    /// See [`ChatRequest::key`].
    pub fn key(&self) -> String {
        let mut canonical = serde_json::to_value(self).unwrap_or_default();
        canonical.sort_all_objects();
        hexadecimal(&Sha256::digest(canonical.to_string().as_bytes()))
    }
}

impl From<&ChatRequest> for RecordedRequest {
    fn from(request: &ChatRequest) -> Self {
        Self {
            model: request.model.clone(),
            messages: request.messages.iter().map(RecordedMessage::from).collect(),
            reply_schema: request.reply_schema.clone(),
            parameters: request.parameters.clone(),
        }
    }
}
