//! Requests to one bucket with bounded retries: head, put, multipart upload, get.

use std::io::{Read, Write};
use std::time::Duration;

use sha2::{Digest, Sha256};

use crate::request::{AttemptError, Connection, Request, Response, element, error_message};
use crate::{Access, S3Error};
use genmanip_core::hexadecimal;

/// Part size of multipart uploads, bytes; S3 allows 10,000 parts of 5 MiB to 5 GiB. Chosen by hand.
pub(crate) const PART: u64 = 16 << 20;
/// Maximum number of parts of an object. A limit of S3.
const MAX_PARTS: u64 = 10_000;
/// Maximum length of a response other than an object, bytes.
const MAX_RESPONSE: u64 = 1 << 20;

/// Number of attempts per request, and delays between them.
#[derive(Clone, Copy, Debug)]
pub struct RetryPolicy {
    /// Maximum number of attempts per request.
    pub attempts: u32,
    /// Delay before the second attempt; doubles before each further one.
    pub initial_delay: Duration,
    /// Maximum delay between two attempts.
    pub max_delay: Duration,
}

impl Default for RetryPolicy {
    fn default() -> Self {
        // About a minute of delays in total. Chosen by hand.
        Self { attempts: 9, initial_delay: Duration::from_millis(250), max_delay: Duration::from_secs(15) }
    }
}

/// A bucket with its connection and retry policy.
#[derive(Debug)]
pub struct Bucket {
    connection: Connection,
    retry_policy: RetryPolicy,
}

/// Metadata of an object, from a HEAD request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ObjectInfo {
    pub(crate) bytes: u64,
    /// SHA-256 of the uploaded file, from the object's metadata; `None` if it was uploaded by another program.
    pub(crate) sha256: Option<String>,
}

impl Bucket {
    /// Handle of an existing bucket; sends no request.
    pub fn new(name: &str, access: Access, retry_policy: RetryPolicy) -> Self {
        Self { connection: Connection::new(name, access), retry_policy }
    }

    pub(crate) fn url(&self, key: &str) -> String {
        self.connection.url(key)
    }

    /// Metadata of an object; `None` if it does not exist.
    pub(crate) fn head(&self, key: &str) -> Result<Option<ObjectInfo>, S3Error> {
        let request = Request { method: "HEAD", key, query: &[], file_sha256: None, body: &[] };
        let info = self.with_retries(&format!("requesting {}", self.url(key)), || {
            let response = self.connection.send(&request)?;
            let header = |name: &str| response.headers().get(name).and_then(|value| value.to_str().ok());
            let bytes = header("content-length").and_then(|bytes| bytes.parse().ok());
            let bytes = bytes.ok_or_else(|| AttemptError::permanent("a response without content-length".into()))?;
            Ok(ObjectInfo { bytes, sha256: header("x-amz-meta-sha256").map(str::to_owned) })
        });
        match info {
            Err(S3Error::Refused { status: 404, .. }) => Ok(None),
            info => info.map(Some),
        }
    }

    /// Uploads an object with a single request.
    pub(crate) fn put(&self, key: &str, bytes: &[u8], sha256: &str) -> Result<(), S3Error> {
        let request = Request { method: "PUT", key, query: &[], file_sha256: Some(sha256), body: bytes };
        self.with_retries(&format!("uploading {}", self.url(key)), || {
            self.connection.text(&request, MAX_RESPONSE).map(drop)
        })
    }

    /// Uploads an object of `bytes` bytes in parts, one of which is held in memory at a time; returns the SHA-256 of
    /// the uploaded bytes.
    pub(crate) fn put_in_parts(
        &self,
        key: &str,
        (bytes, sha256): (u64, &str),
        read: &mut dyn FnMut(&mut [u8]) -> Result<(), S3Error>,
    ) -> Result<String, S3Error> {
        let what = format!("uploading {} in parts", self.url(key));
        let begin = [("uploads", String::new())];
        let begin = Request { method: "POST", key, query: &begin, file_sha256: Some(sha256), body: &[] };
        let begun = self.with_retries(&what, || self.connection.text(&begin, MAX_RESPONSE))?;
        let Some(upload) = element(&begun, "UploadId").filter(|id| !id.is_empty()) else {
            return Err(S3Error::InvalidResponse { what, expected: "an UploadId", got: error_message(&begun) });
        };
        let sent = self.send_parts(key, (bytes, &what), &upload, read).and_then(|(parts, hash)| {
            self.complete(key, (sha256, &what), &upload, &parts)?;
            Ok(hash)
        });
        if sent.is_err() {
            // Best effort to abort the upload: the owner of the bucket is billed for remaining parts.
            let query = [("uploadId", upload)];
            let _ = self
                .connection
                .text(&Request { method: "DELETE", key, query: &query, file_sha256: None, body: &[] }, MAX_RESPONSE);
        }
        sent
    }

    /// Uploads the parts; returns their ETags and the SHA-256 of the whole.
    fn send_parts(
        &self,
        key: &str,
        (bytes, what): (u64, &str),
        upload: &str,
        read: &mut dyn FnMut(&mut [u8]) -> Result<(), S3Error>,
    ) -> Result<(Vec<String>, String), S3Error> {
        let size = PART.max(bytes.div_ceil(MAX_PARTS));
        let (mut hasher, mut tags, mut left) = (Sha256::new(), Vec::new(), bytes);
        let mut part = Vec::new();
        while left > 0 {
            part.resize(size.min(left) as usize, 0);
            read(&mut part)?;
            hasher.update(&part);
            let number = tags.len() + 1;
            // Sorted by name, as signing requires.
            let query = [("partNumber", number.to_string()), ("uploadId", upload.to_owned())];
            let request = Request { method: "PUT", key, query: &query, file_sha256: None, body: &part };
            let tag = self.with_retries(what, || {
                let response = self.connection.send(&request)?;
                let tag = response.headers().get("etag").and_then(|tag| tag.to_str().ok());
                tag.map(str::to_owned).ok_or_else(|| AttemptError::permanent("a response without etag".into()))
            })?;
            tags.push(tag);
            left -= part.len() as u64;
        }
        Ok((tags, hexadecimal(&hasher.finalize())))
    }

    fn complete(&self, key: &str, (sha256, what): (&str, &str), upload: &str, tags: &[String]) -> Result<(), S3Error> {
        let part = |(index, tag): (usize, &String)| {
            let tag = tag.replace('&', "&amp;").replace('<', "&lt;");
            format!("<Part><PartNumber>{}</PartNumber><ETag>{tag}</ETag></Part>", index + 1)
        };
        let parts: String = tags.iter().enumerate().map(part).collect();
        let body = format!(
            "<CompleteMultipartUpload xmlns=\"http://s3.amazonaws.com/doc/2006-03-01/\">{parts}</CompleteMultipartUpload>"
        );
        let query = [("uploadId", upload.to_owned())];
        let request = Request { method: "POST", key, query: &query, file_sha256: None, body: body.as_bytes() };
        let completed = self.with_retries(what, || {
            // A 200 response to a completion may still contain an error.
            let text = self.connection.text(&request, MAX_RESPONSE)?;
            if text.contains("<Error>") { Err(AttemptError::transient(error_message(&text))) } else { Ok(()) }
        });
        match completed {
            // The response to an earlier attempt may have been lost; servers then report that the upload does not
            // exist or is not accessible.
            Err(S3Error::Refused { .. }) if matches!(self.head(key), Ok(Some(about)) if about.sha256.as_deref() == Some(sha256)) => {
                Ok(())
            }
            completed => completed,
        }
    }

    /// Downloads an object of at most `most` bytes into a new writer per attempt, and returns the writer once `wanted`
    /// accepts size and SHA-256. `None` if there is no such object.
    pub(crate) fn fetch<W: Write>(
        &self,
        key: &str,
        most: u64,
        mut begin: impl FnMut() -> Result<W, S3Error>,
        wanted: impl Fn(u64, &str) -> bool,
    ) -> Result<Option<W>, S3Error> {
        let request = Request { method: "GET", key, query: &[], file_sha256: None, body: &[] };
        let mut broken = None;
        let fetched = self.with_retries(&format!("downloading {}", self.url(key)), || {
            let response = self.connection.send(&request)?;
            let mut into = match begin() {
                Ok(into) => into,
                Err(error) => {
                    let failure = AttemptError::permanent(error.to_string());
                    broken = Some(error);
                    return Err(failure);
                }
            };
            let (bytes, hash) = copy_body(response, most, &mut into)?;
            match wanted(bytes, &hash) {
                true => Ok(into),
                false => Err(AttemptError::transient(format!("received {bytes} bytes with a different hash"))),
            }
        });
        match (fetched, broken) {
            (Err(_), Some(error)) => Err(error),
            (Err(S3Error::Refused { status: 404, .. }), _) => Ok(None),
            (fetched, _) => fetched.map(Some),
        }
    }

    /// Retries a request with exponential backoff.
    fn with_retries<T>(&self, what: &str, mut once: impl FnMut() -> Result<T, AttemptError>) -> Result<T, S3Error> {
        let RetryPolicy { attempts, initial_delay, max_delay } = self.retry_policy;
        let mut wait = initial_delay;
        let mut number = 1;
        loop {
            match once() {
                Ok(done) => return Ok(done),
                Err(AttemptError { message, status: Some(status), is_transient: false }) => {
                    return Err(S3Error::Refused { what: what.into(), status, message });
                }
                Err(AttemptError { message, status, is_transient }) if !is_transient || number >= attempts => {
                    let last = status.map_or_else(|| message.clone(), |status| format!("{status} {message}"));
                    return Err(S3Error::GaveUp { what: what.into(), attempts: number, last });
                }
                Err(_) => std::thread::sleep(wait),
            }
            number += 1;
            wait = (wait * 2).min(max_delay);
        }
    }
}

/// Copies the body of a response; returns its size and SHA-256.
fn copy_body(response: Response, most: u64, into: &mut impl Write) -> Result<(u64, String), AttemptError> {
    let (mut hasher, mut bytes, mut buffer) = (Sha256::new(), 0, vec![0; 64 << 10]);
    let mut reader = response.into_body().into_reader();
    loop {
        let count = reader.read(&mut buffer).map_err(|error| AttemptError::transient(error.to_string()))?;
        if count == 0 {
            return Ok((bytes, hexadecimal(&hasher.finalize())));
        }
        bytes += count as u64;
        if bytes > most {
            return Err(AttemptError::permanent(format!("received more than {most} bytes")));
        }
        hasher.update(&buffer[..count]);
        into.write_all(&buffer[..count]).map_err(|error| AttemptError::permanent(format!("cannot write: {error}")))?;
    }
}
