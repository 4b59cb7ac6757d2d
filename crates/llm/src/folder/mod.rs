//! A folder as chat model: a person, a script or another program reads questions and writes answers.
//!
//! Each question is a folder `NNN` with `question.json` and its images; the client waits for `answer.json` beside them.
//! Nothing in it tells which run or task asked. A repeated question is not written again: its existing answer is read
//! or awaited.

mod answering;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use genmanip_core::Document;
use genmanip_core::limits::{self, Limit};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{ChatError, SettingsError};
use crate::files;
use crate::message::{MediaType, Part, Role};
use crate::model::ChatModel;
use crate::recorded::RecordedText;
use crate::reply::{ChatReply, Structure};
use crate::request::{ChatRequest, ReplySchema};

pub use answering::{Answered, AnsweringError, FolderAnswers, QuestionRow};

/// Settings of a question folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FolderSettings {
    /// Folder of questions and answers.
    pub folder: PathBuf,
    /// Timeout for an answer (s); the question remains, and the next run finds its answer.
    pub timeout_s: f64,
    /// Polling interval (s).
    pub poll_s: f64,
    /// Time for which a file that is not JSON must stay unchanged to count as a complete text answer (s).
    pub settle_s: f64,
    /// Maximum answer size (bytes).
    pub max_answer_bytes: u64,
}

impl Default for FolderSettings {
    fn default() -> Self {
        Self {
            folder: "questions".into(),
            timeout_s: 3600.0,         // a person has time for lunch
            poll_s: 0.2,               // soon enough for a script
            settle_s: 2.0,             // editors write a small file at once
            max_answer_bytes: 8 << 20, // twice `ServerSettings::max_body_bytes`
        }
    }
}

impl FolderSettings {
    /// Validates the settings.
    ///
    /// # Errors
    /// Names the first invalid field, as in a file with these settings in the table `folder`.
    pub fn check(&self) -> Result<(), SettingsError> {
        let seconds =
            [("folder.timeout_s", self.timeout_s), ("folder.poll_s", self.poll_s), ("folder.settle_s", self.settle_s)];
        for (field, seconds) in seconds {
            if !(seconds > 0.0 && seconds <= 604_800.0) {
                let expected = "seconds, more than 0 and at most a week".into();
                return Err(SettingsError::Invalid { field, expected });
            }
        }
        if self.max_answer_bytes == 0 {
            return Err(SettingsError::Invalid { field: "folder.max_answer_bytes", expected: "1 or more".into() });
        }
        Ok(())
    }
}

/// A question file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FolderQuestion {
    /// Content hash of the request, see [`ChatRequest::key`]: equal requests have equal ids, no matter which run asks.
    pub id: String,
    /// Instructions for people.
    pub how_to_answer: String,
    /// The conversation, oldest first.
    pub messages: Vec<FolderMessage>,
    /// Schema of the answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reply_schema: Option<ReplySchema>,
}

impl Document for FolderQuestion {
    const SCHEMA: &'static str = "genmanip.question/1";
}

/// A message of a question.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FolderMessage {
    /// Sender.
    pub role: Role,
    /// Parts, in order.
    pub parts: Vec<FolderPart>,
}

/// A part of a message.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FolderPart {
    /// A text.
    Text(RecordedText),
    /// File name of an image in the same folder.
    Image(String),
}

/// A chat model answered through a folder.
///
/// Several threads and programs may use it at once; one program never writes the same question twice.
#[derive(Debug)]
pub struct FolderChat {
    settings: FolderSettings,
    /// Known questions; locked while one is looked up or written.
    known: Mutex<Known>,
}

#[derive(Debug, Default)]
struct Known {
    places: BTreeMap<String, PathBuf>,
    /// Highest number scanned.
    last: u32,
}

const QUESTION: &str = "question.json";
const ANSWER: &str = "answer.json";
const HOW_TO_ANSWER: &str = "Write answer.json beside this file: JSON as the schema below says or, without one, a JSON \
                             string with your words.";

impl FolderChat {
    /// Creates a model; the folder is created with the first question.
    ///
    /// # Errors
    /// Names the invalid setting.
    pub fn new(settings: FolderSettings) -> Result<Self, SettingsError> {
        settings.check()?;
        Ok(Self { settings, known: Mutex::default() })
    }

    /// Folder of a question, written if new.
    fn place(&self, request: &ChatRequest) -> Result<PathBuf, ChatError> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = &self.settings.folder;
        let cannot = |error: std::io::Error| folder_error(&format!("cannot write the question: {error}"), folder);
        fs::create_dir_all(folder).map_err(cannot)?;
        let last = known.last;
        for number in numbers(folder).map_err(cannot)?.into_iter().filter(|number| *number > last) {
            let place = folder.join(name_of(number));
            if let Some(id) = id_of(&place) {
                known.places.entry(id).or_insert(place);
            }
            known.last = number;
        }
        let id = request.key();
        if let Some(place) = known.places.get(&id).filter(|place| place.exists()) {
            return Ok(place.clone());
        }
        let last = known.last;
        let temporary = folder.join(format!(".{}-{}.tmp", std::process::id(), &id[..24]));
        let _ = fs::remove_dir_all(&temporary);
        write(&temporary, &id, request).map_err(cannot)?;
        // Another program may have taken the number meanwhile; existing folders are never replaced.
        for number in last + 1..last + 1000 {
            let place = folder.join(name_of(number));
            if !place.exists() && fs::rename(&temporary, &place).is_ok() {
                return Ok(place);
            }
        }
        let _ = fs::remove_dir_all(&temporary);
        Err(folder_error("no number is free for the question", folder))
    }

    fn wait(&self, place: &Path) -> Result<String, ChatError> {
        let path = place.join(ANSWER);
        let begin = Instant::now();
        let mut seen: Option<(Vec<u8>, Instant)> = None;
        loop {
            if let Some(bytes) = self.read(&path)? {
                if let Some(text) = answer_of(&bytes) {
                    return Ok(text);
                }
                match &seen {
                    Some((before, since)) if *before == bytes => {
                        let words = String::from_utf8_lossy(&bytes);
                        if since.elapsed().as_secs_f64() >= self.settings.settle_s && !words.trim().is_empty() {
                            return Ok(words.into_owned());
                        }
                    }
                    _ => seen = Some((bytes, Instant::now())),
                }
            }
            if begin.elapsed().as_secs_f64() >= self.settings.timeout_s {
                let (path, limit_s) = (path.display().to_string(), self.settings.timeout_s);
                return Err(ChatError::Unanswered { path, limit_s });
            }
            std::thread::sleep(Duration::from_secs_f64(self.settings.poll_s.min(self.settings.timeout_s)));
        }
    }

    /// Reads the current content of the answer; `None` if there is none.
    fn read(&self, path: &Path) -> Result<Option<Vec<u8>>, ChatError> {
        if matches!(fs::metadata(path), Err(error) if error.kind() == std::io::ErrorKind::NotFound) {
            return Ok(None);
        }
        let limit = Limit { what: "an answer", bytes: self.settings.max_answer_bytes };
        let bytes = files::read(path, limit);
        let bytes = bytes.map_err(|message| folder_error(&format!("cannot read the answer: {message}"), path))?;
        Ok(Some(bytes))
    }
}

impl ChatModel for FolderChat {
    /// Writes the question if new, and waits for its answer.
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        let place = self.place(request)?;
        let text = self.wait(&place)?;
        if text.trim().is_empty() {
            return Err(ChatError::NoText { finish_reason: "an empty string".into() });
        }
        let (model, structure) = ("folder".into(), Structure::Plain);
        Ok(ChatReply { text, model, finish_reason: None, usage: None, structure, attempts: 0 })
    }
}

/// Parses a complete JSON answer: the content of a string, otherwise the JSON text; `None` if it is not JSON.
fn answer_of(bytes: &[u8]) -> Option<String> {
    match serde_json::from_slice(bytes).ok()? {
        Value::String(words) => Some(words),
        _ => Some(String::from_utf8_lossy(bytes).trim().to_owned()),
    }
}

/// Writes a question with its images into a folder.
fn write(place: &Path, id: &str, request: &ChatRequest) -> std::io::Result<()> {
    fs::create_dir_all(place)?;
    let mut images = 0;
    let mut messages = Vec::new();
    for message in &request.messages {
        let mut parts = Vec::new();
        for part in &message.parts {
            parts.push(match part {
                Part::Text(text) => FolderPart::Text(RecordedText(text.clone())),
                Part::Image(image) => {
                    images += 1;
                    let extension = if image.media_type() == MediaType::Png { "png" } else { "jpg" };
                    let name = format!("picture_{images}.{extension}");
                    write_flushed(&place.join(&name), image.bytes())?;
                    FolderPart::Image(name)
                }
            });
        }
        messages.push(FolderMessage { role: message.role, parts });
    }
    let (id, how_to_answer, reply_schema) = (id.to_owned(), HOW_TO_ANSWER.into(), request.reply_schema.clone());
    let question = FolderQuestion { id, how_to_answer, messages, reply_schema };
    write_flushed(&place.join(QUESTION), question.to_json().as_bytes())
}

/// Writes and flushes a file; the folder is renamed afterwards.
fn write_flushed(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    use std::io::Write;
    let mut file = fs::File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Numbers of existing questions, ascending.
fn numbers(folder: &Path) -> std::io::Result<Vec<u32>> {
    let mut numbers = Vec::new();
    for entry in fs::read_dir(folder)? {
        let name = entry?.file_name();
        numbers.extend(name.to_str().filter(|name| name.len() >= 3).and_then(|name| name.parse::<u32>().ok()));
    }
    numbers.sort_unstable();
    Ok(numbers)
}

fn name_of(number: u32) -> String {
    format!("{number:03}")
}

/// Id of the question in a folder, without building its other fields; `None` if it cannot be read.
fn id_of(place: &Path) -> Option<String> {
    #[derive(Deserialize)]
    struct Id {
        id: String,
    }
    let text = files::read_text(&place.join(QUESTION), limits::CASSETTE).ok()?;
    serde_json::from_str(&text).ok().map(|question: Id| question.id)
}

fn folder_error(message: &str, path: &Path) -> ChatError {
    ChatError::Folder { message: message.into(), path: path.display().to_string() }
}
