//! Objects of one bucket: asked for, sent, fetched, each as often as it takes within bounds.

use std::io::{Read, Write};
use std::time::Duration;

use sha2::{Digest, Sha256};

use crate::request::{Answer, Connection, Request, Trouble, element, in_words};
use crate::sign::hex;
use crate::{Access, S3Error};

/// Larger files are sent in parts of this size, bytes; S3 takes parts of 5 MiB to 5 GiB, and 10,000 of them. Chosen.
pub(crate) const PART: u64 = 16 << 20;
/// Most parts of an object.
const MOST_PARTS: u64 = 10_000;
/// Longest answer that is no object, bytes.
const LONGEST_ANSWER: u64 = 1 << 20;

/// How often and how long it is tried.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// Tries of one request.
    pub tries: u32,
    /// Before the second try; doubled before each further one.
    pub first_wait: Duration,
    /// Longest wait between two tries.
    pub longest_wait: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        // Chosen: a minute in all.
        Self { tries: 9, first_wait: Duration::from_millis(250), longest_wait: Duration::from_secs(15) }
    }
}

/// A bucket.
#[derive(Debug)]
pub struct Bucket {
    connection: Connection,
    patience: Patience,
}

/// What an object is, as far as the server tells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct About {
    pub(crate) bytes: u64,
    /// Of the file that it was made of.
    pub(crate) sha256: Option<String>,
}

impl Bucket {
    /// A bucket that exists.
    pub fn new(name: &str, access: Access, patience: Patience) -> Self {
        Self { connection: Connection::new(name, access), patience }
    }

    pub(crate) fn url(&self, key: &str) -> String {
        self.connection.url(key)
    }

    /// What is there under a name.
    pub(crate) fn about(&self, key: &str) -> Result<Option<About>, S3Error> {
        let request = Request { method: "HEAD", key, query: &[], file_sha256: None, body: &[] };
        let asked = self.tried(&format!("asking for {}", self.url(key)), || {
            let answer = self.connection.send(&request)?;
            let header = |name: &str| answer.headers().get(name).and_then(|value| value.to_str().ok());
            let bytes = header("content-length").and_then(|bytes| bytes.parse().ok());
            let bytes = bytes.ok_or_else(|| Trouble::lasting("an answer without content-length".into()))?;
            Ok(About { bytes, sha256: header("x-amz-meta-sha256").map(str::to_owned) })
        });
        match asked {
            Err(S3Error::Refused { status: 404, .. }) => Ok(None),
            asked => asked.map(Some),
        }
    }

    /// Sends an object that is small enough for one request.
    pub(crate) fn put(&self, key: &str, bytes: &[u8], sha256: &str) -> Result<(), S3Error> {
        let request = Request { method: "PUT", key, query: &[], file_sha256: Some(sha256), body: bytes };
        self.tried(&format!("sending {}", self.url(key)), || self.connection.text(&request, LONGEST_ANSWER).map(drop))
    }

    /// Sends an object of so many bytes in parts, of which one at a time is held in memory; gives the hash of what was
    /// read.
    pub(crate) fn put_in_parts(
        &self,
        key: &str,
        (bytes, sha256): (u64, &str),
        read: &mut dyn FnMut(&mut [u8]) -> Result<(), S3Error>,
    ) -> Result<String, S3Error> {
        let what = format!("sending {} in parts", self.url(key));
        let begin = [("uploads", String::new())];
        let begin = Request { method: "POST", key, query: &begin, file_sha256: Some(sha256), body: &[] };
        let begun = self.tried(&what, || self.connection.text(&begin, LONGEST_ANSWER))?;
        let Some(upload) = element(&begun, "UploadId").filter(|id| !id.is_empty()) else {
            return Err(S3Error::Answer { what, expected: "an UploadId", got: in_words(&begun) });
        };
        let sent = self.send_parts(key, (bytes, &what), &upload, read).and_then(|(parts, hash)| {
            self.complete(key, (sha256, &what), &upload, &parts)?;
            Ok(hash)
        });
        if sent.is_err() {
            // Best effort: parts that stay cost their owner.
            let query = [("uploadId", upload)];
            let _ = self
                .connection
                .text(&Request { method: "DELETE", key, query: &query, file_sha256: None, body: &[] }, LONGEST_ANSWER);
        }
        sent
    }

    /// The tags of the parts, and the hash of all.
    fn send_parts(
        &self,
        key: &str,
        (bytes, what): (u64, &str),
        upload: &str,
        read: &mut dyn FnMut(&mut [u8]) -> Result<(), S3Error>,
    ) -> Result<(Vec<String>, String), S3Error> {
        let size = PART.max(bytes.div_ceil(MOST_PARTS));
        let (mut hasher, mut tags, mut left) = (Sha256::new(), Vec::new(), bytes);
        let mut part = Vec::new();
        while left > 0 {
            part.resize(size.min(left) as usize, 0);
            read(&mut part)?;
            hasher.update(&part);
            let number = tags.len() + 1;
            // Sorted: capitals come after no small letter here.
            let query = [("partNumber", number.to_string()), ("uploadId", upload.to_owned())];
            let request = Request { method: "PUT", key, query: &query, file_sha256: None, body: &part };
            let tag = self.tried(what, || {
                let answer = self.connection.send(&request)?;
                let tag = answer.headers().get("etag").and_then(|tag| tag.to_str().ok());
                tag.map(str::to_owned).ok_or_else(|| Trouble::lasting("an answer without etag".into()))
            })?;
            tags.push(tag);
            left -= part.len() as u64;
        }
        Ok((tags, hex(&hasher.finalize())))
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
        let completed = self.tried(what, || {
            // An answer that begins well may still end in an error.
            let text = self.connection.text(&request, LONGEST_ANSWER)?;
            if text.contains("<Error>") { Err(Trouble::passing(in_words(&text))) } else { Ok(()) }
        });
        match completed {
            // The answer to a try before may have been lost: servers say then that there is no such upload, or that it is
            // nobody's.
            Err(S3Error::Refused { .. }) if matches!(self.about(key), Ok(Some(about)) if about.sha256.as_deref() == Some(sha256)) => {
                Ok(())
            }
            completed => completed,
        }
    }

    /// Fetches an object of at most so many bytes into what `begin` gives anew for each try; its hash. `None` when there
    /// is no such object.
    pub(crate) fn fetch<W: Write>(
        &self,
        key: &str,
        most: u64,
        mut begin: impl FnMut() -> Result<W, S3Error>,
        wanted: impl Fn(u64, &str) -> bool,
    ) -> Result<Option<W>, S3Error> {
        let request = Request { method: "GET", key, query: &[], file_sha256: None, body: &[] };
        let mut broken = None;
        let fetched = self.tried(&format!("fetching {}", self.url(key)), || {
            let answer = self.connection.send(&request)?;
            let mut into = match begin() {
                Ok(into) => into,
                Err(error) => {
                    let trouble = Trouble::lasting(error.to_string());
                    broken = Some(error);
                    return Err(trouble);
                }
            };
            let (bytes, hash) = copied(answer, most, &mut into)?;
            match wanted(bytes, &hash) {
                true => Ok(into),
                false => Err(Trouble::passing(format!("{bytes} bytes with another hash came"))),
            }
        });
        match (fetched, broken) {
            (Err(_), Some(error)) => Err(error),
            (Err(S3Error::Refused { status: 404, .. }), _) => Ok(None),
            (fetched, _) => fetched.map(Some),
        }
    }

    /// Tries until it works, waiting longer each time.
    fn tried<T>(&self, what: &str, mut once: impl FnMut() -> Result<T, Trouble>) -> Result<T, S3Error> {
        let Patience { tries, first_wait, longest_wait } = self.patience;
        let mut wait = first_wait;
        let mut number = 1;
        loop {
            match once() {
                Ok(done) => return Ok(done),
                Err(Trouble { message, status: Some(status), passes: false }) => {
                    return Err(S3Error::Refused { what: what.into(), status, message });
                }
                Err(Trouble { message, status, passes }) if !passes || number >= tries => {
                    let last = status.map_or_else(|| message.clone(), |status| format!("{status} {message}"));
                    return Err(S3Error::GaveUp { what: what.into(), tries: number, last });
                }
                Err(_) => std::thread::sleep(wait),
            }
            number += 1;
            wait = (wait * 2).min(longest_wait);
        }
    }
}

/// Copies a body; how many bytes, and their hash.
fn copied(answer: Answer, most: u64, into: &mut impl Write) -> Result<(u64, String), Trouble> {
    let (mut hasher, mut bytes, mut buffer) = (Sha256::new(), 0, vec![0; 64 << 10]);
    let mut reader = answer.into_body().into_reader();
    loop {
        let count = reader.read(&mut buffer).map_err(|error| Trouble::passing(error.to_string()))?;
        if count == 0 {
            return Ok((bytes, hex(&hasher.finalize())));
        }
        bytes += count as u64;
        if bytes > most {
            return Err(Trouble::lasting(format!("more than {most} bytes came")));
        }
        hasher.update(&buffer[..count]);
        into.write_all(&buffer[..count]).map_err(|error| Trouble::lasting(format!("cannot write: {error}")))?;
    }
}
