//! The model behind the questions.

use std::sync::Arc;

use genmanip_chat::{ChatModel, Usage};
use serde_json::{Map, Value};

use super::question::Question;

/// Anything that answers questions about pictures: a chat server, a folder, recorded answers, the harness's oracle.
///
/// Calls block and may come from several threads at once.
pub trait VisionModel: Send + Sync {
    /// The answer, in the model's own words; nothing is checked yet.
    ///
    /// # Errors
    /// Says why there is none; retries are over by then.
    fn answer(&self, question: &Question) -> Result<Answered, ServiceError>;
}

/// What a model said.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answered {
    /// Its words.
    pub text: String,
    /// What it cost, where the service says so.
    pub usage: Option<Usage>,
}

/// Why there is no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ServiceError(pub String);

/// A chat model: live, recorded, or a person behind a folder.
pub struct ChatService {
    /// Who answers.
    pub chat: Arc<dyn ChatModel>,
    /// Name of the model, as the server knows it.
    pub model: String,
    /// Further fields of the request.
    pub parameters: Map<String, Value>,
}

impl VisionModel for ChatService {
    fn answer(&self, question: &Question) -> Result<Answered, ServiceError> {
        let unsaid = |error: &dyn std::fmt::Display| ServiceError(error.to_string());
        let request = question.request(&self.model, &self.parameters).map_err(|error| unsaid(&error))?;
        let reply = self.chat.chat(&request).map_err(|error| unsaid(&error))?;
        Ok(Answered { text: reply.text, usage: reply.usage })
    }
}
