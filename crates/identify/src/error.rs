//! Errors of an identification.

use genmanip_sim::SimError;
use thiserror::Error;

/// Reason why recordings identify nothing.
#[derive(Debug, Error)]
pub enum IdentifyError {
    /// A recording does not fit the robot.
    #[error("{message}")]
    Recording {
        /// Expected and actual value.
        message: String,
    },
    /// The model cannot be simulated along the recording, whatever the parameters.
    #[error("the recording cannot be simulated from any start")]
    Start,
    /// A motion could not be found.
    #[error("{message}")]
    NoPath {
        /// Place and reason.
        message: String,
    },
    /// The simulator refused the model or diverged.
    #[error(transparent)]
    Sim(#[from] SimError),
}
