//! Bridge to an arm: random streams of commands against its limits, policies behind it against direct simulation, planned
//! motions, chunks of actions, and drills.

pub mod chunks;
pub mod drills;
pub mod motions;
pub mod paired;
pub mod streams;

use genmanip_real::bridge::LinkSettings;

/// Connection between policy and bridge: 20 ± 10 ms, 1 % of the streamed messages lost.
const LINK: LinkSettings = LinkSettings { latency_s: 0.02, jitter_s: 0.01, loss: 0.01 };
