//! Anthropic messages API: Anthropic's service and compatible gateways.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Map, Value, json};

use super::{Wire, chat_reply, check_error, short_text, without_reasoning};
use crate::error::{ChatError, shortened};
use crate::message::{Message, Part, Role};
use crate::reply::{ChatReply, Structure, Usage};
use crate::request::ChatRequest;
use crate::secret::ApiKey;

/// API version of the formats below, sent in a required header.
const INTERFACE_VERSION: &str = "2023-06-01";
/// Default `max_tokens`, which the service requires; enough for a long reply with reasoning, and within the limit of
/// every model of the service.
const MAX_TOKENS: u64 = 4096;

/// Dialect with the endpoint `POST {base_url}/messages`.
pub(crate) struct Anthropic;

impl Wire for Anthropic {
    fn path(&self) -> &'static str {
        "/messages"
    }

    fn headers(&self, key: Option<&ApiKey>) -> Vec<(&'static str, String)> {
        let key = key.map(|key| ("x-api-key", key.header_value("")));
        [("anthropic-version", INTERFACE_VERSION.into())].into_iter().chain(key).collect()
    }

    /// Prompt only: tools are not used to enforce structured output.
    fn structures(&self) -> &'static [Structure] {
        &[Structure::Plain]
    }

    fn reserved(&self) -> &'static [&'static str] {
        &["model", "system", "messages", "stream", "tools", "tool_choice"]
    }

    /// The schema is part of the system prompt, since the API has no field for it.
    fn request_body(&self, request: &ChatRequest, _: Structure) -> Value {
        let (system_messages, dialogue): (Vec<&Message>, Vec<&Message>) =
            request.messages.iter().partition(|message| message.role == Role::System);
        let mut system: Vec<String> = system_messages.into_iter().map(Message::text).collect();
        if let Some(schema) = &request.reply_schema {
            system.push(format!("Answer with JSON alone that obeys this JSON Schema:\n{}", schema.schema));
        }
        let message = |message: &&Message| json!({"role": message.role, "content": content(message)});
        let messages: Vec<Value> = dialogue.iter().map(message).collect();
        let mut body = Map::new();
        body.insert("model".into(), request.model.clone().into());
        body.insert("max_tokens".into(), MAX_TOKENS.into());
        if !system.is_empty() {
            body.insert("system".into(), system.join("\n\n").into());
        }
        body.insert("messages".into(), messages.into());
        body.extend(request.parameters.clone());
        body.into()
    }

    /// Joins text blocks; ignores reasoning blocks.
    fn reply(&self, body: &Value, structure: Structure, url: &str) -> Result<ChatReply, ChatError> {
        check_error(body, url)?;
        let blocks = body.get("content").and_then(Value::as_array).ok_or_else(|| ChatError::NotACompletion {
            url: url.into(),
            path: "$.content".into(),
            expected: "a list".into(),
        })?;
        let is_text = |block: &&Value| block.get("type").and_then(Value::as_str) == Some("text");
        let dialogue: String =
            blocks.iter().filter(is_text).filter_map(|block| block.get("text").and_then(Value::as_str)).collect();
        let finish_reason = short_text(body, "stop_reason");
        if finish_reason.as_deref() == Some("refusal") {
            let text = without_reasoning(&dialogue);
            let message = if text.trim().is_empty() { "(no reason given)".into() } else { shortened(text, 300) };
            return Err(ChatError::Declined { message });
        }
        chat_reply(body, &dialogue, finish_reason, body.get("usage").and_then(usage), structure)
    }
}

/// A single text as a string, anything else as a list of typed blocks.
fn content(message: &Message) -> Value {
    match &message.parts[..] {
        [Part::Text(text)] => text.clone().into(),
        parts => parts.iter().map(block).collect(),
    }
}

fn block(part: &Part) -> Value {
    match part {
        Part::Text(text) => json!({"type": "text", "text": text}),
        Part::Image(image) => {
            let (media_type, data) = (image.media_type().name(), STANDARD.encode(image.bytes()));
            json!({"type": "image", "source": {"type": "base64", "media_type": media_type, "data": data}})
        }
    }
}

/// Tokens read from the service's prompt cache are reported separately from `input_tokens` but belong to the
/// conversation. `None` if the reply reports no usage.
fn usage(value: &Value) -> Option<Usage> {
    let count = |name: &str| value.get(name).and_then(Value::as_u64);
    let cached = ["cache_creation_input_tokens", "cache_read_input_tokens"].map(|name| count(name).unwrap_or(0));
    let prompt_tokens = cached.into_iter().fold(count("input_tokens")?, u64::saturating_add);
    Some(Usage { prompt_tokens, completion_tokens: count("output_tokens")? })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shapes as the service documents them.
    #[test]
    fn answers_in_the_shapes_that_the_service_sends() {
        let check = |body: &str| {
            let body = serde_json::from_str(body).unwrap();
            Anthropic.reply(&body, Structure::Plain, "http://x").map_err(|error| error.to_string())
        };
        let text = |body: &str| check(body).map(|reply| reply.text);
        for (body, expected) in [
            (r#"{"content":[{"type":"text","text":"hi"}],"stop_reason":"end_turn"}"#, "hi"),
            (r#"{"content":[{"type":"text","text":"h"},{"type":"text","text":"i"}]}"#, "hi"),
            (r#"{"content":[{"type":"thinking","thinking":"no","signature":"s"},{"type":"text","text":"hi"}]}"#, "hi"),
        ] {
            assert_eq!(text(body).as_deref(), Ok(expected), "{body}");
        }
        for (body, part) in [
            (r#"{"choices":[{"message":{"content":"hi"}}]}"#, "a list at $.content"),
            (r#"{"content":[],"stop_reason":"max_tokens"}"#, "max_tokens"),
            (r#"{"content":[],"stop_reason":"refusal"}"#, "declined"),
            (r#"{"type":"error","error":{"type":"overloaded_error","message":"Overloaded"}}"#, "Overloaded"),
        ] {
            let error = text(body).unwrap_err();
            assert!(error.contains(part), "{body}: {error}");
        }
        let cached = r#"{"content":[{"type":"text","text":"hi"}],"usage":
            {"input_tokens":3,"cache_read_input_tokens":40,"cache_creation_input_tokens":500,"output_tokens":6}}"#;
        let usage = check(cached).unwrap().usage;
        assert_eq!(usage, Some(Usage { prompt_tokens: 543, completion_tokens: 6 }));
    }
}
