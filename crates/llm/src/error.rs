//! Errors of chat models, with advice for users.

use serde::{Deserialize, Serialize};

use crate::reply::is_token_limit;

/// Error of a chat request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(tag = "error", rename_all = "snake_case")]
pub enum ChatError {
    /// No connection could be made.
    #[error("cannot connect to {url}: {message}")]
    Unreachable {
        /// Address without secrets.
        url: String,
        /// Message of the operating system.
        message: String,
    },
    /// The server did not respond in time.
    #[error("no complete response from {url} within {limit_s} s ({phase})")]
    Timeout {
        /// Address without secrets.
        url: String,
        /// Timeout that was exceeded (s).
        limit_s: f64,
        /// Phase of the request in which it was exceeded, e.g. connecting.
        phase: String,
    },
    /// The connection closed before the response was complete.
    #[error("the response of {url} was truncated: {message}")]
    CutOff {
        /// Address without secrets.
        url: String,
        /// Message of the connection or parser.
        message: String,
    },
    /// The server returned an error status.
    #[error("{url} answered {status}: {message}")]
    Status {
        /// HTTP status.
        status: u16,
        /// Error message of the server, truncated.
        message: String,
        /// Address without secrets.
        url: String,
    },
    /// The response exceeds the size limit; reading was stopped.
    #[error("the response of {url} is larger than {limit_bytes} bytes")]
    TooLarge {
        /// Address without secrets.
        url: String,
        /// Maximum response size (bytes).
        limit_bytes: u64,
    },
    /// The response is not JSON, for example a web page.
    #[error("expected JSON from {url}, got {content_type} beginning {beginning:?}")]
    NotJson {
        /// Address without secrets.
        url: String,
        /// Content type of the response.
        content_type: String,
        /// First characters of the response.
        beginning: String,
    },
    /// The JSON is not a chat completion.
    #[error("{url} returned JSON that is not a chat completion: expected {expected} at {path}")]
    NotACompletion {
        /// Address without secrets.
        url: String,
        /// JSON path of the unexpected value.
        path: String,
        /// Expected value at the path.
        expected: String,
    },
    /// The completion has no text.
    #[error("the model returned no text ({})", reason_of(finish_reason))]
    NoText {
        /// Finish reason reported by the server, or `none`.
        finish_reason: String,
    },
    /// An image outside a user message; nothing was sent.
    #[error("images are allowed in user messages only, got one in message {message}")]
    MisplacedImage {
        /// Index of the message, from 0.
        message: usize,
    },
    /// An image above the size limit; nothing was sent.
    #[error("the image in message {message} has {size_bytes} bytes, more than the limit of {limit_bytes}")]
    ImageTooLarge {
        /// Index of the message, from 0.
        message: usize,
        /// Size of the image file (bytes).
        size_bytes: u64,
        /// Maximum image size (bytes).
        limit_bytes: u64,
    },
    /// A request above the size limit; nothing was sent.
    #[error("the request has {size_bytes} bytes, images included, more than the limit of {limit_bytes}")]
    RequestTooLarge {
        /// Size of the request body.
        size_bytes: u64,
        /// Maximum size of the request body.
        limit_bytes: u64,
    },
    /// The model refused to answer.
    #[error("the model declined: {message}")]
    Declined {
        /// Text of the refusal, truncated.
        message: String,
    },
    /// A request that failed in all attempts.
    #[error("gave up after {attempts} requests; the last failure: {last}")]
    GaveUp {
        /// Number of requests sent.
        attempts: u32,
        /// Error of the last request.
        last: Box<ChatError>,
    },
    /// The server requests a longer wait than allowed.
    #[error("the server requests a wait of {asked_s} s, more than the limit of {limit_s} s: {last}")]
    WaitTooLong {
        /// Requested wait (s).
        asked_s: f64,
        /// Maximum wait (s).
        limit_s: f64,
        /// Error response with the request to wait.
        last: Box<ChatError>,
    },
    /// A request without a cassette, in replay mode.
    #[error("no cassette {key} in {folder}{}", nearest.as_ref().map_or_else(String::new, |near| format!("; nearest is {near}")))]
    CassetteMiss {
        /// Content hash of the request.
        key: String,
        /// Most similar cassette and its first difference. `None` if the folder has no cassette.
        nearest: Option<NearestCassette>,
        /// Folder that was searched for the cassette.
        folder: String,
    },
    /// A cassette cannot be read or written.
    #[error("{message}: {path}")]
    Cassette {
        /// Description of what is wrong with the cassette.
        message: String,
        /// Path of the cassette file.
        path: String,
    },
    /// A question in a folder was not answered in time.
    #[error("no {path} after {limit_s} s")]
    Unanswered {
        /// Path of the expected answer.
        path: String,
        /// Time waited for the answer (s).
        limit_s: f64,
    },
    /// A question cannot be written, or an answer cannot be read.
    #[error("{message}: {path}")]
    Folder {
        /// Description of what failed.
        message: String,
        /// Path of the folder or file.
        path: String,
    },
    /// The cost limit is reached; nothing was sent.
    #[error("the cost of {amount:.2} {currency} has reached the limit of {limit:.2}")]
    Spent {
        /// Cost of all requests so far.
        amount: f64,
        /// Cost limit from the user's settings.
        limit: f64,
        /// Currency of cost and limit.
        currency: String,
    },
    /// The cost limit cannot be enforced because the server does not report token usage; nothing was sent.
    #[error("the server reports no token usage, so the cost limit of {limit:.2} cannot be enforced")]
    Uncounted {
        /// Cost limit from the user's settings.
        limit: f64,
    },
    /// The script of a fake model has ended.
    #[error("the script ended after {answers} answers")]
    ScriptEnded {
        /// Number of answers in the script.
        answers: usize,
    },
}

/// The most similar cassette to an unrecorded request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NearestCassette {
    /// File name of the cassette.
    pub file: String,
    /// First difference from the request.
    pub difference: String,
}

impl std::fmt::Display for NearestCassette {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, which differs at {}", self.file, self.difference)
    }
}

impl ChatError {
    /// True if other requests will probably fail for the same reason.
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

    /// Advice for fixing the error of a service of masks or grasps, whose URL is given without a settings file.
    pub fn service_hint(&self) -> &'static str {
        match self {
            Self::Unreachable { .. } => "start the server, check the network, or correct the address",
            Self::Timeout { .. } => "choose a faster model or machine",
            Self::Status { status: 300..=399, .. } => "give the address that it redirects to",
            Self::Status { status: 401 | 403, .. } => "services are asked without a key",
            Self::Status { status: 404 | 405, .. } => {
                "give the whole address of requests, such as http://127.0.0.1:8091/segment"
            }
            Self::Status { status: 400 | 413 | 422, .. } | Self::NotJson { .. } | Self::NotACompletion { .. } => {
                "docs/guides/services.md describes requests and answers"
            }
            Self::TooLarge { .. } => "docs/guides/services.md describes the answer",
            Self::GaveUp { last, .. } => last.service_hint(),
            other => other.hint(),
        }
    }

    /// Advice for fixing the error.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::Unreachable { .. } => "start the server, check the network, or correct `base_url` in the settings",
            Self::Timeout { .. } => "raise `total_timeout_s`, or choose a faster model",
            Self::CutOff { .. } => "try again; if it persists, check the server's log",
            Self::Status { status: 401 | 403, .. } => {
                "the variable named in `api_key_env` must contain a valid key for this server"
            }
            Self::Status { status: 404, .. } => "`base_url` usually ends in `/v1`; `model` must exist on the server",
            Self::Status { status: 400 | 413 | 422, message, .. } if is_about_length(message) => {
                "the conversation is longer than the model's context: serve it with a larger one, offer fewer objects \
                 (`sampling.offered`), or lower `max_tokens`"
            }
            Self::Status { status: 400 | 422, .. } => "check `parameters` and `model` in the settings",
            Self::Status { status: 300..=399, .. } => "set `base_url` to the address it redirects to",
            Self::Status { .. } => "the server failed; try again later",
            Self::TooLarge { .. } => "this is not a chat completion, or `max_body_bytes` is too small",
            Self::NotJson { .. } | Self::NotACompletion { .. } => {
                "`base_url` must be that of a server with this `dialect`; it usually ends in `/v1`"
            }
            Self::NoText { .. } => "raise `max_tokens` in `parameters`: thoughts of a reasoning model count too",
            Self::MisplacedImage { .. } => "move the image into a user message",
            Self::ImageTooLarge { .. } => "scale the image down, or raise `max_image_bytes` if the server accepts it",
            Self::RequestTooLarge { .. } => {
                "send fewer or smaller images, or raise `max_request_bytes` if the server accepts it"
            }
            Self::Declined { .. } => "use another model",
            Self::GaveUp { last, .. } => last.hint(),
            Self::WaitTooLong { .. } => "run later or with fewer `workers`; `max_retry_after_s` is the limit",
            Self::CassetteMiss { .. } => "run once in mode `record`, or undo the change that altered the request",
            Self::Cassette { .. } => "fix or delete the file, then record again",
            Self::Unanswered { .. } => "write the answer and run again: questions are not repeated",
            Self::Folder { .. } => "check the folder's permissions and the answer's size",
            Self::Spent { .. } => "raise the limit and run again: answered requests are not repeated",
            Self::Uncounted { .. } => "run without a limit, or use a server that reports token usage",
            Self::ScriptEnded { .. } => "give the script more answers",
        }
    }
}

impl ChatError {
    /// True if the model was stopped at its token limit before it produced any text.
    pub fn is_cut_off(&self) -> bool {
        matches!(self, Self::NoText { finish_reason } if is_token_limit(finish_reason))
    }
}

/// Finish reason of a reply without text, for [`ChatError::NoText`].
fn reason_of(finish_reason: &str) -> String {
    match is_token_limit(finish_reason) {
        true => format!("stopped at its limit of tokens, `max_tokens`; finish reason: {finish_reason}"),
        false => format!("finish reason: {finish_reason}"),
    }
}

/// True if a server's message concerns the length, in tokens, of the conversation or of the answer.
pub(crate) fn is_about_length(message: &str) -> bool {
    let message = message.to_lowercase();
    ["context", "token", "too long", "too large"].iter().any(|word| message.contains(word))
}

/// Error in settings that a user wrote.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SettingsError {
    /// The text is not valid TOML for these settings. The line is not shown, since it could contain a key.
    #[error("line {line}: {message}")]
    NotSettings {
        /// Line number, from 1.
        line: usize,
        /// Description of the problem.
        message: String,
    },
    /// A field with an invalid value.
    #[error("`{field}`: expected {expected}")]
    Invalid {
        /// Field name in the file.
        field: &'static str,
        /// Description of valid values.
        expected: String,
    },
    /// The environment variable of the key is not set.
    #[error("the environment variable {variable} (from `server.api_key_env`) is not set")]
    MissingKey {
        /// Name of the environment variable.
        variable: String,
    },
    /// The environment variable contains no valid key.
    #[error(
        "the API key must be 8 to 4096 visible ASCII characters; omit `api_key_env` for a server without authentication"
    )]
    BadKey,
}

/// Bytes that are neither a PNG nor a JPEG file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a PNG or JPEG file, got {size_bytes} bytes beginning {beginning:?} in hexadecimal")]
pub struct ImageError {
    /// Number of bytes.
    pub size_bytes: u64,
    /// First eight bytes in hexadecimal.
    pub beginning: String,
}

impl ImageError {
    /// Advice for fixing the error.
    pub fn hint(&self) -> &'static str {
        "encode the image as PNG or JPEG, and pass the file's bytes, not base64"
    }
}

/// Truncates a text to one line.
pub(crate) fn shortened(text: &str, max_chars: usize) -> String {
    let mut words = String::new();
    for (count, letter) in text.trim().chars().enumerate() {
        if count == max_chars {
            words.push('…');
            break;
        }
        words.push(if letter.is_control() { ' ' } else { letter });
    }
    words
}
