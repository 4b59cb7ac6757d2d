//! What is said to a language model and what comes back, whatever carries it.

use genmanip_core::Seed;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use crate::ChatError;

/// Anything that answers a conversation: a server, a folder of cassettes, a script.
///
/// Calls block and may come from several threads at once.
pub trait ChatModel: Send + Sync {
    /// Asks for the next message of the conversation.
    ///
    /// # Errors
    /// Says why there is no answer; retries are over by then.
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError>;
}

impl<M: ChatModel + ?Sized> ChatModel for Box<M> {
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        (**self).chat(request)
    }
}

impl<M: ChatModel + ?Sized> ChatModel for &M {
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        (**self).chat(request)
    }
}

/// A conversation to be continued, with everything that decides the answer. It never holds a secret.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChatRequest {
    /// Name of the model, as the server knows it.
    pub model: String,
    /// The conversation so far, oldest first.
    pub messages: Vec<Message>,
    /// Shape the answer shall have; a wish, see [`ChatReply::structure`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reply_schema: Option<ReplySchema>,
    /// Further fields of the request body, e.g. `temperature`.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub parameters: Map<String, Value>,
}

impl ChatRequest {
    /// Content hash: 64 hexadecimal digits of the SHA-256 of the request as JSON with sorted keys.
    ///
    /// ```
    /// use genmanip_llm::{ChatRequest, Message};
    /// let ask = |text: &str| ChatRequest {
    ///     model: "m".into(),
    ///     messages: vec![Message::user(text)],
    ///     reply_schema: None,
    ///     parameters: Default::default(),
    /// };
    /// assert_eq!(ask("hello").key(), ask("hello").key());
    /// assert_ne!(ask("hello").key(), ask("Hello").key());
    /// ```
    pub fn key(&self) -> String {
        let mut canonical = serde_json::to_value(self).unwrap_or_default();
        canonical.sort_all_objects();
        Sha256::digest(canonical.to_string().as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// A random stream of this request's own, for the waiting times between retries.
    pub(crate) fn fork(&self, seed: Seed) -> Seed {
        seed.fork(&self.key())
    }
}

/// One message of a conversation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Message {
    /// Who speaks.
    pub role: Role,
    /// What is said; in files a list of lines, so that people can read it.
    #[serde(with = "crate::lines")]
    pub text: String,
}

impl Message {
    /// Standing instructions.
    pub fn system(text: impl Into<String>) -> Self {
        Self { role: Role::System, text: text.into() }
    }

    /// What we ask.
    pub fn user(text: impl Into<String>) -> Self {
        Self { role: Role::User, text: text.into() }
    }

    /// What the model said.
    pub fn assistant(text: impl Into<String>) -> Self {
        Self { role: Role::Assistant, text: text.into() }
    }
}

/// Who speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Standing instructions.
    System,
    /// The side that asks.
    User,
    /// The model.
    Assistant,
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

/// What a model answered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChatReply {
    /// The answer, never empty; in files a list of lines.
    #[serde(with = "crate::lines")]
    pub text: String,
    /// Name of the model that answered, as the server says; often more exact than the one asked for.
    pub model: String,
    /// Why the answer ends, in the server's words; `length` means it was cut off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finish_reason: Option<String>,
    /// Tokens, if the server counts them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub usage: Option<Usage>,
    /// How strictly the server held the answer to the schema.
    pub structure: Structure,
    /// HTTP requests that were sent for it, refused ones included; 0 when it came from a cassette or a script.
    /// Not stored, because it differs between a recording and its replay.
    #[serde(skip)]
    pub attempts: u32,
}

/// Tokens of one exchange.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Usage {
    /// Tokens of the conversation.
    pub prompt_tokens: u64,
    /// Tokens of the answer, hidden thoughts included.
    pub completion_tokens: u64,
}

/// How an answer is held to its shape, strictest first; the order in which they are tried.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Structure {
    /// The server enforces the schema (`response_format: json_schema`).
    #[default]
    JsonSchema,
    /// The server enforces JSON of any shape (`response_format: json_object`).
    JsonObject,
    /// Nothing but the words of the prompt.
    Plain,
}

impl Structure {
    /// All, strictest first.
    pub const ALL: [Self; 3] = [Self::JsonSchema, Self::JsonObject, Self::Plain];
}
