//! Errors of pushing and pulling folders.

use std::path::PathBuf;

use genmanip_core::DocumentError;
use genmanip_data::DataError;

/// Reason why a push or pull failed.
#[derive(Debug, thiserror::Error)]
pub enum S3Error {
    /// An address that is not `s3://BUCKET/PREFIX`.
    #[error("expected s3://BUCKET or s3://BUCKET/PREFIX, got {got:?}: {why}")]
    Address {
        /// Address as given.
        got: String,
        /// Reason why it is invalid.
        why: String,
    },
    /// A missing or invalid environment variable.
    #[error("{variable}: expected {expected}, got {got}")]
    Environment {
        /// Name of the environment variable.
        variable: &'static str,
        /// Expected value, in words.
        expected: &'static str,
        /// Actual value; never a secret.
        got: String,
    },
    /// A permanent refusal by the server.
    #[error("{what}: the server responded {status}: {message}")]
    Refused {
        /// Description of the refused request.
        what: String,
        /// HTTP status of the response.
        status: u16,
        /// Message of the server.
        message: String,
    },
    /// A request that failed in all attempts.
    #[error("{what}: gave up after {attempts} attempts; last error: {last}")]
    GaveUp {
        /// Description of the failing request.
        what: String,
        /// Number of attempts made.
        attempts: u32,
        /// Error of the last attempt.
        last: String,
    },
    /// A response that does not follow the S3 protocol.
    #[error("{what}: expected {expected}, got {got}")]
    InvalidResponse {
        /// Description of the request.
        what: String,
        /// Content that the response should have.
        expected: &'static str,
        /// Content that the response has.
        got: String,
    },
    /// No complete folder at the address.
    #[error("{object} does not exist: expected the file list that a push writes last")]
    NotComplete {
        /// Key of the missing object.
        object: String,
    },
    /// A file list at the address that cannot be parsed.
    #[error("cannot read the file list {object}")]
    List {
        /// Key of the object with the file list.
        object: String,
        /// Parse error with its position.
        source: DocumentError,
    },
    /// A file that changed during the upload.
    #[error("the file changed while it was uploaded: {}", .path.display())]
    Changed {
        /// Path of the local file.
        path: PathBuf,
    },
    /// A file that cannot be stored as an object.
    #[error("expected {expected}, found {found}: {}", .path.display())]
    File {
        /// Kind of file that is expected.
        expected: &'static str,
        /// Kind of file that was found.
        found: &'static str,
        /// Path of the local file.
        path: PathBuf,
    },
    /// A transfer that stopped after some files.
    #[error("stopped after {done} of {all} files were {moved}")]
    Stopped {
        /// Number of files transferred before the failure.
        done: usize,
        /// Number of files to be transferred.
        all: usize,
        /// Verb for the message: `uploaded` or `downloaded`.
        moved: &'static str,
        /// Error that stopped the transfer.
        source: Box<S3Error>,
    },
    /// An error of reading or writing a local file.
    #[error(transparent)]
    Data(#[from] DataError),
}

impl S3Error {
    /// Advice on how to fix the error.
    pub fn hint(&self) -> String {
        match self {
            Self::Address { .. } => "for example s3://my-bucket/runs/monday".into(),
            Self::Environment { .. } => {
                    "set AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_REGION, and AWS_ENDPOINT_URL for a server other than \
                     Amazon's"
                    .into()
            }
            Self::Refused { status: 401 | 403, .. } => {
                "check the permissions of the keys in the environment, and the system clock".into()
            }
            Self::Refused { status: 404, .. } => "check that the bucket exists; it is not created automatically".into(),
            Self::NotComplete { .. } => "push the folder again; it resumes where it stopped".into(),
            Self::Stopped { source, .. } => {
                format!("{}; transferred files are kept, and the same command resumes", source.hint())
            }
            Self::Changed { .. } => "wait until no process writes to the folder".into(),
            Self::Data(error) => error.hint().unwrap_or_else(|| "check the free disk space".into()),
            Self::File { .. } => "move it out of the folder".into(),
            Self::List { .. } => "push the folder again".into(),
            Self::Refused { .. } | Self::GaveUp { .. } | Self::InvalidResponse { .. } => {
                "check that the server is running and that AWS_ENDPOINT_URL points to it".into()
            }
        }
    }
}
