//! Policies of other programs, each a [`Policy`](genmanip_core::Policy) that requests action chunks over a protocol.
//!
//! - [`openpi`]: WebSocket protocol of openpi's policy server, which many others support.
//! - [`vla_eval`]: WebSocket protocol of vla-eval's model servers.
//! - [`served`]: policies that `genmanip serve policy` offers, in their own formats over openpi's protocol.
//! - [`wire`]: conversion between MessagePack and JSON.
//! - [`numpy`]: NumPy arrays in MessagePack.
//! - [`fake`]: a configurable misbehaving loopback server, for tests.
//! - [`process`]: policies from Python modules, each in a separate process.
//! - [`resize`]: image resizing identical to Pillow's.
//!
//! If a server is unreachable or fails, the episode is *not run*, which does not count as a failure of the policy.
//! Responses are validated before use; nothing is unpickled.

mod connection;
pub mod fake;
pub mod numpy;
pub mod openpi;
pub mod process;
pub mod resize;
pub mod served;
pub mod vla_eval;
pub mod wire;

pub use connection::{RemoteError, Timeouts, decode};
