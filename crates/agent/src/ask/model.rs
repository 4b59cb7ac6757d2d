//! Interface of vision-language models.

use std::sync::Arc;

use genmanip_llm::{ChatError, ChatModel, ChatReply, ChatRequest, ImageError, Usage};
use serde_json::{Map, Value};

use super::question::Question;

/// A source of answers to questions about images: a chat server, a folder, recorded answers, an oracle.
///
/// Calls block and may come from several threads at once.
pub trait VisionModel: Send + Sync {
    /// Returns the raw text of the answer, not yet validated.
    ///
    /// # Errors
    /// Reports why there is no answer, after all retries.
    fn answer(&self, question: &Question) -> Result<ModelReply, ServiceError>;

    /// Answers independent questions, in order; a service may process them concurrently.
    fn answer_each(&self, questions: &[&Question]) -> Vec<Result<ModelReply, ServiceError>> {
        questions.iter().map(|question| self.answer(question)).collect()
    }
}

/// Reply of a model to a question.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ModelReply {
    /// Text of the reply, not yet validated.
    pub text: String,
    /// Token usage, if the service reports it; `None` otherwise.
    pub usage: Option<Usage>,
    /// True if the model was stopped at its token limit: asking again would not help.
    pub cut_off: bool,
}

/// Error of the model service.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ServiceError {
    /// The service is unreachable after all retries; an immediate retry is pointless.
    #[error("{0}")]
    Unreachable(String),
    /// The response is not a model reply, for example a truncated body; a retry may help.
    #[error("{0}")]
    Garbled(String),
    /// The model was stopped at its limit of tokens before it said anything. Counts as an invalid answer; an immediate
    /// retry is pointless.
    #[error("{0}")]
    CutOff(String),
    /// The reply cannot be used as text: too long, empty, or a refusal. Counts as an invalid answer.
    #[error("{0}")]
    Unreadable(String),
}

impl From<ChatError> for ServiceError {
    fn from(error: ChatError) -> Self {
        let text = error.to_string();
        match error {
            error if error.is_cut_off() => Self::CutOff(text),
            ChatError::TooLarge { .. } | ChatError::NoText { .. } | ChatError::Declined { .. } => {
                Self::Unreadable(text)
            }
            ChatError::NotJson { .. } | ChatError::NotACompletion { .. } => Self::Garbled(text),
            _ => Self::Unreachable(text),
        }
    }
}

/// Adapter of a [`ChatModel`]: live, recorded, or a person behind a folder.
pub struct ChatService {
    /// Backend that answers chat requests.
    pub chat: Arc<dyn ChatModel>,
    /// Model name on the server.
    pub model: String,
    /// Additional fields of the request, such as `temperature`.
    pub parameters: Map<String, Value>,
}

impl VisionModel for ChatService {
    fn answer(&self, question: &Question) -> Result<ModelReply, ServiceError> {
        self.answer_each(&[question]).remove(0)
    }

    fn answer_each(&self, questions: &[&Question]) -> Vec<Result<ModelReply, ServiceError>> {
        let request = |question: &&Question| question.request(&self.model, &self.parameters);
        let requests: Result<Vec<ChatRequest>, ImageError> = questions.iter().map(request).collect();
        match requests {
            Ok(requests) => {
                let answered =
                    |reply: ChatReply| ModelReply { cut_off: reply.is_cut_off(), text: reply.text, usage: reply.usage };
                self.chat.chat_each(&requests).into_iter().map(|reply| Ok(answered(reply?))).collect()
            }
            Err(error) => vec![Err(ServiceError::Unreachable(error.to_string())); questions.len()],
        }
    }
}
