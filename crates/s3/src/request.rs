//! One signed request, and what became of it.

use std::io::Read;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use sha2::{Digest, Sha256};

use crate::access::{Access, Endpoint};
use crate::sign::{Unsigned, authorization, encoded, hex, time};

/// Longest text of an error that is read, bytes.
const LONGEST_ERROR: u64 = 64 << 10;
/// Longest time to a connection, s. Chosen.
const CONNECT_S: u64 = 10;
/// Longest time of a whole request, s: a part of 16 MiB at 60 KB/s. Chosen.
const REQUEST_S: u64 = 300;

/// A request to a bucket.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Request<'a> {
    /// Upper case.
    pub(crate) method: &'static str,
    /// Name of the object, not encoded.
    pub(crate) key: &'a str,
    /// Names and values, not encoded, sorted by name.
    pub(crate) query: &'a [(&'static str, String)],
    /// Hash of a file, to be kept with its object.
    pub(crate) file_sha256: Option<&'a str>,
    pub(crate) body: &'a [u8],
}

/// A try that failed.
#[derive(Debug)]
pub(crate) struct Trouble {
    pub(crate) message: String,
    /// Of HTTP, where there was an answer.
    pub(crate) status: Option<u16>,
    /// Whether another try could do better.
    pub(crate) passes: bool,
}

/// Connections to one bucket.
#[derive(Debug)]
pub(crate) struct Connection {
    agent: ureq::Agent,
    access: Access,
    scheme: &'static str,
    host: String,
    /// Leads to the bucket, encoded: a slash and its name, or nothing where the host is the bucket's own.
    bucket: String,
}

/// An answer that is no error.
pub(crate) type Answer = ureq::http::Response<ureq::Body>;

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
            // Names with dots have no certificate of their own.
            None if bucket.contains('.') => {
                ("https", format!("s3.{}.amazonaws.com", access.region), format!("/{bucket}"))
            }
            None => ("https", format!("{bucket}.s3.{}.amazonaws.com", access.region), String::new()),
        };
        Self { agent: config.build().new_agent(), access, scheme, host, bucket }
    }

    /// Where an object lies, for people.
    pub(crate) fn url(&self, key: &str) -> String {
        format!("{}://{}{}/{key}", self.scheme, self.host, self.bucket)
    }

    /// Sends a request; the answer to it, its body not read yet.
    pub(crate) fn send(&self, request: &Request) -> Result<Answer, Trouble> {
        let path = format!("{}/{}", self.bucket, encoded(request.key, true));
        let query: Vec<String> = request
            .query
            .iter()
            .map(|(name, value)| format!("{}={}", encoded(name, false), encoded(value, false)))
            .collect();
        let query = query.join("&");
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let (now, payload) = (time(now), hex(&Sha256::digest(request.body)));
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
        let answer = sent.map_err(|error| Trouble::lasting(error.to_string()))?.map_err(Trouble::of)?;
        let status = answer.status().as_u16();
        match status {
            200..=299 => Ok(answer),
            _ => {
                let mut text = String::new();
                let _ = answer.into_body().into_reader().take(LONGEST_ERROR).read_to_string(&mut text);
                let passes = matches!(status, 408 | 425 | 429 | 500..=599) || code(&text) == Some("RequestTimeout");
                Err(Trouble { message: in_words(&text), status: Some(status), passes })
            }
        }
    }

    /// Sends a request and reads the whole answer, which may have so many bytes.
    pub(crate) fn text(&self, request: &Request, most: u64) -> Result<String, Trouble> {
        let answer = self.send(request)?;
        let mut text = String::new();
        let read = answer.into_body().into_reader().take(most).read_to_string(&mut text);
        read.map(|_| text).map_err(|error| Trouble::passing(error.to_string()))
    }
}

impl Trouble {
    pub(crate) fn passing(message: String) -> Self {
        Self { message, status: None, passes: true }
    }

    pub(crate) fn lasting(message: String) -> Self {
        Self { message, status: None, passes: false }
    }

    fn of(error: ureq::Error) -> Self {
        let passes = matches!(
            error,
            ureq::Error::Timeout(_)
                | ureq::Error::Io(_)
                | ureq::Error::Protocol(_)
                | ureq::Error::BodyStalled
                | ureq::Error::ConnectionFailed
                | ureq::Error::HostNotFound
        );
        Self { message: error.to_string(), status: None, passes }
    }
}

/// What stands in an element of an answer, entities undone; elements of S3's answers have no attributes.
pub(crate) fn element(text: &str, name: &str) -> Option<String> {
    let (_, rest) = text.split_once(&format!("<{name}>"))?;
    let (inside, _) = rest.split_once(&format!("</{name}>"))?;
    let entities = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];
    Some(entities.iter().fold(inside.trim().to_owned(), |text, (entity, sign)| text.replace(entity, sign)))
}

fn code(text: &str) -> Option<&str> {
    text.split_once("<Code>")?.1.split_once("</Code>").map(|(code, _)| code)
}

/// An error of S3 in a line; the answer's beginning where it is none.
pub(crate) fn in_words(text: &str) -> String {
    match (element(text, "Code"), element(text, "Message")) {
        (Some(code), Some(message)) => format!("{code}: {message}"),
        (Some(code), None) => code,
        _ if text.trim().is_empty() => "(no message)".into(),
        _ => text.trim().chars().take(200).collect::<String>().replace('\n', " "),
    }
}
