//! Access control: the token that a server on a public address requires.

use axum::http::header::{AUTHORIZATION, COOKIE};
use axum::http::{HeaderMap, Uri};
use genmanip_core::hexadecimal;
use sha2::{Digest, Sha256};
use std::io::Read;

/// Name of the cookie with the token, by which a browser can request the page's files without a token in their URLs.
const COOKIE_NAME: &str = "genmanip_studio";

/// Secret that every request must contain: in the `Authorization` header (`Bearer …`), a cookie, or the URL.
#[derive(Clone, Debug)]
pub struct Token {
    text: String,
    digest: [u8; 32],
}

impl Token {
    /// A new random token (128 bits from the system's generator).
    ///
    /// # Errors
    /// When `/dev/urandom` cannot be read.
    pub fn random() -> std::io::Result<Self> {
        let mut bytes = [0; 16];
        std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        Ok(Self::new(&hexadecimal(&bytes)))
    }

    /// The token with a given text.
    pub fn new(text: &str) -> Self {
        Self { text: text.to_owned(), digest: digest(text) }
    }

    /// Text of the token.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// True if a request contains the token.
    pub fn is_held(&self, headers: &HeaderMap, uri: &Uri) -> bool {
        let text = |name| headers.get_all(name).into_iter().filter_map(|value| value.to_str().ok());
        let mut bearers = text(AUTHORIZATION).filter_map(|value| value.strip_prefix("Bearer "));
        let mut cookies =
            text(COOKIE).flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
        bearers.any(|given| self.is(given))
            || self.is_in_address(uri)
            || cookies.any(|(name, given)| name == COOKIE_NAME && self.is(given))
    }

    /// True if the URL's query contains the token, as `token=…`.
    pub fn is_in_address(&self, uri: &Uri) -> bool {
        let mut pairs = uri.query().unwrap_or_default().split('&').filter_map(|pair| pair.split_once('='));
        pairs.any(|(name, given)| name == "token" && self.is(given))
    }

    /// Value of the `Set-Cookie` header that stores the token in a browser.
    pub fn cookie(&self) -> String {
        format!("{COOKIE_NAME}={}; Path=/; HttpOnly; SameSite=Strict", self.text)
    }

    /// Compares digests, so that the time of the comparison reveals nothing about the secret.
    fn is(&self, given: &str) -> bool {
        digest(given) == self.digest
    }
}

fn digest(text: &str) -> [u8; 32] {
    Sha256::digest(text.as_bytes()).into()
}
