//! Training of policies on the demonstrations of a run.
//!
//! `crates/policy` knows arrays only; this module converts episodes to arrays. Without the feature `learn`, every
//! function fails with the command that installs it.

mod options;

#[cfg(feature = "learn")]
mod check;
#[cfg(feature = "learn")]
mod controls;
#[cfg(feature = "learn")]
mod demonstrations;
#[cfg(feature = "learn")]
mod images;
#[cfg(feature = "learn")]
mod page;
#[cfg(feature = "learn")]
mod presets;
#[cfg(feature = "learn")]
mod recorded;
#[cfg(feature = "learn")]
mod suite;
#[cfg(feature = "learn")]
mod training;
#[cfg(not(feature = "learn"))]
mod uninstalled;

#[cfg(feature = "learn")]
pub use check::check;
#[cfg(feature = "learn")]
pub use controls::controls;
pub use genmanip_policy::{Head, Preset};
pub use options::{CheckOptions, Checked, Length, SuiteDemonstrations, TRAINING, TrainOptions, Trained};
#[cfg(feature = "learn")]
pub use suite::demonstrate;
#[cfg(feature = "learn")]
pub use training::train;
#[cfg(not(feature = "learn"))]
pub use uninstalled::{check, controls, demonstrate, train};
