//! The side of those who answer: open questions of a folder, and answers written into it.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use genmanip_core::Document;
use genmanip_core::limits::{self, Limit};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{ANSWER, FolderPart, FolderQuestion, QUESTION, name_of, numbers, write_flushed};
use crate::files;

/// File beside an answer that says who gave it.
const ANSWERED: &str = "answered.json";

const IMAGE: Limit = Limit { what: "an image of a question", bytes: 32 << 20 };

/// The questions of a folder, to be answered by a person or a program.
#[derive(Debug)]
pub struct FolderAnswers {
    folder: PathBuf,
    /// Held while an answer is written.
    answering: Mutex<()>,
    /// Durations that were read from [`ANSWERED`] files, by name of the question: a list is asked for every few seconds.
    read: Mutex<BTreeMap<String, Read>>,
}

/// Content of an [`ANSWERED`] file with the time and length that the file had when it was read.
#[derive(Debug)]
struct Read {
    stamp: (Option<SystemTime>, u64),
    /// Time that the answer took, s; `None` for a damaged file.
    duration_s: Option<f64>,
}

/// A question in a list.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct QuestionRow {
    /// Name of its folder, e.g. `003`.
    pub name: String,
    /// True if an answer is there.
    pub is_answered: bool,
    /// Time that the answer took, s; `None` if nobody said so.
    pub duration_s: Option<f64>,
}

/// Author of an answer, and the time it took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answered {
    /// Name of the author.
    pub author: String,
    /// Response time: time for which the question was displayed until it was answered, s.
    pub duration_s: f64,
    /// Time of the answer, RFC 3339.
    pub at: String,
}

impl Document for Answered {
    const SCHEMA: &'static str = "genmanip.answered/1";
}

/// Error of a question or answer.
#[derive(Debug, thiserror::Error)]
pub enum AnsweringError {
    /// No such question, or no such image in it.
    #[error("no {what} in the folder of questions")]
    Unknown {
        /// The question or image.
        what: String,
    },
    /// Somebody has answered before; answers are never replaced.
    #[error("question {name} has an answer")]
    HasAnswer {
        /// The question.
        name: String,
    },
    /// The file of a question is damaged.
    #[error("question {name} cannot be read: {message}")]
    Damaged {
        /// The question.
        name: String,
        /// Reason.
        message: String,
    },
    /// The folder cannot be read or written.
    #[error("cannot {action} {path}")]
    File {
        /// `read` or `write`.
        action: &'static str,
        /// File or folder.
        path: String,
        /// Cause.
        #[source]
        source: std::io::Error,
    },
}

impl FolderAnswers {
    /// Questions of a folder, which may not exist yet.
    pub fn new(folder: PathBuf) -> Self {
        Self { folder, answering: Mutex::default(), read: Mutex::default() }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// All questions, oldest first; none if the folder is missing.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn list(&self) -> Result<Vec<QuestionRow>, AnsweringError> {
        let found = match numbers(&self.folder) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Vec::new(),
            found => found.map_err(|source| file("read", &self.folder, source))?,
        };
        let row = |number| {
            let name = name_of(number);
            let place = self.folder.join(&name);
            place.join(QUESTION).is_file().then(|| QuestionRow {
                is_answered: place.join(ANSWER).exists(),
                duration_s: self.duration_s(&name, &place.join(ANSWERED)),
                name,
            })
        };
        Ok(found.into_iter().filter_map(row).collect())
    }

    /// Duration of an answer as its file says, s; the file is read again only if its time or length has changed.
    fn duration_s(&self, name: &str, path: &Path) -> Option<f64> {
        let about = fs::metadata(path).ok()?;
        let stamp = (about.modified().ok(), about.len());
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = read.get(name).filter(|known| known.stamp == stamp && stamp.0.is_some()) {
            return known.duration_s;
        }
        let text = files::read_text(path, limits::SETTINGS).ok();
        let duration_s = text.and_then(|text| Answered::from_json(&text).ok()).map(|about| about.duration_s);
        read.insert(name.to_owned(), Read { stamp, duration_s });
        duration_s
    }

    /// A question, with the text of its answer if it has one.
    ///
    /// # Errors
    /// When there is none of that name, or its file is damaged.
    pub fn question(&self, name: &str) -> Result<(FolderQuestion, Option<String>), AnsweringError> {
        let place = self.place(name)?;
        let damaged = |message| AnsweringError::Damaged { name: name.into(), message };
        let text = files::read_text(&place.join(QUESTION), limits::CASSETTE).map_err(damaged)?;
        let question = FolderQuestion::from_json(&text).map_err(|error| damaged(error.to_string()))?;
        let answer = files::read_text(&place.join(ANSWER), limits::CASSETTE).ok();
        Ok((question, answer))
    }

    /// Bytes of an image of a question.
    ///
    /// # Errors
    /// When the question has no image of that name.
    pub fn image(&self, name: &str, image: &str) -> Result<Vec<u8>, AnsweringError> {
        let (question, _) = self.question(name)?;
        let mut parts = question.messages.iter().flat_map(|message| &message.parts);
        // Only names that the question itself lists, none with a path in it.
        let is_plain = Path::new(image).file_name().is_some_and(|own| own == image);
        if !is_plain || !parts.any(|part| matches!(part, FolderPart::Image(own) if own == image)) {
            return Err(AnsweringError::Unknown { what: format!("image {image} of question {name}") });
        }
        let path = self.place(name)?.join(image);
        files::read(&path, IMAGE).map_err(|message| AnsweringError::Damaged { name: name.into(), message })
    }

    /// Answers a question: JSON as its schema says, or a string with words. Both files appear whole.
    ///
    /// # Errors
    /// When there is no such question, it has an answer, or the folder cannot be written.
    pub fn answer(&self, name: &str, answer: &Value, about: &Answered) -> Result<(), AnsweringError> {
        let _alone = self.answering.lock().unwrap_or_else(PoisonError::into_inner);
        let place = self.place(name)?;
        if place.join(ANSWER).exists() {
            return Err(AnsweringError::HasAnswer { name: name.into() });
        }
        let put = |file_name: &str, text: String| {
            let (temporary, path) = (place.join(format!(".{file_name}.tmp")), place.join(file_name));
            let written = write_flushed(&temporary, text.as_bytes()).and_then(|()| fs::rename(&temporary, &path));
            written.map_err(|source| file("write", &path, source))
        };
        // Whoever waits goes on as soon as the answer is there, so it comes last.
        put(ANSWERED, about.to_json())?;
        put(ANSWER, format!("{answer:#}\n"))
    }

    /// Folder of a question: its name is a number, so no other folder is reached.
    fn place(&self, name: &str) -> Result<PathBuf, AnsweringError> {
        let is_number = name.len() >= 3 && name.len() <= 10 && name.bytes().all(|byte| byte.is_ascii_digit());
        let place = self.folder.join(name);
        if !is_number || !place.join(QUESTION).is_file() {
            let shown: String = name.chars().take(40).collect();
            return Err(AnsweringError::Unknown { what: format!("question {shown}") });
        }
        Ok(place)
    }
}

fn file(action: &'static str, path: &Path, source: std::io::Error) -> AnsweringError {
    AnsweringError::File { action, path: path.display().to_string(), source }
}
