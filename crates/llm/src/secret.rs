//! API key handling: read from the environment, sent in one header, never displayed.

use crate::error::SettingsError;

/// An API key that prints as `ApiKey(hidden)` and can be redacted from texts.
#[derive(Clone, PartialEq, Eq)]
pub struct ApiKey(String);

impl ApiKey {
    /// Validates a key.
    ///
    /// # Errors
    /// Fails unless the key has 8 to 4096 visible ASCII characters; the message does not contain the key.
    pub fn new(key: &str) -> Result<Self, SettingsError> {
        let key = key.trim();
        if (8..=4096).contains(&key.len()) && key.bytes().all(|byte| byte.is_ascii_graphic()) {
            Ok(Self(key.to_owned()))
        } else {
            Err(SettingsError::BadKey)
        }
    }

    /// Reads the key from an environment variable.
    ///
    /// # Errors
    /// Names the variable if it is unset or contains no valid key.
    pub fn from_environment(variable: &str) -> Result<Self, SettingsError> {
        match std::env::var(variable) {
            Ok(key) if !key.trim().is_empty() => Self::new(&key),
            _ => Err(SettingsError::MissingKey { variable: variable.to_owned() }),
        }
    }

    /// Value of the authentication header: scheme and key.
    pub(crate) fn header_value(&self, scheme: &str) -> String {
        format!("{scheme}{}", self.0)
    }

    /// Redacts the key in a text; servers may echo it.
    pub fn redact(&self, text: &str) -> String {
        text.replace(&self.0, "[key hidden]")
    }

    /// True if a text contains the key, plain or JSON-escaped.
    pub fn occurs_in(&self, text: &str) -> bool {
        let in_json = self.0.replace('\\', "\\\\").replace('"', "\\\"");
        text.contains(&self.0) || text.contains(&in_json)
    }
}

impl std::fmt::Debug for ApiKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("ApiKey(hidden)")
    }
}
