//! Reasons for rejecting an answer.

use genmanip_core::StageCause;
use serde::{Deserialize, Serialize};

/// Reason for rejecting an answer. The message is sent to the model.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum Rejection {
    /// The answer is not the requested JSON object.
    #[error("{0}")]
    Format(String),
    /// The answer names a mark that was not drawn.
    #[error("{0}")]
    Undrawn(String),
    /// The answer says that no mark fits.
    #[error("it says that no numbered {0} fits; look again, one of them may")]
    NotFound(String),
    /// The object cannot be placed at the named place.
    #[error("{0}")]
    Unusable(String),
}

impl Rejection {
    /// Cause of the stage's failure.
    pub fn cause(&self) -> StageCause {
        match self {
            Self::Format(_) => StageCause::Format,
            Self::Undrawn(_) => StageCause::Undrawn,
            Self::NotFound(_) => StageCause::NotFound,
            Self::Unusable(_) => StageCause::Unusable,
        }
    }
}

/// An answer that was rejected, to be quoted in the next question.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RejectedAnswer {
    /// Text of the answer, truncated.
    pub answer: String,
    /// Reason for the rejection, to be quoted with the answer.
    pub rejection: Rejection,
}
