//! Signed requests and their responses.

use std::io::Read;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use sha2::{Digest, Sha256};

use crate::access::{Access, Endpoint};
use crate::sign::{Unsigned, authorization, encoded, time};
use genmanip_core::hexadecimal;

/// Maximum length of an error text, bytes. Chosen by hand.
const MAX_ERROR_BYTES: u64 = 64 << 10;
/// Connection timeout, s. Chosen by hand.
const CONNECT_S: u64 = 10;
/// Request timeout, s: long enough for a part of 16 MiB at 60 KB/s. Chosen by hand.
const REQUEST_S: u64 = 300;

/// A request to a bucket, to be signed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Request<'a> {
    /// HTTP method, upper case.
    pub(crate) method: &'static str,
    /// Object key, unencoded.
    pub(crate) key: &'a str,
    /// Query parameters: names and values, unencoded, sorted by name.
    pub(crate) query: &'a [(&'static str, String)],
    /// SHA-256 of the file, to be stored as metadata of the object; `None` for other requests.
    pub(crate) file_sha256: Option<&'a str>,
    pub(crate) body: &'a [u8],
}

/// Failure of one attempt at a request.
#[derive(Debug)]
pub(crate) struct AttemptError {
    pub(crate) message: String,
    /// HTTP status; `None` without a response.
    pub(crate) status: Option<u16>,
    /// True if a retry may succeed.
    pub(crate) is_transient: bool,
}

/// Signed HTTP connections to one bucket.
#[derive(Debug)]
pub(crate) struct Connection {
    agent: ureq::Agent,
    access: Access,
    scheme: &'static str,
    host: String,
    /// Encoded path of the bucket: a slash and its name, or empty for virtual-hosted buckets.
    bucket: String,
}

/// A successful response with its body unread.
pub(crate) type Response = ureq::http::Response<ureq::Body>;

impl Connection {
    pub(crate) fn new(bucket: &str, access: Access) -> Self {
        let config = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .max_redirects(0)
            .max_redirects_will_error(false)
            .timeout_connect(Some(Duration::from_secs(CONNECT_S)))
            .timeout_global(Some(Duration::from_secs(REQUEST_S)))
            .user_agent(concat!("genmanip/", env!("CARGO_PKG_VERSION")));
        #[cfg(feature = "https")]
        let config = {
            let provider = std::sync::Arc::new(rustls::crypto::ring::default_provider());
            let tls = ureq::tls::TlsConfig::builder()
                .root_certs(ureq::tls::RootCerts::PlatformVerifier)
                .unversioned_rustls_crypto_provider(provider);
            config.tls_config(tls.build())
        };
        let (scheme, host, bucket) = match &access.endpoint {
            Some(Endpoint { scheme, host }) => (*scheme, host.clone(), format!("/{bucket}")),
            // Amazon's wildcard certificate does not cover bucket names with dots.
            None if bucket.contains('.') => {
                ("https", format!("s3.{}.amazonaws.com", access.region), format!("/{bucket}"))
            }
            None => ("https", format!("{bucket}.s3.{}.amazonaws.com", access.region), String::new()),
        };
        Self { agent: config.build().new_agent(), access, scheme, host, bucket }
    }

    /// URL of an object, for messages.
    pub(crate) fn url(&self, key: &str) -> String {
        format!("{}://{}{}/{key}", self.scheme, self.host, self.bucket)
    }

    /// Sends a request; the response's body is not read yet.
    pub(crate) fn send(&self, request: &Request) -> Result<Response, AttemptError> {
        let path = format!("{}/{}", self.bucket, encoded(request.key, true));
        let query: Vec<String> = request
            .query
            .iter()
            .map(|(name, value)| format!("{}={}", encoded(name, false), encoded(value, false)))
            .collect();
        let query = query.join("&");
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let (now, payload) = (time(now), hexadecimal(&Sha256::digest(request.body)));
        let mut headers =
            vec![("host", self.host.clone()), ("x-amz-content-sha256", payload.clone()), ("x-amz-date", now.clone())];
        headers.extend(request.file_sha256.map(|hash| ("x-amz-meta-sha256", hash.to_owned())));
        headers.extend(self.access.token.clone().map(|token| ("x-amz-security-token", token)));
        let unsigned = Unsigned { method: request.method, path: &path, query: &query, headers: &headers };
        let signed = authorization(&unsigned, &payload, &now, &self.access);
        let mark = if query.is_empty() { "" } else { "?" };
        let url = format!("{}://{}{path}{mark}{query}", self.scheme, self.host);
        let mut builder = ureq::http::Request::builder().method(request.method).uri(url);
        for (name, value) in headers.iter().filter(|(name, _)| *name != "host") {
            builder = builder.header(*name, value);
        }
        builder = builder.header("authorization", signed);
        let has_body = matches!(request.method, "PUT" | "POST");
        let sent = match has_body {
            true => builder.body(request.body).map(|request| self.agent.run(request)),
            false => builder.body(()).map(|request| self.agent.run(request)),
        };
        let response = sent.map_err(|error| AttemptError::permanent(error.to_string()))?.map_err(AttemptError::of)?;
        let status = response.status().as_u16();
        match status {
            200..=299 => Ok(response),
            _ => {
                let mut text = String::new();
                let _ = response.into_body().into_reader().take(MAX_ERROR_BYTES).read_to_string(&mut text);
                let is_transient =
                    matches!(status, 408 | 425 | 429 | 500..=599) || code(&text) == Some("RequestTimeout");
                Err(AttemptError { message: error_message(&text), status: Some(status), is_transient })
            }
        }
    }

    /// Sends a request and reads the response as text of at most `most` bytes.
    pub(crate) fn text(&self, request: &Request, most: u64) -> Result<String, AttemptError> {
        let response = self.send(request)?;
        let mut text = String::new();
        let read = response.into_body().into_reader().take(most).read_to_string(&mut text);
        read.map(|_| text).map_err(|error| AttemptError::transient(error.to_string()))
    }
}

impl AttemptError {
    pub(crate) fn transient(message: String) -> Self {
        Self { message, status: None, is_transient: true }
    }

    pub(crate) fn permanent(message: String) -> Self {
        Self { message, status: None, is_transient: false }
    }

    fn of(error: ureq::Error) -> Self {
        let is_transient = matches!(
            error,
            ureq::Error::Timeout(_)
                | ureq::Error::Io(_)
                | ureq::Error::Protocol(_)
                | ureq::Error::BodyStalled
                | ureq::Error::ConnectionFailed
                | ureq::Error::HostNotFound
        );
        Self { message: error.to_string(), status: None, is_transient }
    }
}

/// Text of the first XML element of a name, with entities decoded; elements of S3 responses have no attributes. `None`
/// if there is none.
pub(crate) fn element(text: &str, name: &str) -> Option<String> {
    let (_, rest) = text.split_once(&format!("<{name}>"))?;
    let (inside, _) = rest.split_once(&format!("</{name}>"))?;
    let entities = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];
    Some(entities.iter().fold(inside.trim().to_owned(), |text, (entity, sign)| text.replace(entity, sign)))
}

fn code(text: &str) -> Option<&str> {
    text.split_once("<Code>")?.1.split_once("</Code>").map(|(code, _)| code)
}

/// S3 error code and message as one line; the beginning of the response if it is not an S3 error.
pub(crate) fn error_message(text: &str) -> String {
    match (element(text, "Code"), element(text, "Message")) {
        (Some(code), Some(message)) => format!("{code}: {message}"),
        (Some(code), None) => code,
        _ if text.trim().is_empty() => "(no message)".into(),
        _ => text.trim().chars().take(200).collect::<String>().replace('\n', " "),
    }
}
