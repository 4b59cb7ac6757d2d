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
pub(crate) use policy::{Learned, load};
#[cfg(not(feature = "learn"))]
pub(crate) use uninstalled::{Learned, load, refusal};

/// Settings of execution that a caller may choose for a trained policy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Execution {
    /// Actions of a chunk that are executed before the next observation; `None` for the trained number, or 1 with
    /// `ensemble`.
    pub execute: Option<usize>,
    /// Decay of the weights of temporal ensembling, per prediction; `None` without it.
    pub ensemble: Option<f64>,
}
