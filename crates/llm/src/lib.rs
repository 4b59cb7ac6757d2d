//! Language-model client: requests, replies, recording and accounting, independent of their content.
//!
//! - [`ChatModel`] replies to a [`ChatRequest`], whose messages consist of texts and images.
//! - [`HttpChat`]: a server in its [`Dialect`], with limits on time, size and retries, and structured output with
//!   fallback.
//! - [`CassetteChat`]: records exchanges and replays them, looked up by request content.
//! - [`FolderChat`]: writes questions to a folder and waits for answers there; [`FolderAnswers`] is the side of those
//!   who answer.
//! - [`Service`]: interface of JSON services, over HTTP, recorded or replayed.
//! - [`Ledger`]: counts replies, requests, tokens and cost.
//! - [`fake`]: a scripted model and a configurable misbehaving loopback server, for tests.
//!
//! The API key is read from the environment, sent in one header, and never appears in files, errors or debug output.
//!
//! ```
//! use genmanip_llm::{ChatModel, ChatRequest, Message, fake::ScriptedChat};
//!
//! let model = ScriptedChat::new(["Bonjour."]);
//! let request = ChatRequest::new("any", vec![Message::system("Answer in French."), Message::user("Good morning.")]);
//! assert_eq!(model.chat(&request).unwrap().text, "Bonjour.");
//! ```

mod cassette;
mod cost_ledger;
mod dialect;
mod error;
pub mod fake;
pub mod files;
mod folder;
mod http;
mod lines;
mod message;
mod model;
mod nearest;
mod recorded;
mod reply;
mod request;
mod retry;
mod secret;
mod service;
mod settings;
mod transport;

pub use cassette::{Cassette, CassetteChat, CassetteMode, CassetteSettings, read as read_cassette};
pub use cost_ledger::{Cost, Ledger, ModelUsage, Price};
pub use dialect::Dialect;
pub use error::{ChatError, ImageError, NearestCassette, SettingsError};
pub use folder::{
    Answered, AnsweringError, FolderAnswers, FolderChat, FolderMessage, FolderPart, FolderQuestion, FolderSettings,
    QuestionRow,
};
pub use http::HttpChat;
pub use message::{Image, MediaType, Message, Part, Role};
pub use model::ChatModel;
pub use recorded::{RecordedImage, RecordedMessage, RecordedPart, RecordedText};
pub use reply::{ChatReply, Structure, Usage};
pub use request::{ChatRequest, RecordedRequest, ReplySchema};
pub use secret::ApiKey;
pub use service::{HttpService, RecordedService, Service, ServiceCassette, ServiceSettings};
pub use settings::{ServerSettings, from_toml};
