//! What can go wrong between a folder and a bucket.

use std::path::PathBuf;

use genmanip_core::DocumentError;
use genmanip_data::DataError;

/// What went wrong.
#[derive(Debug, thiserror::Error)]
pub enum S3Error {
    /// A text that is no address of a place in S3.
    #[error("expected s3://BUCKET or s3://BUCKET/PREFIX, got {got:?}: {why}")]
    Address {
        /// The text.
        got: String,
        /// What is wrong with it.
        why: String,
    },
    /// A variable of the environment that is missing or makes no sense.
    #[error("{variable}: expected {expected}, got {got}")]
    Environment {
        /// Its name.
        variable: &'static str,
        /// What it should hold.
        expected: &'static str,
        /// What it holds; never a secret.
        got: String,
    },
    /// The server refused, and would again.
    #[error("{what}: the server answered {status}: {message}")]
    Refused {
        /// What was asked for.
        what: String,
        /// Status of HTTP.
        status: u16,
        /// What it said.
        message: String,
    },
    /// It did not work, however often.
    #[error("{what}: given up after {tries} tries; the last: {last}")]
    GaveUp {
        /// What was asked for.
        what: String,
        /// How often.
        tries: u32,
        /// Why the last try failed.
        last: String,
    },
    /// An answer that is none of S3.
    #[error("{what}: expected {expected}, got {got}")]
    Answer {
        /// What was asked for.
        what: String,
        /// What the answer should hold.
        expected: &'static str,
        /// What it holds.
        got: String,
    },
    /// Nothing complete lies there.
    #[error("there is no {object}: expected the list of files that a push writes last")]
    NotComplete {
        /// The missing object.
        object: String,
    },
    /// A list of files that is none.
    #[error("cannot read the list of files {object}")]
    List {
        /// The object.
        object: String,
        /// What is wrong.
        source: DocumentError,
    },
    /// A file that was written to while it was read.
    #[error("expected a file that stays as it is, it changed while it was sent: {}", .path.display())]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// A file that cannot be an object.
    #[error("expected {expected}, found {found}: {}", .path.display())]
    File {
        /// What was expected.
        expected: &'static str,
        /// What was found.
        found: &'static str,
        /// The file.
        path: PathBuf,
    },
    /// A part was done.
    #[error("{done} of {all} files are {moved}, then it stopped")]
    Stopped {
        /// Files that are where they should be.
        done: usize,
        /// All of them.
        all: usize,
        /// Sent or fetched.
        moved: &'static str,
        /// Why.
        source: Box<S3Error>,
    },
    /// The disk.
    #[error(transparent)]
    Data(#[from] DataError),
}

impl S3Error {
    /// What helps.
    pub fn hint(&self) -> String {
        match self {
            Self::Address { .. } => "for example s3://my-bucket/runs/monday".into(),
            Self::Environment { .. } => {
                "set AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_REGION, and AWS_ENDPOINT_URL for another server \
                 than Amazon's"
                    .into()
            }
            Self::Refused { status: 401 | 403, .. } => {
                "see that the keys in the environment may do this, and that the clock is right".into()
            }
            Self::Refused { status: 404, .. } => "see that the bucket exists; it is not made here".into(),
            Self::NotComplete { .. } => "push the folder again: it goes on where it stopped".into(),
            Self::Stopped { source, .. } => {
                format!("{}; what is there stays, and the same call goes on", source.hint())
            }
            Self::Changed { .. } => "wait until nobody writes into the folder".into(),
            Self::Data(error) => error.hint().unwrap_or_else(|| "see that the disk is not full".into()),
            Self::File { .. } => "move it out of the folder".into(),
            Self::List { .. } => "push the folder again".into(),
            Self::Refused { .. } | Self::GaveUp { .. } | Self::Answer { .. } => {
                "see that the server is up and AWS_ENDPOINT_URL names it".into()
            }
        }
    }
}
