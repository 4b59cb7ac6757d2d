use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use genmanip_core::Seed;
use genmanip_llm::fake::{Behaviour, FakeServer};
use genmanip_llm::{
    ApiKey, ChatModel, ChatRequest, Dialect, HttpChat, Message, ServerSettings, Structure, Usage, from_toml,
};
use serde_json::json;

use crate::images::{RED_GREEN, image, png, words};
use crate::{impatient, question, structured_question};

const KEY: &str = "sk-test-0123456789";

fn speaking(dialect: Dialect, server: &FakeServer) -> HttpChat {
    let settings = ServerSettings { dialect, ..impatient(server.base_url()) };
    HttpChat::new(settings, Some(ApiKey::new(KEY).unwrap()), Seed::new(1)).unwrap()
}

/// The same request gives the same reply and key in every dialect; only the encoding differs.
#[test]
fn every_dialect_asks_and_answers() {
    for &dialect in Dialect::ALL {
        let busy = Behaviour::Status(529, vec![], r#"{"type":"error","error":{"message":"Overloaded"}}"#.into());
        let server = FakeServer::scripted([busy, Behaviour::Answer("hello".into())]).unwrap();
        let reply = speaking(dialect, &server).chat(&question("?")).unwrap();
        assert_eq!((reply.text.as_str(), reply.model.as_str(), reply.attempts), ("hello", "fake-server", 2));
        assert_eq!(reply.usage, Some(Usage { prompt_tokens: 100, completion_tokens: 10 }), "{dialect:?}");
        let refused =
            Behaviour::Status(401, vec![], format!(r#"{{"type":"error","error":{{"message":"bad key {KEY}"}}}}"#));
        let server = FakeServer::scripted([refused]).unwrap();
        let error = speaking(dialect, &server).chat(&question("?")).unwrap_err().to_string();
        assert!(error.ends_with("401: bad key [key hidden]"), "{dialect:?}: {error}");
    }
}

#[test]
fn what_is_sent_as_messages() {
    let server = FakeServer::scripted([Behaviour::Answer("{}".into())]).unwrap();
    let mut request = ChatRequest {
        messages: vec![
            Message::system("Be brief."),
            Message::user("?"),
            Message::assistant("!"),
            Message::user_parts([words("What is this?"), image(RED_GREEN)]),
        ],
        ..structured_question()
    };
    request.parameters.insert("max_tokens".into(), 9.into());
    let reply = speaking(Dialect::Anthropic, &server).chat(&request).unwrap();
    assert_eq!((reply.structure, reply.attempts), (Structure::Plain, 1));
    let seen = &server.seen()[0];
    assert_eq!(seen.target, "POST /v1/messages");
    assert_eq!((seen.headers["x-api-key"].as_str(), seen.headers["anthropic-version"].as_str()), (KEY, "2023-06-01"));
    assert!(!seen.headers.contains_key("authorization"));
    let schema = r#"{"type":"object","properties":{},"additionalProperties":false}"#;
    let expected = json!({
        "model": "scripted",
        "max_tokens": 9,
        "system": format!("Be brief.\n\nAnswer with JSON alone that obeys this JSON Schema:\n{schema}"),
        "messages": [
            {"role": "user", "content": "?"},
            {"role": "assistant", "content": "!"},
            {"role": "user", "content": [
                {"type": "text", "text": "What is this?"},
                {"type": "image", "source": {
                    "type": "base64", "media_type": "image/png", "data": STANDARD.encode(png(RED_GREEN)),
                }},
            ]},
        ],
    });
    assert_eq!(serde_json::to_string_pretty(&seen.body).unwrap(), serde_json::to_string_pretty(&expected).unwrap());
}

#[test]
fn dialects_are_named_in_the_settings_and_guard_their_fields() {
    let read =
        |text: &str| from_toml::<ServerSettings>(text).and_then(|settings| settings.check().map(|()| settings.dialect));
    assert_eq!(read("").unwrap(), Dialect::OpenAi);
    assert_eq!(read("dialect = \"openai\"").unwrap(), Dialect::OpenAi);
    assert_eq!(read("dialect = \"anthropic\"\nparameters = { max_tokens = 5 }").unwrap(), Dialect::Anthropic);
    for (text, part) in [
        ("dialect = \"klingon\"", "expected `openai` or `anthropic`"),
        ("parameters = { response_format = 1 }", "fields other than model, messages, response_format, stream, n"),
        ("dialect = \"anthropic\"\nparameters = { system = 1 }", "fields other than model, system, messages"),
    ] {
        let error = read(text).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}
