//! Task generation by a language model: prompts, validation, repair rounds, and replay without the model.
//!
//! - [`generate`]: requests tasks from a language model and returns valid ones or typed failures.
//! - [`PromptSet`]: the prompt files; [`sample_objects`] chooses the objects to offer.
//!
//! Conversation, server and recording are in `genmanip_llm`. Model output is never trusted: the only way to a task is
//! `genmanip_tasks::answer::check_answer`.
//!
//! ```
//! use genmanip_llm::fake::ScriptedChat;
//! use genmanip_core::{Seed, TaskKind};
//! use genmanip_task_writer::{Designer, LlmSettings};
//!
//! let mut settings = LlmSettings::default();
//! settings.generation.max_rounds = 1;
//! let designer = Designer::with_model(ScriptedChat::new(["I would rather not."]), &settings).unwrap();
//! let outcomes = designer.generate(&[(TaskKind::Spatial, 1)], Seed::new(1), &[], &|_| {});
//! assert!(outcomes[0].refusal().unwrap().contains("the catalogue has 0")); // nothing to offer, nothing asked
//! ```

mod designer;
mod grammar;
mod outcome;
mod prompt;
mod sampling;
mod settings;

pub use designer::{Designer, DesignerError, GenerationEvent, generate};
pub use outcome::{Designed, GenerationOutcome, Refusal, Round};
pub use prompt::{KindPrompts, Prompt, PromptError, PromptHead, PromptSet, PromptStamp};
pub use sampling::{SamplingError, SamplingSettings, sample_objects};
pub use settings::{GenerationSettings, LlmSettings};
