//! HTTP client for chat models, with limits on size and retries.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::dialect::{Wire, refuses_structure};
use crate::error::{ChatError, SettingsError};
use crate::message::Role;
use crate::model::ChatModel;
use crate::reply::{ChatReply, Structure};
use crate::request::ChatRequest;
use crate::retry::backoff_s;
use crate::secret::ApiKey;
use crate::settings::ServerSettings;
use crate::transport::{Failure, Limits, Transport};
use genmanip_core::Seed;

/// Client of a chat model behind an HTTP server.
///
/// Redirects are refused, so that a key is never sent elsewhere. System proxies (`HTTPS_PROXY`, `NO_PROXY`) are used,
/// except for a server on this machine.
#[derive(Debug)]
pub struct HttpChat {
    settings: ServerSettings,
    key: Option<ApiKey>,
    jitter: Seed,
    transport: Transport,
    url: String,
    /// Index into [`Structure::ALL`] of the strictest mode the server is known to accept.
    structure: AtomicUsize,
}

impl HttpChat {
    /// Creates a client; `key` is `None` for servers without authentication. `jitter` seeds the retry waits.
    ///
    /// # Errors
    /// Names the invalid setting.
    pub fn new(settings: ServerSettings, key: Option<ApiKey>, jitter: Seed) -> Result<Self, SettingsError> {
        settings.check()?;
        let limits = Limits {
            connect_timeout_s: settings.connect_timeout_s,
            total_timeout_s: settings.total_timeout_s,
            max_body_bytes: settings.max_body_bytes,
        };
        let transport = Transport::new(limits, settings.is_loopback(), key.clone());
        let url = format!("{}{}", settings.base_url.trim_end_matches('/'), settings.dialect.wire().path());
        let first = Structure::ALL.iter().position(|one| *one == settings.structure).unwrap_or(0);
        Ok(Self { transport, structure: AtomicUsize::new(first), settings, key, jitter, url })
    }

    /// Sends a request in one structured-output mode with retries.
    fn send_with_retries(
        &self,
        request: &ChatRequest,
        structure: Structure,
        attempts: &mut u32,
    ) -> Result<ChatReply, ChatError> {
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
            let structure_rejected = structure != Structure::Plain && refuses_structure(&failure.error);
            if !failure.transient || structure_rejected || self.settings.max_retries == 0 {
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
        let headers = self.wire().headers(self.key.as_ref());
        let value = self.transport.post(&self.url, &headers, body)?;
        self.settings.dialect.reply(&value, structure, &self.url).map_err(Failure::permanent)
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
}

impl ChatModel for HttpChat {
    /// Tries structured-output modes from the strictest one the server is known to accept.
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        self.check_images(request)?;
        let first = match &request.reply_schema {
            None => Structure::Plain as usize,
            Some(asked) if asked.grammar.is_none() => Structure::JsonSchema as usize,
            Some(_) => Structure::Grammar as usize,
        };
        let first = first.max(self.structure.load(Ordering::Relaxed));
        let modes = self.wire().structures().iter().filter(|structure| **structure as usize >= first);
        let mut attempts = 0;
        let mut rejection = None;
        for structure in modes {
            match self.send_with_retries(request, *structure, &mut attempts) {
                Ok(reply) => {
                    if rejection.is_some() {
                        self.structure.fetch_max(*structure as usize, Ordering::Relaxed);
                    }
                    return Ok(reply);
                }
                // Keep the first rejection: later requests ask for less.
                Err(error) if refuses_structure(&error) => rejection = rejection.or(Some(error)),
                Err(error) => return Err(error),
            }
        }
        Err(rejection.unwrap_or(ChatError::NoText { finish_reason: "none".into() }))
    }
}
