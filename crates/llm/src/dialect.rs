//! Dialects: how a request is written for a server and how its answer is read. No IO.
//!
//! Each dialect is a unit struct in a file of its own that implements [`Wire`].
//! Another one is that file, `dialect/NAME.rs`, its line `mod NAME;` below, and its line in `dialects!`;
//! client, cassettes, ledger and settings take it from there.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{ChatError, shortened};
use crate::reply::{ChatReply, Structure};
use crate::request::ChatRequest;
use crate::secret::ApiKey;

mod anthropic;
mod openai;

dialects! {
    /// OpenAI's chat completions, which most servers and gateways speak.
    OpenAi = openai::OpenAi,
    /// Anthropic's messages.
    Anthropic = anthropic::Anthropic,
}

/// What a dialect is asked for.
pub(crate) trait Wire: Sync {
    /// What follows the server's address, e.g. `/chat/completions`.
    fn path(&self) -> &'static str;

    /// Headers beside those of every JSON request; the key stands in one of them.
    fn headers(&self, key: Option<&ApiKey>) -> Vec<(&'static str, String)>;

    /// The forms of structured output it knows, strictest first; the last is [`Structure::Plain`].
    fn structures(&self) -> &'static [Structure];

    /// Fields of the body that are written from the request and may not be parameters.
    fn reserved(&self) -> &'static [&'static str];

    /// The body of the request.
    fn request_body(&self, request: &ChatRequest, structure: Structure) -> Value;

    /// Reads the body of a successful answer; `attempts` stays 0.
    fn reply(&self, body: &Value, structure: Structure, url: &str) -> Result<ChatReply, ChatError>;
}

/// One entry per dialect: documentation, variant, and the value that implements [`Wire`].
macro_rules! dialects {
    ($($(#[doc = $doc:literal])* $variant:ident = $wire:expr,)+) => {
        /// How requests are written and answers read; named in the settings as `server.dialect`.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(rename_all = "lowercase")]
        pub enum Dialect {
            $($(#[doc = $doc])* $variant,)+
        }

        impl Dialect {
            /// All dialects.
            pub const ALL: &[Self] = &[$(Self::$variant),+];

            pub(crate) fn wire(self) -> &'static dyn Wire {
                match self {
                    $(Self::$variant => &$wire,)+
                }
            }
        }
    };
}
use dialects;

/// What a server says about its failure, in the shapes in use: `{"error": {"message"}}`, `{"error": "…"}`,
/// `{"message"}`, `{"detail"}`. Gateways mix them, whatever their dialect.
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

/// Whether a refusal is likely about the structured output that was asked for, so that asking without is worth a try.
///
/// Servers use different statuses and words; a request that is wrong for another reason costs two needless requests.
pub(crate) fn refuses_structure(error: &ChatError) -> bool {
    match error {
        ChatError::Status { status: 400 | 415 | 422 | 501, .. } => true,
        ChatError::Status { status: 200 | 404 | 500, message, .. } => {
            let message = message.to_lowercase();
            ["response_format", "json_schema", "json_object", "schema", "grammar", "structured"]
                .iter()
                .any(|word| message.contains(word))
        }
        _ => false,
    }
}

/// The answer without the thoughts that some models write before it as `<think>…</think>`.
fn without_thoughts(text: &str) -> &str {
    let begins = text.trim_start();
    match begins.strip_prefix("<think>").and_then(|rest| rest.split_once("</think>")) {
        Some((_, answer)) => answer.trim_start(),
        None => text,
    }
}

/// The name of the model that answered, under the name that all dialects so far have for it.
fn model_name(body: &Value) -> String {
    body.get("model").and_then(Value::as_str).map_or_else(|| "unknown".into(), |name| shortened(name, 200))
}
