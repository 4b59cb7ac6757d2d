//! Recorded exchanges, found again by the content of the request.
//!
//! One JSON file per exchange, made to be read: `<first 24 digits of the key>.json`.
//! A cassette holds what was asked and what was answered, of an image its format, size and hash; addresses, headers
//! and keys are never part of it.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use genmanip_core::{Document, Seed, limits};
use serde::{Deserialize, Serialize};

use crate::error::{ChatError, SettingsError};
use crate::files;
use crate::http::HttpChat;
use crate::model::ChatModel;
use crate::nearest::nearest;
use crate::reply::ChatReply;
use crate::request::{ChatRequest, RecordedRequest};
use crate::secret::ApiKey;
use crate::settings::ServerSettings;

/// Most cassettes that are compared with a request that has none.
const MAX_COMPARED: usize = 2_000;

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

/// What to do with a request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CassetteMode {
    /// Ask; cassettes are neither read nor written.
    #[default]
    Live,
    /// Answer from the cassette if there is one; otherwise ask and record. An interrupted recording goes on
    /// where it stopped; delete the folder to record afresh.
    Record,
    /// Answer from the cassette; a request without one is an error, and nothing is ever asked.
    Replay,
}

/// One recorded exchange.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cassette {
    /// Content hash of the request, see [`ChatRequest::key`].
    pub key: String,
    /// Who answered, and why it was recorded; for people.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// What was asked.
    pub request: RecordedRequest,
    /// What was answered.
    pub reply: ChatReply,
}

impl Document for Cassette {
    const SCHEMA: &'static str = "genmanip.cassette/1";
}

/// A model with a folder of cassettes before it.
#[derive(Debug)]
pub struct CassetteChat<M> {
    model: Option<M>,
    settings: CassetteSettings,
    key: Option<ApiKey>,
}

impl CassetteChat<HttpChat> {
    /// The server of the settings with its cassettes; replaying needs neither a key nor a server.
    /// `jitter` spreads the waits between retries.
    ///
    /// # Errors
    /// Names the setting that makes no sense, or the variable that holds no key.
    pub fn open(server: &ServerSettings, cassettes: &CassetteSettings, jitter: Seed) -> Result<Self, SettingsError> {
        Self::open_around(server, cassettes, jitter, |server| server)
    }
}

impl<M: ChatModel> CassetteChat<M> {
    /// As [`CassetteChat::open`], with something between the cassettes and the server: only what is really asked passes
    /// it.
    ///
    /// # Errors
    /// As [`CassetteChat::open`].
    pub fn open_around(
        server: &ServerSettings,
        cassettes: &CassetteSettings,
        jitter: Seed,
        around: impl FnOnce(HttpChat) -> M,
    ) -> Result<Self, SettingsError> {
        server.check()?;
        let cassettes = cassettes.clone();
        if cassettes.mode == CassetteMode::Replay {
            return Ok(Self::replay(cassettes));
        }
        let key = server.api_key_env.as_deref().map(ApiKey::from_environment).transpose()?;
        let model = around(HttpChat::new(server.clone(), key.clone(), jitter)?);
        Ok(Self::new(model, cassettes, key))
    }

    /// `model` is asked in the modes live and record. `key` is what must never get into a file.
    pub fn new(model: M, settings: CassetteSettings, key: Option<ApiKey>) -> Self {
        Self { model: Some(model), settings, key }
    }

    /// Only what is recorded, whatever the mode says.
    pub fn replay(settings: CassetteSettings) -> Self {
        let settings = CassetteSettings { mode: CassetteMode::Replay, ..settings };
        Self { model: None, settings, key: None }
    }

    fn record(&self, key: String, request: RecordedRequest, reply: &ChatReply) -> Result<(), ChatError> {
        let path = path_of(&self.settings.folder, &key);
        let note = self.settings.note.clone();
        let text = Cassette { key, note, request, reply: reply.clone() }.to_json();
        if self.key.as_ref().is_some_and(|secret| secret.is_in(&text)) {
            return Err(failed("the exchange holds the API key, so it is not recorded", &path));
        }
        write_whole(&path, &text).map_err(|error| failed(&format!("cannot write the cassette: {error}"), &path))
    }
}

impl<M: ChatModel> ChatModel for CassetteChat<M> {
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        let model = match (&self.model, self.settings.mode) {
            (Some(model), CassetteMode::Live) => return model.chat(request),
            (Some(model), CassetteMode::Record) => Some(model),
            _ => None,
        };
        let recorded = RecordedRequest::from(request);
        let key = recorded.key();
        let path = path_of(&self.settings.folder, &key);
        match (path.exists(), model) {
            (true, _) => {
                let cassette = read(&path)?;
                if cassette.key == key {
                    Ok(cassette.reply)
                } else {
                    Err(failed("the cassette is of another request", &path))
                }
            }
            (false, Some(model)) => {
                let reply = model.chat(request)?;
                self.record(key, recorded, &reply)?;
                Ok(reply)
            }
            (false, None) => Err(ChatError::CassetteMiss {
                nearest: nearest(&recorded, &all_in(&self.settings.folder)),
                folder: self.settings.folder.display().to_string(),
                key,
            }),
        }
    }
}

/// Reads a cassette and checks that its key is that of its request.
///
/// # Errors
/// [`ChatError::Cassette`] says what is wrong with the file.
pub fn read(path: &Path) -> Result<Cassette, ChatError> {
    let cassette = Cassette::from_json(&read_text(path)?).map_err(|error| failed(&error.to_string(), path))?;
    let key = cassette.request.key();
    if cassette.key != key {
        return Err(failed(&format!("the question was changed: its key is now {key}"), path));
    }
    Ok(cassette)
}

/// The text of a cassette.
pub(crate) fn read_text(path: &Path) -> Result<String, ChatError> {
    files::read_text(path, limits::CASSETTE).map_err(|message| failed(&message, path))
}

/// The requests of all readable cassettes of a folder by file name, a bounded number.
fn all_in(folder: &Path) -> Vec<(String, RecordedRequest)> {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder)
        .map(|entries| entries.filter_map(|entry| Some(entry.ok()?.path())).collect())
        .unwrap_or_default();
    paths.retain(|path| path.extension().is_some_and(|ending| ending == "json"));
    paths.sort();
    paths.truncate(MAX_COMPARED);
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    paths.iter().filter_map(|path| Some((name(path)?, read(path).ok()?.request))).collect()
}

pub(crate) fn path_of(folder: &Path, key: &str) -> PathBuf {
    folder.join(format!("{}.json", key.get(..24).unwrap_or(key)))
}

/// Written aside, flushed and renamed: a partial cassette is never found.
pub(crate) fn write_whole(path: &Path, text: &str) -> std::io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let aside = path.with_extension(format!("{}-{:?}.tmp", std::process::id(), std::thread::current().id()));
    let written = fs::File::create(&aside).and_then(|mut file| {
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&aside, path)
    });
    if written.is_err() {
        let _ = fs::remove_file(&aside);
    }
    written
}

fn failed(message: &str, path: &Path) -> ChatError {
    ChatError::Cassette { message: message.into(), path: path.display().to_string() }
}
