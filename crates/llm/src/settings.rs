//! Server settings, written by users as TOML.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::dialect::Dialect;
use crate::error::SettingsError;
use crate::reply::Structure;

/// Server settings with limits and retries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServerSettings {
    /// API dialect that the server speaks.
    pub dialect: Dialect,
    /// Base URL up to the dialect's path (`/chat/completions`); user, password and query are rejected, because URLs
    /// appear in errors.
    pub base_url: String,
    /// Model name on the server.
    pub model: String,
    /// Environment variable with the API key; none for servers without authentication.
    pub api_key_env: Option<String>,
    /// Allow sending the key unencrypted to another machine. (To this machine it is always allowed.)
    pub allow_key_over_http: bool,
    /// Timeout of connecting to the server (s).
    pub connect_timeout_s: f64,
    /// Timeout of one whole request, including connecting (s).
    pub total_timeout_s: f64,
    /// Maximum image file size (bytes); a larger one is an error before anything is sent.
    pub max_image_bytes: u64,
    /// Maximum request body size, with images in base64 (bytes); a larger one is an error.
    pub max_request_bytes: u64,
    /// Maximum response size (bytes).
    pub max_body_bytes: u64,
    /// Maximum retries after a transient failure (408, 429, 5xx), a timeout or a broken connection.
    pub max_retries: u32,
    /// Wait before the first retry (s); doubles each time, and is shortened by up to half at random.
    pub first_backoff_s: f64,
    /// Maximum of this wait (s).
    pub max_backoff_s: f64,
    /// Maximum wait that a server may request (`Retry-After`) (s); the client gives up beyond it.
    pub max_retry_after_s: f64,
    /// Strictest structured-output mode to try; looser ones follow if the server rejects it.
    pub structure: Structure,
    /// Additional request body fields, sent verbatim, e.g. `temperature`, `max_tokens`, `seed`.
    pub parameters: Map<String, Value>,
}

impl Default for ServerSettings {
    fn default() -> Self {
        Self {
            dialect: Dialect::OpenAi,                    // what local servers speak
            base_url: "http://127.0.0.1:8080/v1".into(), // llama.cpp's server as it starts
            model: "default".into(),                     // servers with one model ignore the name
            api_key_env: None,                           // local servers want none
            allow_key_over_http: false,                  // a mistyped address must not publish a key
            connect_timeout_s: 10.0,                     // a far server answers within one
            total_timeout_s: 180.0,                      // a thinking model takes a minute or two
            max_image_bytes: 3_750_000,                  // 5 MB in base64, the least that hosted services take
            max_request_bytes: 30_000_000,               // hosted services refuse more than 32 MB
            max_body_bytes: 4 << 20,                     // a hundred times a long answer
            max_retries: 4,                              // 1 + 2 + 4 + 8 s: outlasts a short overload
            first_backoff_s: 1.0,
            max_backoff_s: 30.0,
            max_retry_after_s: 60.0, // limits per minute are common, limits per day not worth waiting for
            structure: Structure::Grammar, // falls back by itself
            parameters: Map::new(),  // some models refuse any; the server's defaults are sensible
        }
    }
}

impl ServerSettings {
    /// Validates the settings.
    ///
    /// # Errors
    /// Names the first invalid field, as in a file with these settings in the table `server`.
    pub fn check(&self) -> Result<(), SettingsError> {
        let invalid = |field, expected: &str| Err(SettingsError::Invalid { field, expected: expected.into() });
        if let Err(expected) = check_address(&self.base_url) {
            return invalid("server.base_url", expected);
        }
        let https = self.base_url.starts_with("https://");
        if let Some(variable) = &self.api_key_env {
            let usual = |byte: u8| byte.is_ascii_uppercase() || byte.is_ascii_digit() || byte == b'_';
            if variable.is_empty() || variable.len() > 64 || !variable.bytes().all(usual) {
                return invalid("server.api_key_env", "the name of a variable (A-Z, 0-9, _), not the key itself");
            }
            if !https && !self.is_loopback() && !self.allow_key_over_http {
                return invalid("server.base_url", "https:// (or `allow_key_over_http = true`), since a key is sent");
            }
        }
        let positive = [
            ("server.connect_timeout_s", self.connect_timeout_s),
            ("server.total_timeout_s", self.total_timeout_s),
            ("server.first_backoff_s", self.first_backoff_s),
            ("server.max_backoff_s", self.max_backoff_s),
        ];
        for (field, seconds) in positive {
            if !(seconds > 0.0 && seconds <= 86_400.0) {
                return invalid(field, "seconds, more than 0 and at most a day");
            }
        }
        if !(0.0..=86_400.0).contains(&self.max_retry_after_s) {
            return invalid("server.max_retry_after_s", "seconds, from 0 to a day");
        }
        if !(1..=1 << 30).contains(&self.max_body_bytes) {
            return invalid("server.max_body_bytes", "1 to 1073741824");
        }
        if !(1..=1 << 30).contains(&self.max_request_bytes) {
            return invalid("server.max_request_bytes", "1 to 1073741824");
        }
        if !(1..=self.max_request_bytes).contains(&self.max_image_bytes) {
            return invalid("server.max_image_bytes", "1 up to `server.max_request_bytes`");
        }
        if self.max_retries > 20 {
            return invalid("server.max_retries", "0 to 20");
        }
        let reserved = self.dialect.wire().reserved();
        if reserved.iter().any(|name| self.parameters.contains_key(*name)) {
            return invalid("server.parameters", &format!("fields other than {}", reserved.join(", ")));
        }
        Ok(())
    }

    /// True if the server is on this machine.
    pub(crate) fn is_loopback(&self) -> bool {
        is_loopback(&self.base_url)
    }
}

/// Validates a URL, which appears in errors; `Err` contains the expectation.
pub(crate) fn check_address(url: &str) -> Result<(), &'static str> {
    let Some((scheme, rest)) = url.split_once("://").filter(|(scheme, _)| matches!(*scheme, "http" | "https")) else {
        return Err("an address that begins with http:// or https://");
    };
    if scheme == "https" && !cfg!(feature = "https") {
        return Err("http://, because this program was built without the feature `https`");
    }
    if rest.is_empty() || rest.contains(['@', '?', '#']) || rest.contains(char::is_whitespace) {
        return Err("host and path only: no user, password, query or space");
    }
    Ok(())
}

/// True if a URL is on this machine.
pub(crate) fn is_loopback(url: &str) -> bool {
    let authority = url.split("://").nth(1).unwrap_or_default().split('/').next().unwrap_or_default();
    let host = match authority.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => authority.split(':').next().unwrap_or_default(),
    };
    host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Parses TOML settings without ever showing a value, which may be a key.
///
/// # Errors
/// Names the line.
pub fn from_toml<T: DeserializeOwned>(text: &str) -> Result<T, SettingsError> {
    toml::from_str(text).map_err(|error| {
        let start = error.span().map_or(0, |span| span.start);
        let line = text.get(..start).map_or(1, |before| before.matches('\n').count() + 1);
        SettingsError::NotSettings { line, message: without_values(error.message()) }
    })
}

/// Removes values from the parser's message: quoted values (`string "…"`) and wrong variants (`` variant `…` ``).
fn without_values(message: &str) -> String {
    let line = message.lines().next().unwrap_or_default();
    let hidden = |before: &str, quote: char| {
        let (start, rest) = line.split_once(before)?;
        let (_, end) = rest.rsplit_once(quote).filter(|_| quote == '"').or_else(|| rest.split_once(quote))?;
        Some(format!("{start}(value hidden){end}"))
    };
    hidden("\"", '"').or_else(|| hidden("variant `", '`')).unwrap_or_else(|| line.to_owned())
}
