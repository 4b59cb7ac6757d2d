//! What GenManip offers to other programs over HTTP: masks and grasps, computed here.
//!
//! - `POST /segment` and `POST /grasp`: what is asked and answered is documented in [`genmanip_agent::services`].
//! - `GET /health` says what is offered; `GET /openapi.json` describes it for programs.
//!
//! A [`Server`] runs on threads of its own until it is stopped; requests have a limit on their size, and only so many
//! are computed at once while the others wait.

mod offer;
mod openapi;
mod server;

pub use offer::Offer;
pub use openapi::openapi;
pub use server::{ServeError, ServeSettings, Server};
