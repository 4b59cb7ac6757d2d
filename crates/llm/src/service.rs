//! JSON services, such as segmentation or grasping: over HTTP, recorded and replayed.

use std::path::Path;
use std::time::Duration;

use genmanip_core::Document;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::cassette::{CassetteMode, CassetteSettings, path_of, read_text, write_atomically};
use crate::error::{ChatError, SettingsError};
use crate::settings::{check_address, is_loopback};
use crate::transport::{Limits, Transport};
use genmanip_core::hexadecimal;

/// A JSON request-response service. Calls block and may come from several threads at once.
pub trait Service: Send + Sync {
    /// Sends a request and returns the response.
    ///
    /// # Errors
    /// Reports why there is no response, after all retries.
    fn ask(&self, question: &Value) -> Result<Value, ChatError>;
}

impl<S: Service + ?Sized> Service for Box<S> {
    fn ask(&self, question: &Value) -> Result<Value, ChatError> {
        (**self).ask(question)
    }
}

/// HTTP service settings with limits and retries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServiceSettings {
    /// URL for requests, e.g. `http://127.0.0.1:8091/segment`; no user, password or query.
    pub url: String,
    /// Timeout of connecting to the service (s).
    pub connect_timeout_s: f64,
    /// Timeout of one whole request (s).
    pub total_timeout_s: f64,
    /// Maximum request size (bytes).
    pub max_request_bytes: u64,
    /// Maximum response size (bytes).
    pub max_body_bytes: u64,
    /// Maximum retries after a transient failure, a timeout or a broken connection.
    pub max_retries: u32,
    /// Wait before the first retry (s); doubles each time.
    pub first_backoff_s: f64,
}

impl Default for ServiceSettings {
    fn default() -> Self {
        Self {
            url: String::new(),
            connect_timeout_s: 5.0,
            total_timeout_s: 60.0,       // a large model without a GPU takes tens of seconds
            max_request_bytes: 64 << 20, // colour and depth of 1280x720 are 9 MB in base64
            max_body_bytes: 64 << 20,    // masks of 1280x720 as nested lists of numbers would still fit
            max_retries: 2,
            first_backoff_s: 0.5,
        }
    }
}

impl ServiceSettings {
    /// Default settings for the service at a URL.
    pub fn at(url: &str) -> Self {
        Self { url: url.into(), ..Self::default() }
    }

    /// Validates the settings.
    ///
    /// # Errors
    /// Names the first invalid field, as in a file with these settings in the table `service`.
    pub fn check(&self) -> Result<(), SettingsError> {
        let invalid = |field, expected: &str| Err(SettingsError::Invalid { field, expected: expected.into() });
        if let Err(expected) = check_address(&self.url) {
            return invalid("service.url", expected);
        }
        let seconds = [
            ("service.connect_timeout_s", self.connect_timeout_s),
            ("service.total_timeout_s", self.total_timeout_s),
            ("service.first_backoff_s", self.first_backoff_s),
        ];
        for (field, seconds) in seconds {
            if !(seconds > 0.0 && seconds <= 86_400.0) {
                return invalid(field, "seconds, more than 0 and at most a day");
            }
        }
        if !(1..=1 << 30).contains(&self.max_request_bytes) || !(1..=1 << 30).contains(&self.max_body_bytes) {
            return invalid("service.max_request_bytes and max_body_bytes", "1 to 1073741824");
        }
        if self.max_retries > 20 {
            return invalid("service.max_retries", "0 to 20");
        }
        Ok(())
    }
}

/// A service over HTTP.
#[derive(Debug)]
pub struct HttpService {
    settings: ServiceSettings,
    transport: Transport,
}

impl HttpService {
    /// Creates a client without sending anything.
    ///
    /// # Errors
    /// Names the invalid setting.
    pub fn new(settings: ServiceSettings) -> Result<Self, SettingsError> {
        settings.check()?;
        let limits = Limits {
            connect_timeout_s: settings.connect_timeout_s,
            total_timeout_s: settings.total_timeout_s,
            max_body_bytes: settings.max_body_bytes,
        };
        let transport = Transport::new(limits, is_loopback(&settings.url), None);
        Ok(Self { settings, transport })
    }
}

impl Service for HttpService {
    fn ask(&self, question: &Value) -> Result<Value, ChatError> {
        let body = question.to_string();
        let (size_bytes, limit_bytes) = (body.len() as u64, self.settings.max_request_bytes);
        if size_bytes > limit_bytes {
            return Err(ChatError::RequestTooLarge { size_bytes, limit_bytes });
        }
        let mut retry = 0;
        loop {
            let failure = match self.transport.post(&self.settings.url, &[], &body) {
                Ok(answer) => return Ok(answer),
                Err(failure) => failure,
            };
            if !failure.transient || self.settings.max_retries == 0 {
                return Err(failure.error);
            }
            if retry == self.settings.max_retries {
                return Err(ChatError::GaveUp { attempts: retry + 1, last: Box::new(failure.error) });
            }
            std::thread::sleep(Duration::from_secs_f64(self.settings.first_backoff_s * f64::from(1 << retry)));
            retry += 1;
        }
    }
}

/// A recorded response of a service. Of the request, which may contain megabytes of pixels, only the hash is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServiceCassette {
    /// SHA-256 of the request as JSON with sorted keys, 64 hexadecimal digits.
    pub key: String,
    /// Comment: who answered and why it was recorded.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// Response of the service, as JSON.
    pub answer: Value,
}

impl Document for ServiceCassette {
    const SCHEMA: &'static str = "genmanip.service-cassette/1";
}

/// A service with a folder of recorded responses.
#[derive(Debug)]
pub struct RecordedService<S> {
    service: Option<S>,
    settings: CassetteSettings,
}

impl<S: Service> RecordedService<S> {
    /// Records responses of `service`, which is asked in the modes live and record only.
    pub fn new(service: S, settings: CassetteSettings) -> Self {
        Self { service: Some(service), settings }
    }
}

impl RecordedService<HttpService> {
    /// Replays recorded responses of a folder; nothing is ever sent.
    pub fn replay(folder: &Path) -> Self {
        let settings =
            CassetteSettings { mode: CassetteMode::Replay, folder: folder.to_owned(), ..CassetteSettings::default() };
        Self { service: None, settings }
    }
}

impl<S: Service> Service for RecordedService<S> {
    fn ask(&self, question: &Value) -> Result<Value, ChatError> {
        let service = match (&self.service, self.settings.mode) {
            (Some(service), CassetteMode::Live) => return service.ask(question),
            (Some(service), CassetteMode::Record) => Some(service),
            _ => None,
        };
        let key = key_of(question);
        let path = path_of(&self.settings.folder, &key);
        let broken = |message: String| ChatError::Cassette { message, path: path.display().to_string() };
        match (path.exists(), service) {
            (true, _) => {
                let cassette =
                    ServiceCassette::from_json(&read_text(&path)?).map_err(|error| broken(error.to_string()))?;
                if cassette.key == key {
                    Ok(cassette.answer)
                } else {
                    Err(broken("it belongs to another request".into()))
                }
            }
            (false, Some(service)) => {
                let answer = service.ask(question)?;
                let cassette = ServiceCassette { key, note: self.settings.note.clone(), answer: answer.clone() };
                let written = write_atomically(&path, &cassette.to_json());
                written.map_err(|error| broken(format!("cannot write the cassette: {error}")))?;
                Ok(answer)
            }
            (false, None) => {
                Err(ChatError::CassetteMiss { key, nearest: None, folder: self.settings.folder.display().to_string() })
            }
        }
    }
}

fn key_of(question: &Value) -> String {
    let mut canonical = question.clone();
    canonical.sort_all_objects();
    hexadecimal(&Sha256::digest(canonical.to_string().as_bytes()))
}
