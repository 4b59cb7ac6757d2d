//! What a model is asked, as it is in memory and as it is recorded.

use genmanip_core::Seed;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use crate::message::{Image, Message, Part, hexadecimal};
use crate::recorded::RecordedMessage;

/// A conversation to be continued, with everything that decides the answer. It never holds a secret.
#[derive(Clone, Debug, PartialEq)]
pub struct ChatRequest {
    /// Name of the model, as the server knows it.
    pub model: String,
    /// The conversation so far, oldest first.
    pub messages: Vec<Message>,
    /// Shape the answer shall have; a wish, see [`ChatReply::structure`](crate::ChatReply::structure).
    pub reply_schema: Option<ReplySchema>,
    /// Further fields of the request body, e.g. `temperature`.
    pub parameters: Map<String, Value>,
}

/// A JSON Schema that the answer shall obey.
///
/// Keep to the subset that servers understand: objects whose properties are all required and closed with
/// `additionalProperties: false`, arrays, strings, enums; no references, no patterns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReplySchema {
    /// Letters, digits and underscores.
    pub name: String,
    /// The schema.
    pub schema: Value,
}

/// A request as it stands in a file: with the hashes of its images instead of their bytes.
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
    /// A request for a free answer without further parameters.
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

    /// A random stream of this request's own, for the waiting times between retries.
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
