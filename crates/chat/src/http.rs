//! The client: one blocking HTTP request per try, with limits on time, size and patience.

use std::io::Read;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use genmanip_core::Seed;
use serde_json::Value;

use crate::dialect::{Wire, error_message, refuses_structure};
use crate::error::{ChatError, SettingsError, shortened};
use crate::message::Role;
use crate::model::ChatModel;
use crate::reply::{ChatReply, Structure};
use crate::request::ChatRequest;
use crate::retry::{backoff_s, retry_after_s};
use crate::secret::ApiKey;
use crate::settings::ServerSettings;

/// A server that speaks one of the dialects.
///
/// Redirects are refused, so that a key is never carried elsewhere.
/// System proxies (`HTTPS_PROXY`, `NO_PROXY`) are used, except for a server on this machine.
#[derive(Debug)]
pub struct HttpChat {
    settings: ServerSettings,
    key: Option<ApiKey>,
    jitter: Seed,
    agent: ureq::Agent,
    url: String,
    /// Index into [`Structure::ALL`] of the strictest form that the server is known to take.
    structure: AtomicUsize,
}

/// One try that failed, and whether another could do better.
struct Failure {
    error: ChatError,
    transient: bool,
    retry_after_s: Option<f64>,
}

impl HttpChat {
    /// A client with a key; none for servers that want none. `jitter` spreads the waits between retries.
    ///
    /// # Errors
    /// Names the setting that makes no sense.
    pub fn new(settings: ServerSettings, key: Option<ApiKey>, jitter: Seed) -> Result<Self, SettingsError> {
        settings.check()?;
        let mut config = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .max_redirects(0)
            .max_redirects_will_error(false)
            .timeout_connect(Some(Duration::from_secs_f64(settings.connect_timeout_s)))
            .timeout_global(Some(Duration::from_secs_f64(settings.total_timeout_s)))
            .user_agent(concat!("genmanip/", env!("CARGO_PKG_VERSION")));
        if settings.is_loopback() {
            config = config.proxy(None);
        }
        #[cfg(feature = "https")]
        {
            let provider = std::sync::Arc::new(rustls::crypto::ring::default_provider());
            let tls = ureq::tls::TlsConfig::builder()
                .root_certs(ureq::tls::RootCerts::PlatformVerifier)
                .unversioned_rustls_crypto_provider(provider);
            config = config.tls_config(tls.build());
        }
        let url = format!("{}{}", settings.base_url.trim_end_matches('/'), settings.dialect.wire().path());
        let first = Structure::ALL.iter().position(|one| *one == settings.structure).unwrap_or(0);
        Ok(Self { agent: config.build().new_agent(), structure: AtomicUsize::new(first), settings, key, jitter, url })
    }

    /// Asks with one form of structured output, as often as patience allows.
    fn ask(&self, request: &ChatRequest, structure: Structure, attempts: &mut u32) -> Result<ChatReply, ChatError> {
        let body = self.wire().request_body(request, structure).to_string();
        let (size_bytes, limit_bytes) = (body.len() as u64, self.settings.max_request_bytes);
        if size_bytes > limit_bytes {
            return Err(ChatError::RequestTooLarge { size_bytes, limit_bytes });
        }
        let jitter = request.fork(self.jitter);
        let mut retry = 0;
        loop {
            *attempts += 1;
            let failure = match self.try_once(&body, structure) {
                Ok(reply) => return Ok(ChatReply { attempts: *attempts, ..reply }),
                Err(failure) => failure,
            };
            let refused = structure != Structure::Plain && refuses_structure(&failure.error);
            if !failure.transient || refused || self.settings.max_retries == 0 {
                return Err(failure.error);
            }
            if retry == self.settings.max_retries {
                return Err(ChatError::GaveUp { attempts: *attempts, last: Box::new(failure.error) });
            }
            let limit_s = self.settings.max_retry_after_s;
            if let Some(asked_s) = failure.retry_after_s.filter(|asked_s| *asked_s > limit_s) {
                return Err(ChatError::WaitTooLong { asked_s, limit_s, last: Box::new(failure.error) });
            }
            let wait_s = failure.retry_after_s.unwrap_or(0.0).max(backoff_s(&self.settings, retry, jitter));
            std::thread::sleep(Duration::from_secs_f64(wait_s));
            retry += 1;
        }
    }

    fn try_once(&self, body: &str, structure: Structure) -> Result<ChatReply, Failure> {
        let mut request =
            self.agent.post(&self.url).content_type("application/json").header("accept", "application/json");
        for (name, value) in self.wire().headers(self.key.as_ref()) {
            request = request.header(name, value);
        }
        let response = request.send(body).map_err(|error| self.failure(error))?;
        let header = |name: &str| response.headers().get(name).and_then(|value| value.to_str().ok());
        let status = response.status().as_u16();
        let content_type = shortened(&self.redact(header("content-type").unwrap_or("no content type")), 100);
        let retry_after_s = retry_after_s(header("retry-after"), header("date"));
        let bytes = self.read(response)?;
        // Cleaned before anything is shortened: half a key is a secret, too.
        let parsed: Result<Value, _> = serde_json::from_slice(&bytes).map(|value| self.redact_all(value));
        let beginning = || shortened(&self.redact(&String::from_utf8_lossy(&bytes)), 120);
        if !(200..300).contains(&status) {
            let message = parsed.ok().as_ref().and_then(error_message).unwrap_or_else(beginning);
            let message = if message.is_empty() { "(no message)".into() } else { message };
            let transient = matches!(status, 408 | 425 | 429 | 500 | 502..=599);
            let error = ChatError::Status { status, message, url: self.url.clone() };
            return Err(Failure { error, transient, retry_after_s });
        }
        let value = parsed.map_err(|error| {
            let url = self.url.clone();
            if error.is_eof() && !bytes.is_empty() {
                return Failure::passing(ChatError::CutOff { url, message: "the JSON is not complete".into() });
            }
            Failure::lasting(ChatError::NotJson { url, content_type, beginning: beginning() })
        })?;
        self.wire().reply(&value, structure, &self.url).map_err(Failure::lasting)
    }

    fn wire(&self) -> &'static dyn Wire {
        self.settings.dialect.wire()
    }

    fn check_images(&self, request: &ChatRequest) -> Result<(), ChatError> {
        let limit_bytes = self.settings.max_image_bytes;
        for (message, image) in request.images() {
            if request.messages[message].role != Role::User {
                return Err(ChatError::MisplacedImage { message });
            }
            let size_bytes = image.bytes().len() as u64;
            if size_bytes > limit_bytes {
                return Err(ChatError::ImageTooLarge { message, size_bytes, limit_bytes });
            }
        }
        Ok(())
    }

    /// Reads at most the allowed number of bytes; dropping the rest closes the connection.
    fn read(&self, response: ureq::http::Response<ureq::Body>) -> Result<Vec<u8>, Failure> {
        let limit_bytes = self.settings.max_body_bytes;
        let too_large = || Failure::lasting(ChatError::TooLarge { url: self.url.clone(), limit_bytes });
        let body = response.into_body();
        if body.content_length().is_some_and(|length| length > limit_bytes) {
            return Err(too_large());
        }
        let mut bytes = Vec::new();
        let mut reader = body.into_reader().take(limit_bytes + 1);
        reader.read_to_end(&mut bytes).map_err(|error| self.failure(ureq::Error::from(error)))?;
        if bytes.len() as u64 > limit_bytes { Err(too_large()) } else { Ok(bytes) }
    }

    fn failure(&self, error: ureq::Error) -> Failure {
        let url = self.url.clone();
        let message = shortened(&self.redact(&error.to_string()), 300);
        match error {
            ureq::Error::Timeout(phase) => {
                let connecting = matches!(phase, ureq::Timeout::Connect | ureq::Timeout::Resolve);
                let limit_s = if connecting { self.settings.connect_timeout_s } else { self.settings.total_timeout_s };
                Failure::passing(ChatError::Timeout { url, limit_s, phase: phase.to_string() })
            }
            ureq::Error::Io(io) if is_unreachable(io.kind()) => {
                Failure::lasting(ChatError::Unreachable { url, message })
            }
            ureq::Error::Io(_) | ureq::Error::Protocol(_) | ureq::Error::BodyStalled => {
                Failure::passing(ChatError::CutOff { url, message })
            }
            _ => Failure::lasting(ChatError::Unreachable { url, message }),
        }
    }

    fn redact(&self, text: &str) -> String {
        self.key.as_ref().map_or_else(|| text.to_owned(), |key| key.redact(text))
    }

    fn redact_all(&self, value: Value) -> Value {
        match value {
            Value::String(text) => self.redact(&text).into(),
            Value::Array(values) => values.into_iter().map(|value| self.redact_all(value)).collect(),
            Value::Object(fields) => {
                let clean = |(name, value): (String, Value)| (self.redact(&name), self.redact_all(value));
                Value::Object(fields.into_iter().map(clean).collect())
            }
            other => other,
        }
    }
}

impl ChatModel for HttpChat {
    /// Asks with the strictest structured output the server is known to take, then with looser ones.
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        self.check_images(request)?;
        let first = if request.reply_schema.is_some() { self.structure.load(Ordering::Relaxed) } else { usize::MAX };
        let strictest = Structure::ALL.get(first).copied().unwrap_or(Structure::Plain);
        let forms = self.wire().structures().iter().filter(|structure| **structure >= strictest);
        let mut attempts = 0;
        let mut refusal = None;
        for structure in forms {
            match self.ask(request, *structure, &mut attempts) {
                Ok(reply) => {
                    if request.reply_schema.is_some() {
                        self.structure.fetch_max(*structure as usize, Ordering::Relaxed);
                    }
                    return Ok(reply);
                }
                // The first refusal explains more than the last: the later requests ask for less.
                Err(error) if refuses_structure(&error) => refusal = refusal.or(Some(error)),
                Err(error) => return Err(error),
            }
        }
        Err(refusal.unwrap_or(ChatError::NoText { finish_reason: "none".into() }))
    }
}

impl Failure {
    fn passing(error: ChatError) -> Self {
        Self { error, transient: true, retry_after_s: None }
    }

    fn lasting(error: ChatError) -> Self {
        Self { error, transient: false, retry_after_s: None }
    }
}

fn is_unreachable(kind: std::io::ErrorKind) -> bool {
    use std::io::ErrorKind;
    matches!(
        kind,
        ErrorKind::ConnectionRefused
            | ErrorKind::HostUnreachable
            | ErrorKind::NetworkUnreachable
            | ErrorKind::AddrNotAvailable
            | ErrorKind::PermissionDenied
    )
}
