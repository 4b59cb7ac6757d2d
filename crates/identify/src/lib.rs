//! Identification of simulator parameters from recorded commands and states of an arm.
//!
//! - [`recording`]: recordings of commands and measurements.
//! - [`motions`]: motions that show parameters.
//! - [`identify`](mod@identify): parameters with intervals, and the names of those that the recordings do not determine.
//! - [`synthetic`]: simulated recordings with known truth, for rehearsals and measurements.

mod block;
mod curve;
mod error;
mod expected;
mod friction;
pub mod identify;
pub mod motions;
pub mod parameters;
mod problem;
pub mod recording;
mod replay;
mod restitution;
mod search;
mod set_points;
mod slide;
pub mod structure;
pub mod synthetic;
#[cfg(test)]
mod tests;
mod uncertainty;
pub mod world_text;

pub use error::IdentifyError;
pub use expected::{Expected, expected};
pub use identify::{Identification, identify};
pub use search::SearchSettings;
