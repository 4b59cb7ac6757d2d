//! OpenAI chat completions API: OpenAI, vLLM, llama.cpp, Ollama, LM Studio, gateways.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Map, Value, json};

use super::{Wire, chat_reply, check_error, short_text};
use crate::error::{ChatError, shortened};
use crate::message::{Message, Part};
use crate::reply::{ChatReply, Structure, Usage};
use crate::request::ChatRequest;
use crate::secret::ApiKey;

/// Dialect with the endpoint `POST {base_url}/chat/completions`.
pub(crate) struct OpenAi;

impl Wire for OpenAi {
    fn path(&self) -> &'static str {
        "/chat/completions"
    }

    fn headers(&self, key: Option<&ApiKey>) -> Vec<(&'static str, String)> {
        key.map(|key| ("authorization", key.header_value("Bearer "))).into_iter().collect()
    }

    fn structures(&self) -> &'static [Structure] {
        &Structure::ALL
    }

    fn reserved(&self) -> &'static [&'static str] {
        &["model", "messages", "response_format", "stream", "n"]
    }

    fn request_body(&self, request: &ChatRequest, structure: Structure) -> Value {
        let message = |message: &Message| json!({"role": message.role, "content": content(message)});
        let messages: Vec<Value> = request.messages.iter().map(message).collect();
        let mut body = Map::new();
        body.insert("model".into(), request.model.clone().into());
        body.insert("messages".into(), messages.into());
        body.extend(request.parameters.clone());
        if let Some(format) = response_format(request, structure) {
            body.insert("response_format".into(), format);
        }
        body.into()
    }

    /// Accepts common deviations. The content may be a string, a list of text parts or an object. The answer may also
    /// stand in a tool call, in `parsed`, or at the end of `reasoning_content` or `reasoning`. A reasoning block may
    /// precede the reply, and token counts may be missing.
    fn reply(&self, body: &Value, structure: Structure, url: &str) -> Result<ChatReply, ChatError> {
        let missing = |path: &str, expected: &str| ChatError::NotACompletion {
            url: url.into(),
            path: path.into(),
            expected: expected.into(),
        };
        check_error(body, url)?;
        let choices = body.get("choices").and_then(Value::as_array).ok_or_else(|| missing("$.choices", "a list"))?;
        let choice = choices.first().ok_or_else(|| missing("$.choices[0]", "an answer"))?;
        let message = choice.get("message").filter(|message| message.is_object());
        let message = message.ok_or_else(|| missing("$.choices[0].message", "an object"))?;
        let finish_reason = short_text(choice, "finish_reason");
        if let Some(words) = message.get("refusal").and_then(Value::as_str).filter(|words| !words.is_empty()) {
            return Err(ChatError::Declined { message: shortened(words, 300) });
        }
        let mut said = SAID_IN.iter().filter_map(|pointer| message.pointer(pointer).and_then(text_of_content));
        let text = said.find(|text| !text.trim().is_empty()).unwrap_or_default();
        chat_reply(body, &text, finish_reason, body.get("usage").and_then(usage), structure)
    }
}

/// JSON pointers to the answer in a message, in order of preference; the reasoning fields are used only if nothing else
/// is present.
const SAID_IN: [&str; 6] = [
    "/content",
    "/parsed",
    "/tool_calls/0/function/arguments",
    "/function_call/arguments",
    "/reasoning_content",
    "/reasoning",
];

/// A single text as a string, which every server accepts; anything else as a list of typed parts.
fn content(message: &Message) -> Value {
    match &message.parts[..] {
        [Part::Text(text)] => text.clone().into(),
        parts => parts.iter().map(part).collect(),
    }
}

fn part(part: &Part) -> Value {
    match part {
        Part::Text(text) => json!({"type": "text", "text": text}),
        Part::Image(image) => {
            let url = format!("data:{};base64,{}", image.media_type().name(), STANDARD.encode(image.bytes()));
            json!({"type": "image_url", "image_url": {"url": url}})
        }
    }
}

fn response_format(request: &ChatRequest, structure: Structure) -> Option<Value> {
    let schema = request.reply_schema.as_ref()?;
    let enforced = |enforced: &Value| {
        Some(json!({
            "type": "json_schema",
            "json_schema": {"name": schema.name, "strict": true, "schema": enforced},
        }))
    };
    match structure {
        Structure::Grammar => enforced(schema.grammar.as_ref().unwrap_or(&schema.schema)),
        Structure::JsonSchema => enforced(&schema.schema),
        Structure::JsonObject => Some(json!({"type": "json_object"})),
        Structure::Plain => None,
    }
}

fn text_of_content(content: &Value) -> Option<String> {
    match content {
        Value::String(text) => Some(text.clone()),
        Value::Array(parts) => {
            Some(parts.iter().filter_map(|part| part.get("text").and_then(Value::as_str)).collect::<String>())
        }
        Value::Object(_) => Some(content.to_string()),
        Value::Null | Value::Bool(_) | Value::Number(_) => None,
    }
}

fn usage(value: &Value) -> Option<Usage> {
    let count = |name: &str| value.get(name).and_then(Value::as_u64);
    Some(Usage { prompt_tokens: count("prompt_tokens")?, completion_tokens: count("completion_tokens")? })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(body: &str) -> Result<String, String> {
        let body = serde_json::from_str(body).unwrap();
        OpenAi.reply(&body, Structure::Plain, "http://x").map(|reply| reply.text).map_err(|error| error.to_string())
    }

    #[test]
    fn answers_in_the_shapes_that_servers_send() {
        for (body, expected) in [
            (r#"{"choices":[{"message":{"content":"hi"}}]}"#, "hi"),
            (r#"{"choices":[{"message":{"content":[{"type":"text","text":"h"},{"text":"i"}]}}]}"#, "hi"),
            (r#"{"choices":[{"message":{"content":null,"reasoning_content":"hi"}}]}"#, "hi"),
            (r#"{"choices":[{"message":{"content":"<think>{ no }</think>\n\nhi"}}]}"#, "hi"),
            (r#"{"choices":[{"message":{"content":"hi","refusal":null}}],"error":null}"#, "hi"),
            (r#"{"choices":[{"message":{"content":null,"reasoning":"hi"}}]}"#, "hi"),
            (r#"{"choices":[{"message":{"content":"","reasoning":"hm","parsed":{"a":1}}}]}"#, r#"{"a":1}"#),
            (r#"{"choices":[{"message":{"content":{"a":1}}}]}"#, r#"{"a":1}"#),
            (
                r#"{"choices":[{"message":{"content":null,"reasoning_content":"hm","tool_calls":
                    [{"type":"function","function":{"name":"task","arguments":"{\"a\":1}"}}]}}]}"#,
                r#"{"a":1}"#,
            ),
            (r#"{"choices":[{"message":{"content":"A draft: {\"a\": 0}.\n</think>\n\nhi"}}]}"#, "hi"),
            (r#"{"choices":[{"message":{"content":"[THINK]no[/THINK]hi"}}]}"#, "hi"),
            (r#"{"choices":[{"message":{"content":"{\"a\": \"</think>b\"}"}}]}"#, r#"{"a": "</think>b"}"#),
        ] {
            assert_eq!(check(body).as_deref(), Ok(expected), "{body}");
        }
        for (body, part) in [
            (r#"[]"#, "$.choices"),
            (r#"{"choices":[]}"#, "$.choices[0]"),
            (r#"{"choices":[{}]}"#, "$.choices[0].message"),
            (
                r#"{"choices":[{"message":{"content":" "},"finish_reason":"length"}]}"#,
                "`max_tokens`; finish reason: length",
            ),
            (r#"{"choices":[{"message":{"content":null,"refusal":"I will not"}}]}"#, "I will not"),
            (r#"{"error":{"message":"no such model"}}"#, "no such model"),
            (r#"{"error":"busy"}"#, "busy"),
            (r#"{"detail":[{"loc":["body"]}]}"#, "loc"),
        ] {
            let error = check(body).unwrap_err();
            assert!(error.contains(part), "{body}: {error}");
        }
    }

    #[test]
    fn tokens_are_counted_only_when_both_numbers_are_there() {
        for (usage_text, expected) in [
            (r#"{"prompt_tokens":3,"completion_tokens":4}"#, Some((3, 4))),
            (r#"{"prompt_tokens":3}"#, None),
            (r#"{"prompt_tokens":-3,"completion_tokens":"4"}"#, None),
            ("null", None),
        ] {
            let value: Value = serde_json::from_str(usage_text).unwrap();
            assert_eq!(usage(&value).map(|u| (u.prompt_tokens, u.completion_tokens)), expected, "{usage_text}");
        }
    }
}
