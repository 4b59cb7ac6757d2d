//! Tasks invented by a language model: asking, checking, asking again, and doing it all again without the model.
//!
//! - [`generate`] asks any OpenAI-compatible server for tasks and returns valid ones or typed refusals.
//! - [`HttpChat`] is the client: limits on time, size and patience, structured output with a fallback.
//! - [`CassetteChat`] records exchanges and replays them, keyed by the content of the question.
//! - [`PromptSet`] holds the prompts, which are files; [`sample_objects`] chooses the objects to offer.
//! - [`fake`] has a scripted model and a loopback server that misbehaves on request.
//!
//! What a model says is never trusted: the only way to a task is `genmanip_scene::answer::check_answer`.
//! The API key is read from the environment, sent in one header, and is in no file, error or debug text.
//!
//! ```
//! use genmanip_core::{Seed, TaskKind};
//! use genmanip_llm::{Designer, LlmSettings, fake::ScriptedChat};
//!
//! let mut settings = LlmSettings::default();
//! settings.generation.max_rounds = 1;
//! let designer = Designer::with_model(ScriptedChat::new(["I would rather not."]), &settings).unwrap();
//! let outcomes = designer.generate(TaskKind::Spatial, 1, Seed::new(1), &[], &|_| {});
//! assert!(outcomes[0].refusal().unwrap().contains("the catalogue has 0")); // nothing to offer, nothing asked
//! ```

mod cassette;
mod chat;
mod designer;
mod error;
pub mod fake;
mod http;
mod ledger;
mod lines;
mod nearest;
mod outcome;
mod prompt;
mod retry;
mod sampling;
mod secret;
mod settings;
mod wire;

pub use cassette::{Cassette, CassetteChat, CassetteMode, read as read_cassette};
pub use chat::{ChatModel, ChatReply, ChatRequest, Message, ReplySchema, Role, Structure, Usage};
pub use designer::{Designer, generate};
pub use error::{ChatError, NearestCassette, SettingsError};
pub use http::HttpChat;
pub use ledger::{Cost, Ledger, ModelUsage, Price};
pub use outcome::{Designed, GenerationOutcome, Refusal, Round};
pub use prompt::{Prompt, PromptError, PromptHead, PromptSet, PromptStamp};
pub use sampling::{SamplingError, SamplingSettings, sample_objects};
pub use secret::ApiKey;
pub use settings::{CassetteSettings, GenerationSettings, LlmSettings, ServerSettings};
