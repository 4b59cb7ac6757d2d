//! The modular manipulation system: it acts from RGB-D images, camera parameters and joint positions alone.
//!
//! ```text
//! decompose ─► object ─► part ─► grab point ─► path or cell ─► pick ─► place ─► check ─► next, or again
//!   words      numbered masks    five points   lettered grid     motion, timed       words
//! ```
//!
//! - [`Agent`] is the whole pipeline as a [`Policy`](genmanip_core::Policy).
//! - [`act_once`] plans one pick and one placement from a single image, for a real camera and arm.
//! - [`ask`] puts questions to a vision-language model and takes only answers that name drawn marks.
//! - [`picture`] draws the marks; [`grid`] names cells.
//! - [`segmentation`] finds the things in an image; [`sight`] says where they are.
//! - [`services`] asks other programs for masks and grasps, and says what they are asked.
//!
//! It never sees the simulator or the catalogue: the manifest forbids both.

mod act;
pub mod ask;
pub mod grid;
pub mod picture;
mod pipeline;
pub mod segmentation;
pub mod services;
mod settings;
pub mod sight;

pub use act::{ActQuestion, Acted, ActedStep, Waypoint, act_once};
pub use pipeline::{Agent, Services};
pub use settings::{AgentSettings, MotionSettings, PathKind, Preset};
