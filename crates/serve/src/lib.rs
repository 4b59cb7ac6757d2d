//! Services of GenManip: segmentation, grasps, the agent and environments over HTTP, policies over WebSockets.
//!
//! - `POST /segment`, `POST /grasp`: synchronous. `POST /agent` starts a job, which is polled at `GET /agent/jobs/JOB`.
//!   Requests and responses are documented in [`genmanip_agent::services`].
//! - `POST /env`: environment sessions in MessagePack, one action per request.
//! - `GET /health`: service name and version; `GET /openapi.json`: API description.
//!
//! A [`PolicyServer`] speaks openpi's protocol instead: binary WebSocket messages, an observation in, an action chunk out.
//!
//! A [`Server`] runs on its own threads until it is stopped. Request size and arrival time are limited, and a fixed
//! number of requests is processed concurrently. Web pages of other sites are refused.

pub mod browser_guard;
mod endpoint;
mod env;
mod jobs;
mod openapi;
mod policy;
mod request_error;
mod server;

pub use endpoint::{AgentEndpoint, Endpoint};
pub use env::EnvEndpoint;
pub use openapi::openapi;
pub use policy::{PolicyEndpoint, PolicyServer};
pub use request_error::RequestError;
pub use server::{ServeError, ServeSettings, Server};
