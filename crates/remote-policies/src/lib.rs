//! Policies of other programs, each a [`Policy`](genmanip_core::Policy): they are asked for every chunk of actions.
//!
//! - [`openpi`]: the websocket protocol of openpi's policy server, which many others speak as well.
//! - [`vla_eval`]: the websocket protocol of vla-eval's model servers.
//! - [`numpy`]: arrays in MessagePack as Python programs write them.
//! - [`fake`] is a server on loopback that misbehaves on request, for tests.
//! - [`process`]: classes of Python modules, in a process of their own.
//! - [`picture`]: pictures at the size that models want, as Pillow makes them.
//!
//! A server that cannot be reached, or that fails, is no failure of its policy: the episode is then *not run*.
//! What it answers is checked before it is believed; nothing is unpickled.

mod connection;
pub mod fake;
pub mod numpy;
pub mod openpi;
pub mod picture;
pub mod process;
pub mod vla_eval;

pub use connection::{Patience, RemoteError};
