//! Everything that can be chosen, on one screen; written by people as TOML.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::{CassetteMode, Price, SamplingSettings, SettingsError, Structure};

/// Settings of the language-model designer. They name the variable that holds the key, never the key.
///
/// ```
/// use genmanip_llm::LlmSettings;
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
    /// Recording and replaying.
    pub cassettes: CassetteSettings,
    /// How tasks are asked for.
    pub generation: GenerationSettings,
    /// What tokens cost, by model name; a model that is not listed costs `unknown`.
    pub prices: BTreeMap<String, Price>,
}

/// The server and how patient to be with it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServerSettings {
    /// Address up to `/chat/completions`; user, password and query are refused, because addresses appear in errors.
    pub base_url: String,
    /// Model name as the server knows it.
    pub model: String,
    /// Environment variable that holds the API key; none for servers that want no key.
    pub api_key_env: Option<String>,
    /// Whether the key may travel unencrypted to another machine. (To this machine it always may.)
    pub allow_key_over_http: bool,
    /// Limit for making a connection, seconds.
    pub connect_timeout_s: f64,
    /// Limit for one whole request, connection included, seconds.
    pub total_timeout_s: f64,
    /// Largest answer that is read, bytes.
    pub max_body_bytes: u64,
    /// Further requests after the first, when it was refused for the moment (408, 429, 5xx), timed out or was cut off.
    pub max_retries: u32,
    /// Wait before the first retry, seconds; doubles each time, and is shortened by up to a half at random.
    pub first_backoff_s: f64,
    /// Longest such wait, seconds.
    pub max_backoff_s: f64,
    /// Longest wait that a server may ask for (`Retry-After`), seconds; asked for more, the client gives up.
    pub max_retry_after_s: f64,
    /// Strictest form of structured output to try; looser ones follow when the server refuses it.
    pub structure: Structure,
    /// Further fields of the request body, sent as they are, e.g. `temperature`, `max_tokens`, `seed`.
    pub parameters: Map<String, Value>,
}

impl Default for ServerSettings {
    fn default() -> Self {
        Self {
            base_url: "http://127.0.0.1:8080/v1".into(), // llama.cpp's server as it starts
            model: "default".into(),                     // servers with one model ignore the name
            api_key_env: None,                           // local servers want none
            allow_key_over_http: false,                  // a mistyped address must not publish a key
            connect_timeout_s: 10.0,                     // a far server answers within one
            total_timeout_s: 180.0,                      // a thinking model takes a minute or two
            max_body_bytes: 4 << 20,                     // four times the largest answer that is judged
            max_retries: 4,                              // 1 + 2 + 4 + 8 s: outlasts a short overload
            first_backoff_s: 1.0,
            max_backoff_s: 30.0,
            max_retry_after_s: 60.0, // limits per minute are common, limits per day not worth waiting for
            structure: Structure::JsonSchema, // falls back by itself
            parameters: Map::new(),  // some models refuse any; the server's defaults are sensible
        }
    }
}

/// Recording and replaying.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CassetteSettings {
    /// Whether to ask the server, to record it, or to do without it.
    pub mode: CassetteMode,
    /// Where cassettes are, one JSON file per exchange.
    pub folder: PathBuf,
    /// Written into each new cassette: who answered, and why it was recorded.
    pub note: String,
}

impl Default for CassetteSettings {
    fn default() -> Self {
        Self { mode: CassetteMode::Live, folder: "cassettes".into(), note: String::new() }
    }
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
        let settings: Self = toml::from_str(text).map_err(|error| {
            let start = error.span().map_or(0, |span| span.start);
            let line = text.get(..start).map_or(1, |before| before.matches('\n').count() + 1);
            SettingsError::NotSettings { line, message: without_values(error.message()) }
        })?;
        settings.check()?;
        Ok(settings)
    }

    /// Checks what the types do not say.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), SettingsError> {
        self.server.check()?;
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
        for price in self.prices.values() {
            if !(price.input_per_million >= 0.0 && price.output_per_million >= 0.0) {
                return invalid("prices", "prices of 0 or more");
            }
        }
        Ok(())
    }
}

impl ServerSettings {
    pub(crate) fn check(&self) -> Result<(), SettingsError> {
        let invalid = |field, expected: &str| Err(SettingsError::Invalid { field, expected: expected.into() });
        let Some((scheme, rest)) = self.base_url.split_once("://") else {
            return invalid("server.base_url", "an address that begins with http:// or https://");
        };
        let https = scheme == "https";
        if !https && scheme != "http" {
            return invalid("server.base_url", "an address that begins with http:// or https://");
        }
        if https && !cfg!(feature = "https") {
            return invalid("server.base_url", "http://, because this program was built without the feature `https`");
        }
        if rest.is_empty() || rest.contains(['@', '?', '#']) || rest.contains(char::is_whitespace) {
            return invalid("server.base_url", "host and path only: no user, password, query or space");
        }
        if let Some(variable) = &self.api_key_env {
            let usual = |byte: u8| byte.is_ascii_uppercase() || byte.is_ascii_digit() || byte == b'_';
            if variable.is_empty() || variable.len() > 64 || !variable.bytes().all(usual) {
                return invalid("server.api_key_env", "the name of a variable (A-Z, 0-9, _), not the key itself");
            }
            if !https && !self.is_loopback() && !self.allow_key_over_http {
                return invalid("server.base_url", "https:// (or `allow_key_over_http = true`), since a key is sent");
            }
        }
        let positive = [
            ("server.connect_timeout_s", self.connect_timeout_s),
            ("server.total_timeout_s", self.total_timeout_s),
            ("server.first_backoff_s", self.first_backoff_s),
            ("server.max_backoff_s", self.max_backoff_s),
        ];
        for (field, seconds) in positive {
            if !(seconds > 0.0 && seconds <= 86_400.0) {
                return invalid(field, "seconds, more than 0 and at most a day");
            }
        }
        if !(0.0..=86_400.0).contains(&self.max_retry_after_s) {
            return invalid("server.max_retry_after_s", "seconds, from 0 to a day");
        }
        if !(1..=1 << 30).contains(&self.max_body_bytes) {
            return invalid("server.max_body_bytes", "1 to 1073741824");
        }
        if self.max_retries > 20 {
            return invalid("server.max_retries", "0 to 20");
        }
        let reserved = ["model", "messages", "response_format", "stream", "n"];
        if reserved.iter().any(|name| self.parameters.contains_key(*name)) {
            return invalid("server.parameters", "fields other than model, messages, response_format, stream and n");
        }
        Ok(())
    }

    /// Whether the server is on this machine.
    pub(crate) fn is_loopback(&self) -> bool {
        let authority = self.base_url.split("://").nth(1).unwrap_or_default().split('/').next().unwrap_or_default();
        let host = match authority.strip_prefix('[') {
            Some(rest) => rest.split(']').next().unwrap_or_default(),
            None => authority.split(':').next().unwrap_or_default(),
        };
        host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
    }
}

/// The parser's message without what was written: it quotes values (`string "…"`) and wrong choices (`` variant `…` ``).
fn without_values(message: &str) -> String {
    let line = message.lines().next().unwrap_or_default();
    let hidden = |before: &str, quote: char| {
        let (start, rest) = line.split_once(before)?;
        let (_, end) = rest.rsplit_once(quote).filter(|_| quote == '"').or_else(|| rest.split_once(quote))?;
        Some(format!("{start}(value hidden){end}"))
    };
    hidden("\"", '"').or_else(|| hidden("variant `", '`')).unwrap_or_else(|| line.to_owned())
}
