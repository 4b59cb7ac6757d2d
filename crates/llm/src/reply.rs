//! Replies of models and the enforcement of their structure.

use serde::{Deserialize, Serialize};

/// Reply of a model to a request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChatReply {
    /// Reply text, never empty; a list of lines in files.
    #[serde(with = "crate::lines")]
    pub text: String,
    /// Model name reported by the server; often more specific than the requested one.
    pub model: String,
    /// Finish reason reported by the server; `length` or `max_tokens` means truncated. `None` if it reports none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finish_reason: Option<String>,
    /// Token usage, if the server reports it; `None` otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub usage: Option<Usage>,
    /// Mode in which the server enforced the schema.
    pub structure: Structure,
    /// HTTP requests sent, rejected ones included; 0 for a cassette or a script. Not stored, because it differs between
    /// a recording and its replay.
    #[serde(skip)]
    pub attempts: u32,
}

impl ChatReply {
    /// True if the model was stopped at its token limit: its answer may lack the end, and asking again would not help.
    pub fn is_cut_off(&self) -> bool {
        self.finish_reason.as_deref().is_some_and(is_token_limit)
    }
}

/// True for the finish reasons by which servers report that the token limit was reached.
pub(crate) fn is_token_limit(finish_reason: &str) -> bool {
    ["length", "max_tokens", "model_length", "max_output_tokens"].contains(&finish_reason.to_lowercase().as_str())
}

/// Token usage of one exchange.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Usage {
    /// Number of tokens of the conversation.
    pub prompt_tokens: u64,
    /// Number of tokens of the reply, including hidden reasoning.
    pub completion_tokens: u64,
}

/// Structured-output modes, strictest first, in the order tried.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Structure {
    /// The server enforces the tighter schema of the request, if it has one; otherwise as `json_schema`.
    #[default]
    Grammar,
    /// The server enforces the schema.
    JsonSchema,
    /// The server enforces JSON of any shape.
    JsonObject,
    /// Only the prompt describes the format.
    Plain,
}

impl Structure {
    /// All modes, strictest first.
    pub const ALL: [Self; 4] = [Self::Grammar, Self::JsonSchema, Self::JsonObject, Self::Plain];
}
