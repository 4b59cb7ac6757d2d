//! The client against a real server on loopback, dialects, images, cassettes and secrets.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod cassettes;
mod client;
mod dialects;
mod folder;
mod images;
mod secrets;
mod services;

use genmanip_core::Seed;
use genmanip_llm::fake::FakeServer;
use genmanip_llm::{ChatRequest, HttpChat, Message, ReplySchema, ServerSettings};

/// Settings for a loopback server with short timeouts.
fn impatient(base_url: String) -> ServerSettings {
    ServerSettings {
        base_url,
        model: "scripted".into(),
        connect_timeout_s: 2.0,
        total_timeout_s: 5.0,
        max_retries: 2,
        first_backoff_s: 0.01,
        max_backoff_s: 0.02,
        max_retry_after_s: 2.0,
        ..ServerSettings::default()
    }
}

fn client(server: &FakeServer) -> HttpChat {
    HttpChat::new(impatient(server.base_url()), None, Seed::new(1)).unwrap()
}

fn question(text: &str) -> ChatRequest {
    ChatRequest::new("scripted", vec![Message::system("Answer."), Message::user(text)])
}

fn structured_question() -> ChatRequest {
    let schema = serde_json::json!({"type": "object", "properties": {}, "additionalProperties": false});
    ChatRequest { reply_schema: Some(ReplySchema::new("empty", schema)), ..question("?") }
}
