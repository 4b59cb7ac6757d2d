//! Masks and grasps from other programs, over HTTP or replayed; what is sent and answered is documented here.
//!
//! - [`masks`]: `POST /segment`, for servers like SAM 2.
//! - [`grasps`]: `POST /grasp`, for servers like AnyGrasp or Contact-GraspNet.
//! - [`act`]: `POST /agent`, what the agent itself is asked when it is offered to a camera and an arm.
//!
//! The first two ask a [`genmanip_llm::Service`], which is a server, a recording, or a recording of a server.
//! An answer is checked number by number before anything is made of it.

pub mod act;
pub mod grasps;
pub mod masks;

pub use grasps::{GraspError, GraspQuestion, GraspSource, SampledGrasps, ServiceGrasps};
pub use masks::ServiceMasks;

use serde::de::DeserializeOwned;
use serde_json::Value;

/// The longest part of a message about an answer that is repeated.
const SHOWN: usize = 200;

/// Reads an answer; the message names the place of what is wrong.
fn read<T: DeserializeOwned>(answer: Value) -> Result<T, String> {
    serde_path_to_error::deserialize(answer).map_err(|error| {
        let message: String = error.inner().to_string().chars().take(SHOWN).collect();
        format!("its answer is wrong at {}: {message}", error.path())
    })
}

/// A failure of the transport with what to do about it.
fn unanswered(error: &genmanip_llm::ChatError) -> String {
    format!("{error} ({})", error.hint())
}
