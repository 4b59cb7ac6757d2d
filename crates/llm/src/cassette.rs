//! Cassettes: recorded exchanges, looked up by request content.
//!
//! One readable JSON file per exchange: `<first 24 digits of the key>.json`. A cassette contains request and reply,
//! with format, size and hash of images; addresses, headers and keys are never stored.

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

/// Maximum number of cassettes compared with an unrecorded request, to name the most similar one in the error.
const MAX_COMPARED: usize = 2_000;

/// Settings of recording and replay.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CassetteSettings {
    /// Use of server and cassettes.
    pub mode: CassetteMode,
    /// Folder of cassettes, one JSON file per exchange.
    pub folder: PathBuf,
    /// Comment written into each new cassette: who answered and why it was recorded.
    pub note: String,
}

impl Default for CassetteSettings {
    fn default() -> Self {
        Self { mode: CassetteMode::Live, folder: "cassettes".into(), note: String::new() }
    }
}

/// Use of server and cassettes for requests.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CassetteMode {
    /// Send the request; cassettes are neither read nor written.
    #[default]
    Live,
    /// Use a cassette if there is one, otherwise send and record. An interrupted recording continues; delete the folder
    /// to start over.
    Record,
    /// Use cassettes only; a request without one is an error, and nothing is ever sent.
    Replay,
}

/// Recorded exchange: one request with its reply.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cassette {
    /// Content hash of the request, see [`ChatRequest::key`].
    pub key: String,
    /// Comment: who answered and why it was recorded.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// Request, with hashes instead of images.
    pub request: RecordedRequest,
    /// Reply of the server.
    pub reply: ChatReply,
}

impl Document for Cassette {
    const SCHEMA: &'static str = "genmanip.cassette/1";
}

/// A chat model with a folder of cassettes.
#[derive(Debug)]
pub struct CassetteChat<M> {
    model: Option<M>,
    settings: CassetteSettings,
    key: Option<ApiKey>,
}

impl CassetteChat<HttpChat> {
    /// Opens the configured server with its cassettes; replay needs neither a key nor a server. `jitter` seeds the
    /// retry waits.
    ///
    /// # Errors
    /// Names the invalid setting, or the variable without a valid key.
    pub fn open(server: &ServerSettings, cassettes: &CassetteSettings, jitter: Seed) -> Result<Self, SettingsError> {
        Self::open_around(server, cassettes, jitter, |server| server)
    }
}

impl<M: ChatModel> CassetteChat<M> {
    /// Like [`CassetteChat::open`] with a wrapper around the server, which sees only requests that are really sent.
    ///
    /// # Errors
    /// As [`CassetteChat::open`].
    pub fn open_around(
        server: &ServerSettings,
        cassettes: &CassetteSettings,
        jitter: Seed,
        wrap: impl FnOnce(HttpChat) -> M,
    ) -> Result<Self, SettingsError> {
        server.check()?;
        let cassettes = cassettes.clone();
        if cassettes.mode == CassetteMode::Replay {
            return Ok(Self::replay(cassettes));
        }
        let key = server.api_key_env.as_deref().map(ApiKey::from_environment).transpose()?;
        let model = wrap(HttpChat::new(server.clone(), key.clone(), jitter)?);
        Ok(Self::new(model, cassettes, key))
    }

    /// A model with cassettes; `model` is asked in the modes live and record only. Exchanges that contain `key` are
    /// never recorded.
    pub fn new(model: M, settings: CassetteSettings, key: Option<ApiKey>) -> Self {
        Self { model: Some(model), settings, key }
    }

    /// Replays recorded exchanges only, regardless of the mode.
    pub fn replay(settings: CassetteSettings) -> Self {
        let settings = CassetteSettings { mode: CassetteMode::Replay, ..settings };
        Self { model: None, settings, key: None }
    }

    fn record(&self, key: String, request: RecordedRequest, reply: &ChatReply) -> Result<(), ChatError> {
        let path = path_of(&self.settings.folder, &key);
        let note = self.settings.note.clone();
        let text = Cassette { key, note, request, reply: reply.clone() }.to_json();
        if self.key.as_ref().is_some_and(|secret| secret.occurs_in(&text)) {
            return Err(cassette_error("the exchange contains the API key, so it is not recorded", &path));
        }
        write_atomically(&path, &text)
            .map_err(|error| cassette_error(&format!("cannot write the cassette: {error}"), &path))
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
                    Err(cassette_error("the cassette belongs to another request", &path))
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

/// Reads a cassette and checks that its key matches its request.
///
/// # Errors
/// Fails with [`ChatError::Cassette`] if the file is invalid.
pub fn read(path: &Path) -> Result<Cassette, ChatError> {
    let cassette = Cassette::from_json(&read_text(path)?).map_err(|error| cassette_error(&error.to_string(), path))?;
    let key = cassette.request.key();
    if cassette.key != key {
        return Err(cassette_error(&format!("the request was edited: its key is now {key}"), path));
    }
    Ok(cassette)
}

/// Reads the text of a cassette.
pub(crate) fn read_text(path: &Path) -> Result<String, ChatError> {
    files::read_text(path, limits::CASSETTE).map_err(|message| cassette_error(&message, path))
}

/// Requests of all readable cassettes of a folder with their file names, at most [`MAX_COMPARED`].
fn all_in(folder: &Path) -> Vec<(String, RecordedRequest)> {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder)
        .map(|entries| entries.filter_map(|entry| Some(entry.ok()?.path())).collect())
        .unwrap_or_default();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
    paths.sort();
    paths.truncate(MAX_COMPARED);
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    paths.iter().filter_map(|path| Some((name(path)?, read(path).ok()?.request))).collect()
}

pub(crate) fn path_of(folder: &Path, key: &str) -> PathBuf {
    folder.join(format!("{}.json", key.get(..24).unwrap_or(key)))
}

/// Writes a temporary file, flushes and renames it, so that a partial cassette is never found.
pub(crate) fn write_atomically(path: &Path, text: &str) -> std::io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let temporary = path.with_extension(format!("{}-{:?}.tmp", std::process::id(), std::thread::current().id()));
    let written = fs::File::create(&temporary).and_then(|mut file| {
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&temporary, path)
    });
    if written.is_err() {
        let _ = fs::remove_file(&temporary);
    }
    written
}

fn cassette_error(message: &str, path: &Path) -> ChatError {
    ChatError::Cassette { message: message.into(), path: path.display().to_string() }
}
