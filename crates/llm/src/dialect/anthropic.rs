//! Anthropic's messages: its own service and gateways that offer the same path.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Map, Value, json};

use super::{Wire, error_message, model_name, without_thoughts};
use crate::error::{ChatError, shortened};
use crate::message::{Message, Part, Role};
use crate::reply::{ChatReply, Structure, Usage};
use crate::request::ChatRequest;
use crate::secret::ApiKey;

/// Version of the interface that the shapes below belong to; the service wants it in a header.
const INTERFACE_VERSION: &str = "2023-06-01";
/// Longest answer in tokens where `parameters` has no `max_tokens`, which the service demands; room for a long answer
/// with thoughts, and within what every model of the service allows.
const MAX_TOKENS: u64 = 4096;

/// `POST {base_url}/messages`.
pub(crate) struct Anthropic;

impl Wire for Anthropic {
    fn path(&self) -> &'static str {
        "/messages"
    }

    fn headers(&self, key: Option<&ApiKey>) -> Vec<(&'static str, String)> {
        let key = key.map(|key| ("x-api-key", key.after("")));
        [("anthropic-version", INTERFACE_VERSION.into())].into_iter().chain(key).collect()
    }

    /// The words of the prompt alone: no tools are used to force a shape.
    fn structures(&self) -> &'static [Structure] {
        &[Structure::Plain]
    }

    fn reserved(&self) -> &'static [&'static str] {
        &["model", "system", "messages", "stream", "tools", "tool_choice"]
    }

    /// The shape that is asked for stands in the instructions, since nothing else carries it.
    fn request_body(&self, request: &ChatRequest, _: Structure) -> Value {
        let (standing, said): (Vec<&Message>, Vec<&Message>) =
            request.messages.iter().partition(|message| message.role == Role::System);
        let mut system: Vec<String> = standing.into_iter().map(Message::text).collect();
        if let Some(schema) = &request.reply_schema {
            system.push(format!("Answer with JSON alone that obeys this JSON Schema:\n{}", schema.schema));
        }
        let message = |message: &&Message| json!({"role": message.role, "content": content(message)});
        let messages: Vec<Value> = said.iter().map(message).collect();
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

    /// Joins the text blocks; blocks of thoughts are left out.
    fn reply(&self, body: &Value, structure: Structure, url: &str) -> Result<ChatReply, ChatError> {
        if let Some(message) = error_message(body) {
            return Err(ChatError::Status { status: 200, message, url: url.into() });
        }
        let blocks = body.get("content").and_then(Value::as_array).ok_or_else(|| ChatError::NotACompletion {
            url: url.into(),
            path: "$.content".into(),
            expected: "a list".into(),
        })?;
        let is_text = |block: &&Value| block.get("type").and_then(Value::as_str) == Some("text");
        let said: String =
            blocks.iter().filter(is_text).filter_map(|block| block.get("text").and_then(Value::as_str)).collect();
        let text = without_thoughts(&said).to_owned();
        let finish_reason = body.get("stop_reason").and_then(Value::as_str).map(|reason| shortened(reason, 100));
        if finish_reason.as_deref() == Some("refusal") {
            let message = if text.trim().is_empty() { "(no reason given)".into() } else { shortened(&text, 300) };
            return Err(ChatError::Declined { message });
        }
        if text.trim().is_empty() {
            return Err(ChatError::NoText { finish_reason: finish_reason.unwrap_or_else(|| "none".into()) });
        }
        Ok(ChatReply {
            text,
            model: model_name(body),
            finish_reason,
            usage: body.get("usage").and_then(usage),
            structure,
            attempts: 0,
        })
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

/// What was read from the service's own cache is counted beside `input_tokens` and belongs to the conversation.
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
