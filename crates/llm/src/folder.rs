//! A folder as the model: whoever reads the questions and writes the answers, a person, a script or another program.
//!
//! Each question is a folder `NNN` with `question.json` and its pictures; `answer.json` beside them is awaited.
//! Nothing in it tells where the question comes from, so that whoever answers knows the question alone.
//! A question that was asked before is not asked again: its answer is read, or waited for, where it is.

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

/// How answers are awaited.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FolderSettings {
    /// Where questions are written and answers are looked for.
    pub folder: PathBuf,
    /// How long an answer is waited for, seconds; the question stays, and the next start finds its answer.
    pub timeout_s: f64,
    /// How often is looked for an answer, seconds.
    pub poll_s: f64,
    /// How long a file that is no JSON must not have grown before it counts as an answer in words, seconds.
    pub settle_s: f64,
    /// Largest answer that is read, bytes.
    pub max_answer_bytes: u64,
}

impl Default for FolderSettings {
    fn default() -> Self {
        Self {
            folder: "questions".into(),
            timeout_s: 3600.0,         // a person has time for lunch
            poll_s: 0.2,               // soon enough for a script
            settle_s: 2.0,             // editors write a small file at once
            max_answer_bytes: 8 << 20, // as from servers
        }
    }
}

impl FolderSettings {
    /// Checks what the types do not say.
    ///
    /// # Errors
    /// Names the first field that makes no sense, as in a file where these settings are the table `folder`.
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

/// A question as it is written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FolderQuestion {
    /// Content hash of the request, see [`ChatRequest::key`]; says nothing about where it comes from.
    pub id: String,
    /// What to do, for people.
    pub how_to_answer: String,
    /// The conversation, oldest first.
    pub messages: Vec<FolderMessage>,
    /// Shape that the answer shall have.
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
    /// Who speaks.
    pub role: Role,
    /// What is said and shown, in this order.
    pub parts: Vec<FolderPart>,
}

/// A piece of a message.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FolderPart {
    /// Words.
    Text(RecordedText),
    /// File name of a picture in the same folder.
    Image(String),
}

/// A model that is whoever answers in a folder.
///
/// Several threads and programs may ask at once: what is being asked already is not asked twice by one program.
#[derive(Debug)]
pub struct FolderChat {
    settings: FolderSettings,
    /// The questions that are known to be there; held while one is looked up or written.
    known: Mutex<Known>,
}

#[derive(Debug, Default)]
struct Known {
    places: BTreeMap<String, PathBuf>,
    /// Highest number that was looked at.
    last: u32,
}

const QUESTION: &str = "question.json";
const ANSWER: &str = "answer.json";
const HOW_TO_ANSWER: &str = "Write answer.json beside this file: JSON as the schema below says or, without one, a JSON \
                             string with your words.";

impl FolderChat {
    /// A model in a folder, which is made with the first question.
    ///
    /// # Errors
    /// Names the setting that makes no sense.
    pub fn new(settings: FolderSettings) -> Result<Self, SettingsError> {
        settings.check()?;
        Ok(Self { settings, known: Mutex::default() })
    }

    /// The folder of the question; written if it was never asked.
    fn place(&self, request: &ChatRequest) -> Result<PathBuf, ChatError> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = &self.settings.folder;
        let cannot = |error: std::io::Error| failed(&format!("cannot write the question: {error}"), folder);
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
        let aside = folder.join(format!(".{}-{}.tmp", std::process::id(), &id[..24]));
        let _ = fs::remove_dir_all(&aside);
        write(&aside, &id, request).map_err(cannot)?;
        // Another program may have taken the number meanwhile: a folder that is there is never replaced.
        for number in last + 1..last + 1000 {
            let place = folder.join(name_of(number));
            if !place.exists() && fs::rename(&aside, &place).is_ok() {
                return Ok(place);
            }
        }
        let _ = fs::remove_dir_all(&aside);
        Err(failed("no number is free for the question", folder))
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

    /// The answer as far as it is written; `None` while there is none.
    fn read(&self, path: &Path) -> Result<Option<Vec<u8>>, ChatError> {
        if matches!(fs::metadata(path), Err(error) if error.kind() == std::io::ErrorKind::NotFound) {
            return Ok(None);
        }
        let limit = Limit { what: "an answer", bytes: self.settings.max_answer_bytes };
        let bytes = files::read(path, limit);
        let bytes = bytes.map_err(|message| failed(&format!("cannot read the answer: {message}"), path))?;
        Ok(Some(bytes))
    }
}

impl ChatModel for FolderChat {
    /// Writes the question, if it was never asked, and waits for its answer.
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

/// The answer in whole JSON: of a string its words, of anything else the text; `None` for what is no JSON.
fn answer_of(bytes: &[u8]) -> Option<String> {
    match serde_json::from_slice(bytes).ok()? {
        Value::String(words) => Some(words),
        _ => Some(String::from_utf8_lossy(bytes).trim().to_owned()),
    }
}

/// Writes a question with its pictures into a folder of its own.
fn write(place: &Path, id: &str, request: &ChatRequest) -> std::io::Result<()> {
    fs::create_dir_all(place)?;
    let mut pictures = 0;
    let mut messages = Vec::new();
    for message in &request.messages {
        let mut parts = Vec::new();
        for part in &message.parts {
            parts.push(match part {
                Part::Text(text) => FolderPart::Text(RecordedText(text.clone())),
                Part::Image(image) => {
                    pictures += 1;
                    let ending = if image.media_type() == MediaType::Png { "png" } else { "jpg" };
                    let name = format!("picture_{pictures}.{ending}");
                    whole(&place.join(&name), image.bytes())?;
                    FolderPart::Image(name)
                }
            });
        }
        messages.push(FolderMessage { role: message.role, parts });
    }
    let (id, how_to_answer, reply_schema) = (id.to_owned(), HOW_TO_ANSWER.into(), request.reply_schema.clone());
    let question = FolderQuestion { id, how_to_answer, messages, reply_schema };
    whole(&place.join(QUESTION), question.to_json().as_bytes())
}

/// Written and flushed; the folder is renamed afterwards.
fn whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    use std::io::Write;
    let mut file = fs::File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Numbers of the questions that are there, in order.
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

/// Only the id is read: a question may be large.
fn id_of(place: &Path) -> Option<String> {
    #[derive(Deserialize)]
    struct Id {
        id: String,
    }
    let text = files::read_text(&place.join(QUESTION), limits::CASSETTE).ok()?;
    serde_json::from_str(&text).ok().map(|question: Id| question.id)
}

fn failed(message: &str, path: &Path) -> ChatError {
    ChatError::Folder { message: message.into(), path: path.display().to_string() }
}
