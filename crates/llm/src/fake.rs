//! Test doubles of language models: a script, and a loopback server with the faults of [`Behaviour`].
//!
//! Neither is a language model; their answers must never be reported as a model's.

use std::sync::Mutex;

use crate::error::ChatError;
use crate::model::ChatModel;
use crate::reply::{ChatReply, Structure};
use crate::request::ChatRequest;

mod server;
pub use server::{Behaviour, FakeServer, SeenRequest, answering, completion, message};

/// Returns prepared answers in order and records the requests.
///
/// ```
/// use genmanip_llm::{ChatModel, ChatRequest, Message, fake::ScriptedChat};
/// let model = ScriptedChat::new(["first", "second"]);
/// let request = ChatRequest::new("any", vec![Message::user("?")]);
/// assert_eq!(model.chat(&request).unwrap().text, "first");
/// assert_eq!(model.chat(&request).unwrap().text, "second");
/// assert!(model.chat(&request).is_err());
/// ```
#[derive(Debug)]
pub struct ScriptedChat {
    answers: Vec<String>,
    seen: Mutex<Vec<ChatRequest>>,
}

impl ScriptedChat {
    /// Creates a model with these answers.
    pub fn new<T: Into<String>>(answers: impl IntoIterator<Item = T>) -> Self {
        Self { answers: answers.into_iter().map(Into::into).collect(), seen: Mutex::default() }
    }

    /// Requests answered so far, in order; those after the last prepared answer fail and are not recorded.
    pub fn seen(&self) -> Vec<ChatRequest> {
        self.seen.lock().map(|seen| seen.clone()).unwrap_or_default()
    }
}

impl ChatModel for ScriptedChat {
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        let ended = ChatError::ScriptEnded { answers: self.answers.len() };
        let Ok(mut seen) = self.seen.lock() else {
            return Err(ended);
        };
        let text = self.answers.get(seen.len()).cloned().ok_or(ended)?;
        seen.push(request.clone());
        Ok(ChatReply {
            text,
            model: "script".into(),
            finish_reason: None,
            usage: None,
            structure: Structure::Plain,
            attempts: 0,
        })
    }
}
