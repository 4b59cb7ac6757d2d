//! Learned policies in episodes: their inputs, and the execution of predicted actions.
//!
//! Training and evaluation share this code. Without the feature `learn`, loading fails with the command that installs
//! it.

#[cfg(feature = "learn")]
pub(crate) mod inputs;
#[cfg(feature = "learn")]
pub(crate) mod policy;
#[cfg(not(feature = "learn"))]
mod uninstalled;

#[cfg(feature = "learn")]
pub(crate) use policy::load;
#[cfg(not(feature = "learn"))]
pub(crate) use uninstalled::{load, refusal};
