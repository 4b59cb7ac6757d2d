//! The agent on the simulator: its services by name, and the oracle services that know what it never sees.
//!
//! The agent itself sees images, cameras and joint positions.
//! Where an oracle serves it, [`WithTruth`] tells the oracle, and only the oracle, where everything is; the policy is
//! then privileged, so that every result made with it says `oracle`.

mod choice;
mod masks;
mod model;
mod oracle;
mod truth;
mod witness;

pub use choice::{AgentChoice, MadeAgent, MaskChoice, ModelChoice, Transcribing, keep};
pub use masks::OracleMasks;
pub use model::{Account, ModelFile, SharedModel};
pub use oracle::{ErrorRates, Oracle};
pub use truth::{Injection, Truth, WithTruth};
pub use witness::{FailureClass, Heard, Testimony, Witness, classify};
