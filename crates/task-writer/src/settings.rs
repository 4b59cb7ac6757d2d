//! Settings of the task writer, written by users as TOML.

use std::collections::BTreeMap;
use std::path::PathBuf;

use genmanip_llm::{CassetteSettings, FolderSettings, Price, ServerSettings, SettingsError, from_toml};
use serde::{Deserialize, Serialize};

use crate::sampling::SamplingSettings;

/// Settings of the task writer. They name the environment variable with the API key, never the key.
///
/// ```
/// use genmanip_task_writer::LlmSettings;
/// let settings = LlmSettings::from_toml(r#"
///     [server]
///     base_url = "http://127.0.0.1:8080/v1"
///     model = "qwen2.5-7b-instruct"
///     [server.parameters]
///     temperature = 0.7
/// "#).unwrap();
/// assert_eq!(settings.server.max_retries, 4);
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LlmSettings {
    /// Address, model, limits and retries of the server.
    pub server: ServerSettings,
    /// Folder through which a person or program answers the requests, instead of the server; `None` to use the server.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folder: Option<FolderSettings>,
    /// Folder and mode for recording and replaying answers.
    pub cassettes: CassetteSettings,
    /// Rounds, workers, prompts and object sampling of the generation.
    pub generation: GenerationSettings,
    /// Token prices by model name; the costs of a model that is not listed are unknown.
    pub prices: BTreeMap<String, Price>,
}

/// Settings of the generation that do not depend on the server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GenerationSettings {
    /// Maximum number of answers per task, repairs included.
    pub max_rounds: u32,
    /// Number of tasks generated concurrently; also the maximum number of open requests.
    pub workers: usize,
    /// Minimum number of objects in a scene.
    pub min_objects: usize,
    /// Random sampling of the objects offered to the model.
    pub sampling: SamplingSettings,
    /// Folder with prompt files that replace built-in ones; `None` for the built-in ones.
    pub prompts: Option<PathBuf>,
    /// Maximum length of an answer quoted back for repair (bytes); longer ones are truncated.
    pub max_quoted_bytes: usize,
}

impl Default for GenerationSettings {
    fn default() -> Self {
        Self {
            max_rounds: 3,  // a model that fails twice with the list of faults at hand rarely recovers
            workers: 4,     // polite to a shared server
            min_objects: 4, // enough for distractors and indirect places
            sampling: SamplingSettings::default(),
            prompts: None,
            max_quoted_bytes: 32 << 10, // ten times a usual answer
        }
    }
}

impl LlmSettings {
    /// Parses and validates TOML settings.
    ///
    /// # Errors
    /// Names the line or the field; never shows values, which may be a key.
    pub fn from_toml(text: &str) -> Result<Self, SettingsError> {
        let settings: Self = from_toml(text)?;
        settings.check()?;
        Ok(settings)
    }

    /// Validates the settings.
    ///
    /// # Errors
    /// Names the first invalid field.
    pub fn check(&self) -> Result<(), SettingsError> {
        self.server.check()?;
        if let Some(folder) = &self.folder {
            folder.check()?;
        }
        let generation = &self.generation;
        let invalid = |field, expected: &str| Err(SettingsError::Invalid { field, expected: expected.into() });
        if !(1..=64).contains(&generation.workers) {
            return invalid("generation.workers", "1 to 64");
        }
        if !(1..=16).contains(&generation.max_rounds) {
            return invalid("generation.max_rounds", "1 to 16");
        }
        if generation.min_objects < 2 || generation.min_objects > generation.sampling.offered {
            return invalid("generation.min_objects", "2 up to `generation.sampling.offered`");
        }
        self.prices.values().try_for_each(Price::check)?;
        Ok(())
    }
}
