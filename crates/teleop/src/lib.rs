//! Teleoperation: a person moves the arm with a SpaceMouse, a gamepad or a keyboard.
//!
//! ```text
//! Source ─events─▶ Decoder ─axes, controls─▶ Mapping ─twist, gripper─▶ Target ─pose─▶ rollout::adapter
//! ```
//!
//! - [`device`]: events decoded into six axes and controls.
//! - [`mapping`]: dead zone, response curve, gains, precision mode, clutch and frame.
//! - [`follow`]: leader arms and trackers, which ask for poses instead of twists.
//! - [`target`]: the commanded pose within its limits.
//! - [`Teleoperation`]: all of it as a [`Policy`](genmanip_core::Policy) of the ordinary episode loop.
//! - [`record`]: raw events, settings, and the limits that were in force, stored beside the episode.
//! - [`EpisodeLog`]: who was in command, what was undone, and idle ends to cut.
//! - [`scripted`]: scripted operator at a virtual device, for tests and measurements.
//!
//! Nothing here reads a clock or opens a device: time is the number of control steps.

pub mod device;
mod episode_log;
pub mod follow;
pub mod mapping;
pub mod record;
pub mod scripted;
mod source;
pub mod target;
mod teleoperation;

pub use episode_log::{EpisodeLog, Trim};
pub use source::{Operator, OperatorKind, Source};
pub use teleoperation::{Status, TeleopSettings, Teleoperation};
