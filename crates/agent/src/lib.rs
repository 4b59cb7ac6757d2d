//! The modular manipulation system: it acts from RGB-D images, camera parameters and joint positions alone.
//!
//! ```text
//! decompose ─► object ─► part ─► grab point ─► path or cell ─► pick ─► place ─► check ─► next, or retry
//!   words      numbered masks    five points   labelled grid    timed motions        words
//! ```
//!
//! - [`Agent`] is the whole pipeline as a [`Policy`](genmanip_core::Policy).
//! - [`plan_pick_and_place`] plans one pick and one placement from a single image, for a real camera and arm.
//! - [`ask`] sends questions to a vision-language model and accepts only answers that name marks drawn on the images.
//! - [`image`] draws the marks; [`grid`] labels the cells of an image.
//! - [`segmentation`] finds the objects in an image; [`perception`] locates them in 3D.
//! - [`services`] requests masks and grasps from other programs and documents those requests.
//!
//! The agent never sees the simulator or the asset catalogue: `Cargo.toml` forbids both dependencies.

pub mod ask;
pub mod grid;
pub mod image;
pub mod perception;
mod pipeline;
pub mod segmentation;
pub mod services;
mod settings;
mod single_image;

pub use pipeline::{Agent, Services};
pub use settings::{AgentSettings, Asks, MotionSettings, PathKind, Preset};
pub use single_image::{ActQuestion, Acted, ActedStep, Waypoint, plan_pick_and_place};
