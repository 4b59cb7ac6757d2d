//! The API key: read from the environment, sent in one header, and shown nowhere.

use crate::error::SettingsError;

/// A key that prints as `ApiKey(hidden)` and can clean texts that others have put it into.
#[derive(Clone, PartialEq, Eq)]
pub struct ApiKey(String);

impl ApiKey {
    /// Takes a key.
    ///
    /// # Errors
    /// A key is 8 to 4096 visible ASCII characters; the message does not show what was given.
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
    /// Names the variable when it is unset or holds no key.
    pub fn from_environment(variable: &str) -> Result<Self, SettingsError> {
        match std::env::var(variable) {
            Ok(key) if !key.trim().is_empty() => Self::new(&key),
            _ => Err(SettingsError::MissingKey { variable: variable.to_owned() }),
        }
    }

    /// The value of the header that carries the key: the name of the scheme, if any, and the key.
    pub(crate) fn after(&self, scheme: &str) -> String {
        format!("{scheme}{}", self.0)
    }

    /// The text with every occurrence of the key replaced; servers like to quote what they were sent.
    pub fn redact(&self, text: &str) -> String {
        text.replace(&self.0, "[key hidden]")
    }

    /// Whether a text holds the key, also as it is written inside JSON.
    pub fn is_in(&self, text: &str) -> bool {
        let in_json = self.0.replace('\\', "\\\\").replace('"', "\\\"");
        text.contains(&self.0) || text.contains(&in_json)
    }
}

impl std::fmt::Debug for ApiKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("ApiKey(hidden)")
    }
}
