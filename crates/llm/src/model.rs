//! Interface of chat models.

use crate::error::ChatError;
use crate::reply::ChatReply;
use crate::request::ChatRequest;

/// A source of replies to conversations: a server, a folder of cassettes, a script.
///
/// Calls block and may come from several threads at once.
pub trait ChatModel: Send + Sync {
    /// Requests the next message of a conversation.
    ///
    /// # Errors
    /// Reports why there is no reply, after all retries.
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError>;

    /// Requests replies to independent conversations, in the same order; an implementation may send them concurrently.
    fn chat_each(&self, requests: &[ChatRequest]) -> Vec<Result<ChatReply, ChatError>> {
        requests.iter().map(|request| self.chat(request)).collect()
    }
}

impl<M: ChatModel + ?Sized> ChatModel for Box<M> {
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        (**self).chat(request)
    }
}

impl<M: ChatModel + ?Sized> ChatModel for &M {
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        (**self).chat(request)
    }
}
