//! Why there is no answer, in words for the person who has to do something about it.

use serde::{Deserialize, Serialize};

/// Why a conversation got no answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(tag = "error", rename_all = "snake_case")]
pub enum ChatError {
    /// No connection could be made.
    #[error("cannot reach {url}: {message}")]
    Unreachable {
        /// Address without secrets.
        url: String,
        /// What the system says.
        message: String,
    },
    /// The server took too long.
    #[error("no whole answer from {url} after {limit_s} s ({phase})")]
    Timeout {
        /// Address without secrets.
        url: String,
        /// The limit that was met.
        limit_s: f64,
        /// What was being waited for.
        phase: String,
    },
    /// The connection ended before the answer did.
    #[error("the answer of {url} was cut off: {message}")]
    CutOff {
        /// Address without secrets.
        url: String,
        /// What the connection or the parser says.
        message: String,
    },
    /// The server refused.
    #[error("{url} answered {status}: {message}")]
    Status {
        /// HTTP status.
        status: u16,
        /// What the server says, shortened.
        message: String,
        /// Address without secrets.
        url: String,
    },
    /// The answer is larger than the limit; reading was stopped there.
    #[error("the answer of {url} is larger than {limit_bytes} bytes")]
    TooLarge {
        /// Address without secrets.
        url: String,
        /// The limit.
        limit_bytes: u64,
    },
    /// The answer is no JSON, for example a web page.
    #[error("expected JSON from {url}, got {content_type} beginning {beginning:?}")]
    NotJson {
        /// Address without secrets.
        url: String,
        /// What the server calls it.
        content_type: String,
        /// The first characters.
        beginning: String,
    },
    /// JSON, but no chat completion.
    #[error("{url} answered JSON that is no chat completion: expected {expected} at {path}")]
    NotACompletion {
        /// Address without secrets.
        url: String,
        /// JSON path.
        path: String,
        /// What should be there.
        expected: String,
    },
    /// A completion without words.
    #[error("the model said nothing (finish reason: {finish_reason})")]
    NoText {
        /// In the server's words, or `none`.
        finish_reason: String,
    },
    /// An image where servers take none; nothing was sent.
    #[error("expected images in messages of the user only, got one in message {message}")]
    MisplacedImage {
        /// Index of the message, from 0.
        message: usize,
    },
    /// An image that the settings do not allow; nothing was sent.
    #[error("the image in message {message} has {size_bytes} bytes, more than the limit of {limit_bytes}")]
    ImageTooLarge {
        /// Index of the message, from 0.
        message: usize,
        /// Size of the file.
        size_bytes: u64,
        /// The limit.
        limit_bytes: u64,
    },
    /// A request that the settings do not allow; nothing was sent.
    #[error("the request has {size_bytes} bytes, images included, more than the limit of {limit_bytes}")]
    RequestTooLarge {
        /// Size of the body.
        size_bytes: u64,
        /// The limit.
        limit_bytes: u64,
    },
    /// The model declined.
    #[error("the model declined: {message}")]
    Declined {
        /// In the model's words, shortened.
        message: String,
    },
    /// Retrying did not help.
    #[error("gave up after {attempts} requests; the last failure: {last}")]
    GaveUp {
        /// Requests sent.
        attempts: u32,
        /// Why the last one failed.
        last: Box<ChatError>,
    },
    /// The server asks for more patience than the settings have.
    #[error("the server asks to wait {asked_s} s, more than the limit of {limit_s} s; its reason: {last}")]
    WaitTooLong {
        /// What the server asks for.
        asked_s: f64,
        /// The limit.
        limit_s: f64,
        /// The answer that asked.
        last: Box<ChatError>,
    },
    /// A request that was never recorded.
    #[error("no cassette {key} in {folder}{}", nearest.as_ref().map_or_else(String::new, |near| format!("; nearest is {near}")))]
    CassetteMiss {
        /// Content hash of the request.
        key: String,
        /// The most similar cassette, and how it differs.
        nearest: Option<NearestCassette>,
        /// Where cassettes were looked for.
        folder: String,
    },
    /// A cassette that cannot be read or written.
    #[error("{message}: {path}")]
    Cassette {
        /// What is wrong.
        message: String,
        /// The file.
        path: String,
    },
    /// A question in a folder that nobody answered.
    #[error("no {path} after {limit_s} s")]
    Unanswered {
        /// The answer that was waited for.
        path: String,
        /// The limit that was met.
        limit_s: f64,
    },
    /// A folder of questions that cannot be written, or an answer that cannot be read.
    #[error("{message}: {path}")]
    Folder {
        /// What is wrong.
        message: String,
        /// The folder or file.
        path: String,
    },
    /// The answers have cost what they may; nothing was sent.
    #[error("the answers have cost {amount:.2} {currency}, and {limit:.2} is the limit")]
    Spent {
        /// Sum so far.
        amount: f64,
        /// Most that may be spent.
        limit: f64,
        /// Of both.
        currency: String,
    },
    /// The answers may have cost more than they may, since the server does not count; nothing was sent.
    #[error("the server counts no tokens, so nobody knows whether the limit of {limit:.2} is kept")]
    Uncounted {
        /// Most that may be spent.
        limit: f64,
    },
    /// The script of a fake has no more lines.
    #[error("the script ended after {answers} answers")]
    ScriptEnded {
        /// Answers that were given.
        answers: usize,
    },
}

/// The cassette most like a request that has none.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NearestCassette {
    /// File name.
    pub file: String,
    /// The first place where it differs from the request.
    pub difference: String,
}

impl std::fmt::Display for NearestCassette {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, which differs at {}", self.file, self.difference)
    }
}

impl ChatError {
    /// Whether other requests will probably fail for the same reason.
    pub fn is_service_trouble(&self) -> bool {
        !matches!(
            self,
            Self::NoText { .. }
                | Self::MisplacedImage { .. }
                | Self::ImageTooLarge { .. }
                | Self::RequestTooLarge { .. }
                | Self::Declined { .. }
                | Self::CassetteMiss { .. }
                | Self::Cassette { .. }
        )
    }

    /// What to do about it.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::Unreachable { .. } => "start the server, or correct `base_url` in the settings",
            Self::Timeout { .. } => "raise `total_timeout_s`, or choose a faster model",
            Self::CutOff { .. } => "try again; if it stays so, look at the server's log",
            Self::Status { status: 401 | 403, .. } => {
                "the variable named in `api_key_env` must hold a key of this server"
            }
            Self::Status { status: 404, .. } => {
                "`base_url` ends in `/v1` with most servers; `model` must be one it has"
            }
            Self::Status { status: 400 | 422, .. } => "look at `parameters` and `model` in the settings",
            Self::Status { status: 300..=399, .. } => "write the address it redirects to into `base_url`",
            Self::Status { .. } => "the server has trouble of its own; try again later",
            Self::TooLarge { .. } => "this is no chat completion, or `max_body_bytes` is too small",
            Self::NotJson { .. } | Self::NotACompletion { .. } => {
                "`base_url` must be that of a server that speaks `dialect`, with most ending in `/v1`"
            }
            Self::NoText { .. } => "a model that thinks at length needs a larger token limit in `parameters`",
            Self::MisplacedImage { .. } => "say it in words there, or move the image into the user's message",
            Self::ImageTooLarge { .. } => "scale the image down, or raise `max_image_bytes` if the server takes it",
            Self::RequestTooLarge { .. } => {
                "send fewer or smaller images, or raise `max_request_bytes` if the server takes it"
            }
            Self::Declined { .. } => "ask another model",
            Self::GaveUp { last, .. } => last.hint(),
            Self::WaitTooLong { .. } => "run later or with fewer `workers`; `max_retry_after_s` is the limit",
            Self::CassetteMiss { .. } => "run once in the mode `record`, or undo the change that made a new question",
            Self::Cassette { .. } => "mend or delete the file, then record again",
            Self::Unanswered { .. } => "write the answer and start again: what was asked is not asked again",
            Self::Folder { .. } => "check the folder's rights and the answer's size",
            Self::Spent { .. } => "raise the limit and start again: what was answered is not asked again",
            Self::Uncounted { .. } => "run without a limit, or ask a server that counts tokens",
            Self::ScriptEnded { .. } => "give the script more answers",
        }
    }
}

/// Why settings cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SettingsError {
    /// The text is no TOML, or not these settings. The offending line is not shown, it could hold a key.
    #[error("line {line}: {message}")]
    NotSettings {
        /// From 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A value that makes no sense.
    #[error("`{field}`: expected {expected}")]
    Invalid {
        /// Its name in the file.
        field: &'static str,
        /// What it may be.
        expected: String,
    },
    /// The variable for the key is unset.
    #[error("the environment variable {variable}, which `server.api_key_env` names, is not set")]
    MissingKey {
        /// Name of the variable.
        variable: String,
    },
    /// The variable holds no key.
    #[error("the API key must be 8 to 4096 visible ASCII characters; a server that wants none needs no `api_key_env`")]
    BadKey,
}

/// Bytes that are neither a PNG nor a JPEG file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a PNG or JPEG file, got {size_bytes} bytes beginning {beginning:?} in hexadecimal")]
pub struct ImageError {
    /// How many bytes.
    pub size_bytes: u64,
    /// The first eight of them, in hexadecimal.
    pub beginning: String,
}

impl ImageError {
    /// What to do about it.
    pub fn hint(&self) -> &'static str {
        "encode the picture as PNG or JPEG first, and give the bytes of the file, not base64"
    }
}

/// The first characters of a text on one line.
pub(crate) fn shortened(text: &str, longest: usize) -> String {
    let mut words = String::new();
    for (count, letter) in text.trim().chars().enumerate() {
        if count == longest {
            words.push('…');
            break;
        }
        words.push(if letter.is_control() { ' ' } else { letter });
    }
    words
}
