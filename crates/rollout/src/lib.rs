//! Episodes: one environment and one loop for all policies, the scripted expert, and processing of recorded episodes.
//!
//! Collecting demonstrations *is* evaluating the [`expert`] with recording enabled; there is no second loop. Physics
//! runs once; images are rendered afterwards from the recorded states.

pub mod adapter;
pub mod ahead;
pub mod baselines;
pub mod cloud_verdict;
pub mod collect;
mod cpu_cores;
pub mod driver;
pub mod environment;
pub mod episode_loop;
pub mod evaluate;
pub mod evidence;
pub mod expert;
pub mod go_to;
pub mod grasp_trial;
pub mod images;
pub mod physics_variation;
pub mod policies;
mod recording;
pub mod replay;
mod robot_interface;
mod settings;
pub mod shaping;
mod stage;

pub use cpu_cores::{Cores, HeldCore};
pub use driver::{ActionOutcome, Driver};
pub use environment::Environment;
pub use episode_loop::{resume_episode, run_corrected, run_episode, run_episode_with, run_policy};
pub use robot_interface::RobotInterface;
pub use settings::RolloutSettings;
pub use stage::{RolloutError, Stage};
