//! Masks and grasps from other programs, over HTTP or replayed; this module documents requests and responses.
//!
//! - [`masks`]: `POST /segment`, for servers like SAM 2.
//! - [`grasps`]: `POST /grasp`, for servers like AnyGrasp or Contact-GraspNet.
//! - [`agent_request`]: `POST /agent`, requests to the agent itself from a camera and an arm.
//!
//! The first two use a [`genmanip_llm::Service`]: a server, a recording, or a recording server. Every response is
//! validated number by number before use.

pub mod agent_request;
pub mod grasps;
pub mod masks;

pub use grasps::{GraspError, GraspQuestion, GraspSource, SampledGrasps, ServiceGrasps};
pub use masks::ServiceMasks;

use serde::de::DeserializeOwned;
use serde_json::Value;

/// Maximum number of characters of a parser message to report. Chosen by hand.
const MAX_MESSAGE_CHARS: usize = 200;

/// Deserialises a response; errors name the JSON path.
fn read<T: DeserializeOwned>(answer: Value) -> Result<T, String> {
    serde_path_to_error::deserialize(answer).map_err(|error| {
        let message: String = error.inner().to_string().chars().take(MAX_MESSAGE_CHARS).collect();
        format!("its answer is wrong at {}: {message}", error.path())
    })
}

/// Transport error with its hint.
fn transport_error(error: &genmanip_llm::ChatError) -> String {
    format!("{error} ({})", error.service_hint())
}
