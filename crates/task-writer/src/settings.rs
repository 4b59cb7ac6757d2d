//! Everything that can be chosen, on one screen; written by people as TOML.

use std::collections::BTreeMap;
use std::path::PathBuf;

use genmanip_llm::{CassetteSettings, FolderSettings, Price, ServerSettings, SettingsError, from_toml};
use serde::{Deserialize, Serialize};

use crate::sampling::SamplingSettings;

/// Settings of the language-model designer. They name the variable that holds the key, never the key.
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
    /// The server and how patient to be with it.
    pub server: ServerSettings,
    /// A folder in which somebody answers, instead of the server.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folder: Option<FolderSettings>,
    /// Recording and replaying.
    pub cassettes: CassetteSettings,
    /// How tasks are asked for.
    pub generation: GenerationSettings,
    /// What tokens cost, by model name; a model that is not listed costs `unknown`.
    pub prices: BTreeMap<String, Price>,
}

/// How tasks are asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GenerationSettings {
    /// Answers per task: the first and its repairs.
    pub max_rounds: u32,
    /// Tasks asked for at the same time; also the limit of open requests.
    pub workers: usize,
    /// Smallest number of objects in a scene.
    pub min_objects: usize,
    /// Which objects are offered.
    pub sampling: SamplingSettings,
    /// Folder with prompt files that replace the built-in ones; none for the built-in ones.
    pub prompts: Option<PathBuf>,
    /// Longest answer that is quoted back for repair, bytes; of a longer one the beginning.
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
    /// Reads and checks a TOML text.
    ///
    /// # Errors
    /// Names the line or the field; never shows values, since someone may have written a key there.
    pub fn from_toml(text: &str) -> Result<Self, SettingsError> {
        let settings: Self = from_toml(text)?;
        settings.check()?;
        Ok(settings)
    }

    /// Checks what the types do not say.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
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
