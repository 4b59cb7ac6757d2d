//! The model behind the questions.

use std::sync::Arc;

use genmanip_llm::{ChatError, ChatModel, ChatReply, ChatRequest, ImageError, Usage};
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

    /// The answers to questions that do not depend on each other, in the same order; a service may be asked all of them
    /// at once.
    fn answer_each(&self, questions: &[&Question]) -> Vec<Result<Answered, ServiceError>> {
        questions.iter().map(|question| self.answer(question)).collect()
    }
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
pub enum ServiceError {
    /// The service cannot be asked now, retries included. Asking again at once is of no use.
    #[error("{0}")]
    Unreachable(String),
    /// Something came back that is no answer of a model, for example half a page: asking again may help.
    #[error("{0}")]
    Garbled(String),
    /// The model answered with nothing that could be read: too much, nothing, or a refusal. It counts as an answer that
    /// does not fit.
    #[error("{0}")]
    Unreadable(String),
}

impl From<ChatError> for ServiceError {
    fn from(error: ChatError) -> Self {
        let text = error.to_string();
        match error {
            ChatError::TooLarge { .. } | ChatError::NoText { .. } | ChatError::Declined { .. } => {
                Self::Unreadable(text)
            }
            ChatError::NotJson { .. } | ChatError::NotACompletion { .. } => Self::Garbled(text),
            _ => Self::Unreachable(text),
        }
    }
}

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
        self.answer_each(&[question]).remove(0)
    }

    fn answer_each(&self, questions: &[&Question]) -> Vec<Result<Answered, ServiceError>> {
        let request = |question: &&Question| question.request(&self.model, &self.parameters);
        let requests: Result<Vec<ChatRequest>, ImageError> = questions.iter().map(request).collect();
        match requests {
            Ok(requests) => {
                let answered = |reply: ChatReply| Answered { text: reply.text, usage: reply.usage };
                self.chat.chat_each(&requests).into_iter().map(|reply| Ok(answered(reply?))).collect()
            }
            Err(error) => vec![Err(ServiceError::Unreachable(error.to_string())); questions.len()],
        }
    }
}
