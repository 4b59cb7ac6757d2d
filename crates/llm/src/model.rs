//! The one interface that everything which answers a conversation implements.

use crate::error::ChatError;
use crate::reply::ChatReply;
use crate::request::ChatRequest;

/// Anything that answers a conversation: a server, a folder of cassettes, a script.
///
/// Calls block and may come from several threads at once.
pub trait ChatModel: Send + Sync {
    /// Asks for the next message of the conversation.
    ///
    /// # Errors
    /// Says why there is no answer; retries are over by then.
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError>;

    /// Asks several conversations that do not depend on each other; the replies are in the same order.
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
