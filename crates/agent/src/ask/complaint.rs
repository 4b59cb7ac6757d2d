//! Why an answer was not taken.

use serde::{Deserialize, Serialize};

/// Why an answer does not fit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum Complaint {
    /// It is not the JSON object that was asked for.
    #[error("{0}")]
    Format(String),
    /// It names a mark that was not drawn.
    #[error("{0}")]
    Undrawn(String),
    /// It says that no mark fits.
    #[error("it says that no numbered {0} fits; look again, one of them may")]
    NotFound(String),
    /// The thing cannot be put there.
    #[error("{0}")]
    Unusable(String),
}

impl Complaint {
    /// The name under which failures are counted.
    pub fn cause(&self) -> &'static str {
        match self {
            Self::Format(_) => "format",
            Self::Undrawn(_) => "undrawn",
            Self::NotFound(_) => "not_found",
            Self::Unusable(_) => "unusable",
        }
    }
}

/// An answer that was not taken.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refused {
    /// Its beginning.
    pub answer: String,
    /// What was wrong.
    pub complaint: Complaint,
}
