//! HTTP responses: JSON bodies, and errors with a hint.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use genmanip_workspace::{WorkspaceError, hint, with_causes};
use serde_json::{Value, json};

use crate::edit::EditError;
use crate::verdict::VerdictError;

/// Reason why a request is refused; each has its own HTTP status.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// Another author changed the same field, or what the request refers to, in the meantime (status 409).
    Conflict {
        /// The conflict as JSON; of an edit, field, values and revision ([`crate::edit::EditError::Conflict`]).
        conflict: Value,
    },
    /// The request is invalid, does not fit the scenario, or could not be computed (status 422).
    Unsuited {
        /// Description of the reason.
        message: String,
        /// Suggested fix.
        hint: String,
    },
    /// No scenario, episode or file of this name (status 404).
    Unknown {
        /// Description of the missing item.
        message: String,
    },
    /// Editing of the scenario or writing to a log has stopped, or a computation panicked (status 503); the same
    /// request may succeed later.
    Stopped {
        /// Description of the reason.
        message: String,
        /// Suggested fix.
        hint: String,
    },
}

impl Refusal {
    /// A [`Refusal::Unsuited`].
    pub fn unsuited(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Unsuited { message: message.into(), hint: hint.into() }
    }

    /// A [`Refusal::Unsuited`] with the message, causes and hint of an error.
    pub fn of_error(error: &(dyn std::error::Error + 'static)) -> Self {
        Self::unsuited(with_causes(error), hint(error).unwrap_or_default())
    }

    /// The error as JSON: `{"message", "hint"}`.
    pub fn error(&self) -> Value {
        match self {
            Self::Conflict { .. } => json!({ "message": "another author changed the same", "hint": "choose one" }),
            Self::Unsuited { message, hint } | Self::Stopped { message, hint } => {
                json!({ "message": message, "hint": hint })
            }
            Self::Unknown { message } => json!({ "message": message, "hint": "" }),
        }
    }
}

impl From<WorkspaceError> for Refusal {
    fn from(error: WorkspaceError) -> Self {
        Self::of_error(&error)
    }
}

impl From<VerdictError> for Refusal {
    fn from(error: VerdictError) -> Self {
        Self::of_error(&error)
    }
}

impl From<EditError> for Refusal {
    fn from(error: EditError) -> Self {
        let (message, hint) = (with_causes(&error), error.hint());
        match error {
            EditError::Conflict(conflict) => {
                Self::Conflict { conflict: serde_json::to_value(&conflict).unwrap_or_default() }
            }
            EditError::ChangedOutside { .. }
            | EditError::Busy { .. }
            | EditError::Log { .. }
            | EditError::Stopped { .. }
            | EditError::File(_) => Self::Stopped { message, hint },
            _ => Self::Unsuited { message, hint },
        }
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let status = match &self {
            Self::Conflict { conflict } => {
                return (StatusCode::CONFLICT, Json(json!({ "conflict": conflict }))).into_response();
            }
            Self::Unsuited { .. } => StatusCode::UNPROCESSABLE_ENTITY,
            Self::Unknown { .. } => StatusCode::NOT_FOUND,
            Self::Stopped { .. } => StatusCode::SERVICE_UNAVAILABLE,
        };
        (status, Json(json!({ "error": self.error() }))).into_response()
    }
}

/// Response 404 with a message.
pub fn not_found(message: &str) -> Response {
    Refusal::Unknown { message: message.to_owned() }.into_response()
}
