//! What a model answers, and how strictly its shape is enforced.

use serde::{Deserialize, Serialize};

/// What a model answered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChatReply {
    /// The answer, never empty; in files a list of lines.
    #[serde(with = "crate::lines")]
    pub text: String,
    /// Name of the model that answered, as the server says; often more exact than the one asked for.
    pub model: String,
    /// Why the answer ends, in the server's words; `length` or `max_tokens` means it was cut off.
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
    /// The server enforces the schema.
    #[default]
    JsonSchema,
    /// The server enforces JSON of any shape.
    JsonObject,
    /// Nothing but the words of the prompt.
    Plain,
}

impl Structure {
    /// All, strictest first.
    pub const ALL: [Self; 3] = [Self::JsonSchema, Self::JsonObject, Self::Plain];
}
