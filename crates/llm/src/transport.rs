//! Blocking HTTP requests with limits on time and size; the only place that opens HTTP connections.

use std::io::Read;
use std::time::Duration;

use genmanip_core::json::without_mark;
use serde_json::Value;

use crate::dialect::error_message;
use crate::error::{ChatError, shortened};
use crate::retry::retry_after_s;
use crate::secret::ApiKey;

/// Limits on time and size of one request.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    pub connect_timeout_s: f64,
    pub total_timeout_s: f64,
    pub max_body_bytes: u64,
}

/// HTTP client that posts and receives JSON within limits.
#[derive(Debug)]
pub(crate) struct Transport {
    agent: ureq::Agent,
    limits: Limits,
    /// API key, redacted from all messages; `None` for servers without authentication.
    key: Option<ApiKey>,
}

/// A failed attempt, and whether a retry may succeed.
pub(crate) struct Failure {
    pub error: ChatError,
    pub transient: bool,
    pub retry_after_s: Option<f64>,
}

impl Transport {
    pub fn new(limits: Limits, is_loopback: bool, key: Option<ApiKey>) -> Self {
        let mut config = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .max_redirects(0)
            .max_redirects_will_error(false)
            .timeout_connect(Some(Duration::from_secs_f64(limits.connect_timeout_s)))
            .timeout_global(Some(Duration::from_secs_f64(limits.total_timeout_s)))
            .user_agent(concat!("genmanip/", env!("CARGO_PKG_VERSION")));
        if is_loopback {
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
        Self { agent: config.build().new_agent(), limits, key }
    }

    /// Posts a body; returns the JSON of a successful response.
    pub fn post(&self, url: &str, headers: &[(&'static str, String)], body: &str) -> Result<Value, Failure> {
        let mut request = self.agent.post(url).content_type("application/json").header("accept", "application/json");
        for (name, value) in headers {
            request = request.header(*name, value);
        }
        let response = request.send(body).map_err(|error| self.failure(url, error))?;
        let header = |name: &str| response.headers().get(name).and_then(|value| value.to_str().ok());
        let status = response.status().as_u16();
        let content_type = shortened(&self.redact(header("content-type").unwrap_or("no content type")), 100);
        let retry_after_s = retry_after_s(header("retry-after"), header("date"));
        let bytes = self.read(url, response)?;
        // Redact before truncating: half a key is a secret, too.
        let parsed: Result<Value, _> = serde_json::from_slice(without_mark(&bytes)).map(|value| self.redact_all(value));
        let beginning = || shortened(&self.redact(&String::from_utf8_lossy(&bytes)), 120);
        let url = url.to_owned();
        if !(200..300).contains(&status) {
            let message = parsed.ok().as_ref().and_then(error_message).unwrap_or_else(beginning);
            let message = if message.is_empty() { "(no message)".into() } else { message };
            let transient = matches!(status, 408 | 425 | 429 | 500 | 502..=599);
            let error = ChatError::Status { status, message, url };
            return Err(Failure { error, transient, retry_after_s });
        }
        parsed.map_err(|error| {
            if error.is_eof() && !bytes.is_empty() {
                return Failure::transient(ChatError::CutOff { url, message: "the JSON is not complete".into() });
            }
            Failure::permanent(ChatError::NotJson { url, content_type, beginning: beginning() })
        })
    }

    /// Reads at most the allowed number of bytes; dropping the rest closes the connection.
    fn read(&self, url: &str, response: ureq::http::Response<ureq::Body>) -> Result<Vec<u8>, Failure> {
        let limit_bytes = self.limits.max_body_bytes;
        let too_large = || Failure::permanent(ChatError::TooLarge { url: url.to_owned(), limit_bytes });
        let body = response.into_body();
        if body.content_length().is_some_and(|length| length > limit_bytes) {
            return Err(too_large());
        }
        let mut bytes = Vec::new();
        let mut reader = body.into_reader().take(limit_bytes + 1);
        reader.read_to_end(&mut bytes).map_err(|error| self.failure(url, ureq::Error::from(error)))?;
        if bytes.len() as u64 > limit_bytes { Err(too_large()) } else { Ok(bytes) }
    }

    fn failure(&self, url: &str, error: ureq::Error) -> Failure {
        let url = url.to_owned();
        let message = shortened(&self.redact(&error.to_string()), 300);
        match error {
            ureq::Error::Timeout(phase) => {
                let connecting = matches!(phase, ureq::Timeout::Connect | ureq::Timeout::Resolve);
                let limit_s = if connecting { self.limits.connect_timeout_s } else { self.limits.total_timeout_s };
                Failure::transient(ChatError::Timeout { url, limit_s, phase: phase.to_string() })
            }
            ureq::Error::Io(io) if is_unreachable(io.kind()) => {
                Failure::permanent(ChatError::Unreachable { url, message })
            }
            // Name servers often fail only briefly: worth a retry.
            ureq::Error::Io(io) if is_unresolved(&io) => Failure::transient(ChatError::Unreachable { url, message }),
            ureq::Error::Io(_) | ureq::Error::Protocol(_) | ureq::Error::BodyStalled => {
                Failure::transient(ChatError::CutOff { url, message })
            }
            _ => Failure::permanent(ChatError::Unreachable { url, message }),
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

impl Failure {
    pub fn transient(error: ChatError) -> Self {
        Self { error, transient: true, retry_after_s: None }
    }

    pub fn permanent(error: ChatError) -> Self {
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

/// True if the host name cannot be resolved. The standard library has no stable error kind for this, so the text is
/// compared.
fn is_unresolved(error: &std::io::Error) -> bool {
    error.to_string().starts_with("failed to lookup address information")
}

#[cfg(test)]
mod tests {
    use std::io::{Error, ErrorKind};

    use super::*;

    fn failure(error: Error) -> Failure {
        let limits = Limits { connect_timeout_s: 1.0, total_timeout_s: 1.0, max_body_bytes: 1 };
        Transport::new(limits, true, None).failure("http://host/v1", ureq::Error::Io(error))
    }

    #[test]
    fn a_host_without_address_is_not_a_truncated_answer() {
        let unknown = failure(Error::other("failed to lookup address information: Name or service not known"));
        assert!(unknown.error.to_string().starts_with("cannot connect to http://host/v1: "), "{}", unknown.error);
        assert!(unknown.transient);
        let closed = failure(Error::from(ErrorKind::UnexpectedEof));
        assert!(closed.error.to_string().contains("truncated") && closed.transient, "{}", closed.error);
    }
}
