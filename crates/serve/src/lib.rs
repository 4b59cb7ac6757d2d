//! What GenManip offers to other programs over HTTP: masks, grasps, the agent and environments, computed here.
//!
//! - `POST /segment`, `POST /grasp`: answered at once. `POST /agent` begins a job, which is asked about at
//!   `GET /agent/jobs/JOB`. What is asked and answered is documented in [`genmanip_agent::services`].
//! - `POST /env`: sessions that a program drives, an action per request, in MessagePack.
//! - `GET /health` says what is offered; `GET /openapi.json` describes it for programs.
//!
//! A [`Server`] runs on threads of its own until it is stopped; requests have limits on their size and on the time to
//! arrive, and only so many are computed at once while the others wait.

mod env;
mod jobs;
mod offer;
mod openapi;
mod refusal;
mod server;
mod wire;

pub use env::EnvOffer;
pub use offer::{AgentOffer, Offer};
pub use openapi::openapi;
pub use server::{ServeError, ServeSettings, Server};
