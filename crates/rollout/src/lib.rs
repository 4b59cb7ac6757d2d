//! Episodes: one environment and one loop for every policy, the expert that needs no human, and what is made of what was recorded.
//!
//! Collecting demonstrations *is* evaluating the [`expert`] with the recorder on; there is no second loop.
//! Physics runs once; pictures are jobs over recorded states, done afterwards.

pub mod adapter;
pub mod cloud_verdict;
pub mod collect;
pub mod controls;
mod cores;
pub mod driver;
pub mod environment;
pub mod episode_loop;
pub mod evaluate;
pub mod evidence;
pub mod expert;
pub mod grasp_trial;
pub mod images;
pub mod physics_variation;
pub mod policies;
pub mod replay;
mod settings;
mod stage;

pub use cores::{Cores, HeldCore};
pub use driver::{Driver, Turn};
pub use environment::Environment;
pub use episode_loop::{resume_episode, run_corrected, run_episode, run_watched};
pub use settings::RolloutSettings;
pub use stage::{RolloutError, Stage};
