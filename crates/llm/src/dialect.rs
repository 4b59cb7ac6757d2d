//! API dialects: encoding of requests and decoding of replies, without IO.
//!
//! Each dialect is a unit struct in its own file that implements [`Wire`]. To add one, create `dialect/NAME.rs`, and
//! add `mod NAME;` and an entry in `dialects!` below; client, cassettes, ledger and settings need no change.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{ChatError, is_about_length, shortened};
use crate::reply::{ChatReply, Structure, Usage};
use crate::request::ChatRequest;
use crate::secret::ApiKey;

mod anthropic;
mod openai;

dialects! {
    /// OpenAI chat completions, supported by most servers and gateways.
    OpenAi = openai::OpenAi,
    /// Anthropic messages API.
    Anthropic = anthropic::Anthropic,
}

/// Encoding and decoding of a dialect.
pub(crate) trait Wire: Sync {
    /// Path after the base URL, e.g. `/chat/completions`.
    fn path(&self) -> &'static str;

    /// Additional headers, including authentication.
    fn headers(&self, key: Option<&ApiKey>) -> Vec<(&'static str, String)>;

    /// Supported structured-output modes, strictest first; the last is [`Structure::Plain`].
    fn structures(&self) -> &'static [Structure];

    /// Body fields that are set from the request and must not be parameters.
    fn reserved(&self) -> &'static [&'static str];

    /// Request body as JSON.
    fn request_body(&self, request: &ChatRequest, structure: Structure) -> Value;

    /// Decodes the body of a successful response; leaves `attempts` at 0.
    fn reply(&self, body: &Value, structure: Structure, url: &str) -> Result<ChatReply, ChatError>;
}

/// Defines `Dialect`: one entry per dialect with documentation, variant and implementation of [`Wire`].
macro_rules! dialects {
    ($($(#[doc = $doc:literal])* $variant:ident = $wire:expr,)+) => {
        /// API dialect; `server.dialect` in the settings.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(rename_all = "lowercase")]
        pub enum Dialect {
            $($(#[doc = $doc])* $variant,)+
        }

        impl Dialect {
            /// All dialects.
            pub const ALL: &[Self] = &[$(Self::$variant),+];

            /// Decodes the body of a successful response from `url`; leaves `attempts` at 0.
            ///
            /// # Errors
            /// If the body reports an error, is no reply, or its text is empty.
            pub fn reply(self, body: &Value, structure: Structure, url: &str) -> Result<ChatReply, ChatError> {
                self.wire().reply(body, structure, url)
            }

            pub(crate) fn wire(self) -> &'static dyn Wire {
                match self {
                    $(Self::$variant => &$wire,)+
                }
            }
        }
    };
}
use dialects;

/// Extracts a server's error message in the common forms: `{"error": {"message"}}`, `{"error": "…"}`, `{"message"}`,
/// `{"detail"}`. Gateways mix them regardless of dialect. `None` if there is none.
pub(crate) fn error_message(body: &Value) -> Option<String> {
    let error = body.get("error").filter(|error| !error.is_null());
    let nested = error.and_then(|error| error.get("message"));
    let is_answer = body.get("choices").is_some() || body.get("content").is_some();
    let outer = || if is_answer { None } else { body.get("message").or_else(|| body.get("detail")) };
    let found = nested.or(error).or_else(outer)?;
    Some(match found {
        Value::String(text) => shortened(text, 300),
        other => shortened(&other.to_string(), 300),
    })
}

/// True if an error is probably about the requested structured output, so that a retry without it is worthwhile.
///
/// Servers use different statuses and texts; a false positive costs at most two unnecessary requests. A message about
/// the length of the conversation does not count, unless it also names the structure.
pub(crate) fn refuses_structure(error: &ChatError) -> bool {
    let names_structure = |message: &str| {
        let message = message.to_lowercase();
        ["response_format", "json_schema", "json_object", "schema", "grammar", "structured"]
            .iter()
            .any(|word| message.contains(word))
    };
    match error {
        ChatError::Status { status: 400 | 415 | 422 | 501, message, .. } => {
            names_structure(message) || !is_about_length(message)
        }
        ChatError::Status { status: 200 | 404 | 500, message, .. } => names_structure(message),
        _ => false,
    }
}

/// Closing tags of the reasoning of models; the opening tag is often part of the prompt, hence missing in the reply.
const ENDS_OF_THOUGHTS: [&str; 6] =
    ["</think>", "</thinking>", "</reasoning>", "[/THINK]", "◁/think▷", "<|channel|>final<|message|>"];

/// Text without the reasoning: everything up to the last closing tag is removed if text follows it.
fn without_reasoning(text: &str) -> &str {
    let end = |tag: &str| text.rfind(tag).map(|at| at + tag.len());
    let answers = ENDS_OF_THOUGHTS.iter().filter_map(|tag| end(tag)).max().map(|at| text[at..].trim_start());
    let begins = text.trim_start();
    let is_whole = begins.starts_with(['{', '[', '"']) && !begins.starts_with("[THINK]");
    answers.filter(|answer| !answer.is_empty() && !is_whole).unwrap_or(text)
}

/// Fails if a body with status 200 reports an error, as some gateways do.
fn check_error(body: &Value, url: &str) -> Result<(), ChatError> {
    match error_message(body) {
        Some(message) => Err(ChatError::Status { status: 200, message, url: url.into() }),
        None => Ok(()),
    }
}

/// String field of an object, truncated to one line of 100 characters. `None` if it is missing or no text.
fn short_text(object: &Value, field: &str) -> Option<String> {
    object.get(field).and_then(Value::as_str).map(|text| shortened(text, 100))
}

/// Builds the reply of a completion without its reasoning block; fails if no text is left.
fn chat_reply(
    body: &Value,
    text: &str,
    finish_reason: Option<String>,
    usage: Option<Usage>,
    structure: Structure,
) -> Result<ChatReply, ChatError> {
    let text = without_reasoning(text);
    if text.trim().is_empty() {
        return Err(ChatError::NoText { finish_reason: finish_reason.unwrap_or_else(|| "none".into()) });
    }
    Ok(ChatReply { text: text.to_owned(), model: model_name(body), finish_reason, usage, structure, attempts: 0 })
}

/// Model name, in the field common to all dialects.
fn model_name(body: &Value) -> String {
    body.get("model").and_then(Value::as_str).map_or_else(|| "unknown".into(), |name| shortened(name, 200))
}
